"""dse design normal-form: generated plants against hand-derived ones and golden data."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from compiled import COMPILER, ROOT, Compiled, compile_c
from conftest import Command

pytest.importorskip("casadi")
EXAMPLES = ROOT / "tools" / "dse" / "design" / "examples"
GOLDEN = ROOT / "tests" / "golden" / "adaptive_high_gain_ekf"
BLOCKWISE = ("jacobian", "map_jacobian")
EMODEL, EINVAL = -8, -1

needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler")
Make = Callable[[Path], Compiled]

HEAD = """
import casadi as ca
from dse.design.plant_file import Parameter, ParameterSet, Signal, Subsystem
title, source, time_unit, time_unit_s = "made up", "a test", "s", 1
def signals(*names): return [Signal(n, "", 0.3, 1, n) for n in names]
parameters = [Parameter("k", "", 0, 10, "coupling")]
"""
# b and d each need the other, and their equations cannot be solved by taking them apart
COUPLED = (
    HEAD
    + """
name = "coupled"
states, outputs = signals("a", "b", "c", "d", "e"), signals("y1", "y2")
start = {"a": 0.3, "b": 0.1, "c": -0.2, "d": 0.4, "e": 0.2}
sets = [ParameterSet("one", "one", {"k": 0.3}, start)]
subsystems = [Subsystem("1", ["a", "b"], ["y1"]), Subsystem("2", ["c", "d", "e"], ["y2"])]
def f(t, x, u, p):
    return {"a": x.b + x.b**3 + p.k * ca.sin(x.d), "b": -x.a, "c": x.d + p.k * ca.tanh(x.b),
            "d": x.e - x.c, "e": -x.e - x.d * x.a}
def h(t, x, u, p): return {"y1": x.a, "y2": x.c}
"""
)
# one subsystem with two outputs; the second's chain has one coordinate
TWO_OUTPUTS = (
    HEAD
    + """
name = "two_outputs"
states, outputs, inputs = signals("a", "b", "c"), signals("y1", "y2"), signals("v")
sets = [ParameterSet("one", "one", {"k": 2}, {"a": 1, "b": 2, "c": 3})]
subsystems = [Subsystem("all", ["a", "b", "c"], ["y1", "y2"], chains=[2, 1])]
def f(t, x, u, p):
    return {"a": p.k * ca.exp(x.b) - x.c, "b": -x.b * x.c + u.v, "c": x.a - x.c + u.v}
def h(t, x, u, p): return {"y1": x.a, "y2": x.c}
"""
)
# f and h change with time, and one input is the rate of another
MOVING = (
    HEAD
    + """
name = "moving"
states, outputs, inputs = signals("a", "b", "c"), signals("y"), signals("v", "dv", "w")
rates = {"v": "dv"}
sets = [ParameterSet("one", "one", {"k": 2}, {"a": 1, "b": 2, "c": 3})]
subsystems = [Subsystem("all", ["a", "b", "c"], ["y"])]
def f(t, x, u, p):
    return {"a": (2 + ca.sin(t)) * x.b + u.v * x.a, "b": p.k * x.c + u.w * x.b, "c": -x.a * x.b}
def h(t, x, u, p): return {"y": x.a + ca.cos(3 * t)}
"""
)


@pytest.fixture(scope="session")
def make(tmp_path_factory: pytest.TempPathFactory) -> Make:
    """Generates and compiles a plant file, once."""
    from dse.design import lie, operating, plant_c, plant_file

    folder = tmp_path_factory.mktemp("plants")
    made: dict[Path, Compiled] = {}

    def compiled(model: Path) -> Compiled:
        if model not in made:
            form = lie.derive(plant_file.load(model))
            operating.check_observability(form)
            path = folder / f"{form.plant.name}.c"
            path.write_text(plant_c.generate(form, path.name))
            made[model] = Compiled(path, form.plant.name, folder / "library")
        return made[model]

    return compiled


@pytest.fixture(scope="session")
def model_file(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Writes a plant file, the same text to the same file."""
    folder = tmp_path_factory.mktemp("models")

    def write(text: str) -> Path:
        path = folder / f"model_{abs(hash(text))}.py"
        path.write_text(text)
        return path

    return write


def assert_near(got: np.ndarray, want: np.ndarray, tolerance: float = 1e-9) -> None:
    """Relative to each value, and to 1e-3 of the largest beside it."""
    want = np.asarray(want, float).ravel()
    floor = 1e-3 * np.abs(want).max(initial=0)
    assert got.shape == want.shape
    assert (np.abs(got - want) <= tolerance * (np.abs(want) + floor)).all(), f"{got} for {want}"


HAND = [("cstr2", 0), ("cstr2", 1), ("cstr4", 0), ("three_tank", 0)]


@needs_compiler
@pytest.mark.parametrize(("name", "set_"), HAND)
def test_generated_plant_equals_the_hand_derived_one(make: Make, name: str, set_: int) -> None:
    plant = make(EXAMPLES / f"{name}.py")
    nx, nu, ny, blocks, *_ = plant.sizes()
    assert plant.sizes(name)[:4] == [nx, nu, ny, blocks]
    generator = np.random.default_rng(1)
    start, spread, nominal, input_spread = {
        "cstr2": ([350, 3, 330, 2.5], [30, 2, 20, 2], [5, 0], [1, 100]),
        "cstr4": ([340, 2, 350, 3, 345, 2.5, 360, 4], [20, 1.5] * 4, [], []),
        "three_tank": ([51, 35, 16, 57, 41], [10, 10, 8, 10, 10], [7.3, 8.8], [1, 1]),
    }[name]
    for _ in range(50):
        x = np.array(start) + np.array(spread) * generator.uniform(-1, 1, nx)
        u = np.array(nominal) + generator.uniform(-1, 1, nu) * np.array(input_spread)
        z = plant.value("encode", x, u, set_=set_)
        for what, i, at in [
            *((what, 0, x) for what in ("f", "h", "dfdx", "dhdx", "encode")),
            *((what, 0, z) for what in ("decode", "field")),
            *(
                (what, i, z if what == "jacobian" else x)
                for what in BLOCKWISE
                for i in range(blocks)
            ),
        ]:
            got = plant.value(what, at, u, i, set_=set_)
            assert_near(got, plant.value(what, at, u, i, set_=set_, shipped=name))
        assert_near(plant.value("decode", z, u, set_=set_), x)


@needs_compiler
@pytest.mark.parametrize("which", ["ch2", "ch4"])
def test_generated_tanks_reproduce_the_golden_points(make: Make, which: str) -> None:
    plant = make(EXAMPLES / "cstr2.py")
    golden = json.loads((GOLDEN / f"plant_2cstr_{which}.json").read_text())
    u, set_ = np.array([4.998, 0]), ["ch2", "ch4"].index(which)
    for point in golden["points"]:
        x = np.array(point["x"])
        z = plant.value("encode", x, u, set_=set_)
        f = plant.value("f", x, u, set_=set_) + np.array(point["w"])
        assert_near(f, point["f"])
        assert_near(plant.value("h", x, u, set_=set_), point["h"])
        assert_near(plant.value("dfdx", x, u, set_=set_), point["dfdx"])
        assert_near(z, point["z"])
        assert_near(plant.value("field", z, u, set_=set_), point["zdot_noise_free"])
        for i, row in enumerate(point["row2_A_plus_bstar"]):
            assert_near(plant.value("jacobian", z, u, i, set_=set_)[2:], row)


@needs_compiler
def test_generated_tanks_follow_a_varying_feed_like_the_golden_points(make: Make) -> None:
    plant = make(EXAMPLES / "cstr2.py")
    golden = json.loads((GOLDEN / "plant_2cstr_sin.json").read_text())
    for point in golden["points"]:
        phase = 0.008 * 3600 * point["t"]  # F0 = 10 (1 + 0.9 sin(0.008 t / s))
        u = np.array([10 * (1 + 0.9 * np.sin(phase)), 9 * 0.008 * 3600 * np.cos(phase)])
        z = plant.value("encode", np.array(point["x"]), u, set_=1)
        assert_near(z, point["z"])
        assert_near(plant.value("field", z, u, set_=1), point["zdot_noise_free"])
        for i, row in enumerate(point["row2_A_plus_bstar"]):
            assert_near(plant.value("jacobian", z, u, i, set_=1)[2:], row)


@needs_compiler
def test_generated_three_tank_reproduces_the_golden_points(make: Make) -> None:
    plant = make(EXAMPLES / "three_tank.py")
    golden = json.loads((GOLDEN / "plant_threetank.json").read_text())
    for point in golden["points"]:
        x, u = np.array(point["r"]), np.array(point["u"])
        z = plant.value("encode", x, u)
        assert_near(plant.value("f", x, u), point["f_r"])
        assert_near(z, point["z"])
        assert_near(plant.value("field", z, u), point["zdot"])
        assert_near(plant.value("jacobian", z, u, 0)[2:], point["row2_F1"])
        assert_near(plant.value("jacobian", z, u, 1), [point["F2"]])
        assert_near(plant.value("jacobian", z, u, 2)[2:], point["row2_F3"])


def differences(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    step = 1e-6
    columns = [
        (function(x + step * unit) - function(x - step * unit)) / (2 * step)
        for unit in np.eye(len(x))
    ]
    return np.stack(columns, axis=1)


@needs_compiler
@pytest.mark.parametrize("text", [COUPLED, TWO_OUTPUTS], ids=["coupled", "two outputs"])
def test_all_jacobians_agree_with_differences(
    make: Make, model_file: Callable[[str], Path], text: str
) -> None:
    plant = make(model_file(text))
    nx, nu, _, blocks, *_ = plant.sizes()
    chains = [2, 3] if blocks == 2 else [3]
    generator = np.random.default_rng(2)
    for _ in range(20):
        x = generator.uniform(-0.5, 0.5, nx)
        u = generator.uniform(-1, 1, nu) if nu else None
        z = plant.value("encode", x, u)
        dfdx = differences(lambda v, u=u: plant.value("f", v, u), x)
        assert_near(plant.value("dfdx", x, u), dfdx, 1e-6)
        slope = differences(lambda v, u=u: plant.value("encode", v, u), x)
        field = differences(lambda v, u=u: plant.value("field", v, u), z)
        assert_near(plant.value("field_jacobian", z, u), field, 1e-6)
        dx = generator.uniform(-1, 1, nx)
        assert_near(plant.value("push", x, u, dx=dx), slope @ dx, 1e-6)
        for i in range(blocks):
            own = slice(sum(chains[:i]), sum(chains[: i + 1]))
            assert_near(plant.value("jacobian", z, u, i), field[own, own], 1e-6)
            assert_near(plant.value("map_jacobian", x, u, i), slope[own, own], 1e-6)


@needs_compiler
@pytest.mark.parametrize("text", [COUPLED, TWO_OUTPUTS], ids=["coupled", "two outputs"])
def test_field_is_the_derivative_of_the_coordinates_along_the_plant(
    make: Make, model_file: Callable[[str], Path], text: str
) -> None:
    plant = make(model_file(text))
    nx, nu, *_ = plant.sizes()
    generator, h = np.random.default_rng(3), 1e-6
    for _ in range(20):
        x = generator.uniform(-0.5, 0.5, nx)
        u = generator.uniform(-1, 1, nu) if nu else None
        z, dx = plant.value("encode", x, u), plant.value("f", x, u)
        ends = [plant.value("encode", x + s * h * dx, u) for s in (1, -1)]
        assert_near(plant.value("field", z, u), (ends[0] - ends[1]) / (2 * h), 1e-6)


@needs_compiler
def test_coordinates_follow_time_and_inputs_that_move(
    make: Make, model_file: Callable[[str], Path]
) -> None:
    plant = make(model_file(MOVING))
    generator, h = np.random.default_rng(6), 1e-6
    for _ in range(20):
        t, (x, u) = generator.uniform(0, 5), generator.uniform(-1, 1, (2, 3))
        z, dx = plant.value("encode", x, u, t=t), plant.value("f", x, u, t=t)
        du = np.array([u[1], 0, 0])
        ends = [plant.value("encode", x + s * dx, u + s * du, t=t + s) for s in (h, -h)]
        dz = plant.value("field", z, u, t=t)
        assert_near(dz, (ends[0] - ends[1]) / (2 * h), 1e-6)
        assert (dz[:2] == z[1:]).all()
        assert_near(plant.value("decode", z, u, t=t), x)
        F = differences(lambda v, u=u, t=t: plant.value("field", v, u, t=t), z)
        assert_near(plant.value("jacobian", z, u, t=t), F, 1e-6)


@needs_compiler
def test_iterated_inverse_is_right_to_working_precision_or_refused(
    make: Make, model_file: Callable[[str], Path]
) -> None:
    plant = make(model_file(COUPLED))
    generator, solved = np.random.default_rng(4), 0
    for _ in range(300):
        x = generator.uniform(-2, 2, 5)
        z = plant.value("encode", x, None)
        status, back = plant.call("decode", z, None)
        assert status in (0, EMODEL)
        if status == 0:
            solved += 1
            assert_near(plant.value("encode", back, None), z, 1e-12)
    assert solved > 290
    for bad in (np.nan, np.inf, 1e300):
        for what in ("decode", "field", "jacobian", "field_jacobian"):
            assert plant.status(what, np.array([0, bad, 0, 0, 0]), None) == EMODEL


@needs_compiler
def test_more_stack_than_a_small_controller_has_is_asked_for_by_name(
    model_file: Callable[[str], Path], tmp_path: Path
) -> None:
    """The Jacobians of a plant with an iterated inverse take two matrices of all states."""
    made = model_file(COUPLED)
    from dse.design import lie, plant_c, plant_file

    (tmp_path / "coupled.c").write_text(plant_c.generate(lie.derive(plant_file.load(made)), "c"))
    needed = 2 * 5 * 5 * 8
    compile_c(["-c", f"-DDSE_PLANT_STACK={needed}", "coupled.c"], tmp_path)
    with pytest.raises(AssertionError, match="too many states for the stack: see DSE_PLANT_STACK"):
        compile_c(["-c", f"-DDSE_PLANT_STACK={needed - 1}", "coupled.c"], tmp_path)


@needs_compiler
def test_where_there_is_no_plant_the_generated_functions_say_so(make: Make) -> None:
    plant = make(EXAMPLES / "cstr2.py")
    u = np.array([4.998, 0])
    for bad in (0.0, -1.0, np.nan, np.inf):
        at = np.array([360, 3, bad, 2.5])
        for what in ("f", "dfdx", "encode", "decode", "field", "jacobian", "map_jacobian"):
            assert plant.status(what, at, u) == EMODEL, (what, bad)
    good = np.array([360, 3, 320, 2.5])
    for what in ("f", "h", "dfdx", "encode", "decode", "field", "jacobian", "push"):
        assert plant.status(what, good, None, dx=good) == EINVAL
    for what in BLOCKWISE:
        assert plant.status(what, good, u, 2) == EINVAL
        assert plant.status(what, good, u, -1) == EINVAL
    tank = make(EXAMPLES / "three_tank.py")
    # the derivative of level 1 without inflow cannot be positive: no level difference gives that
    z = np.array([50.0, 10.0, 16.0, 57.0, -1200.0])
    assert tank.status("decode", z, np.zeros(2)) == EMODEL


@needs_compiler
def test_values_outside_their_range_make_no_generated_plant(make: Make) -> None:
    plant = make(EXAMPLES / "cstr2.py")
    assert plant.sizes()[4:] == [23, 2]
    values = np.array(
        [1, 3, 300, 4, 30, 300, 2, 34.998, 0, 1.8e4, 1.2e4, 1000, 0.231, 8.314]
        + [-5e4, -5.2e4, -5.04e4, 3e6, 3e5, 3e5, 5e4, 7.53e4, 7.53e4]
    )
    x, u = np.array([360, 3, 320, 2.5]), np.array([4.998, 0])
    by_set = plant.value("f", x, u)
    assert (plant.value("f", x, u, values=values) == by_set).all()
    assert (plant.value("f", x, u, values=values * (1 + 1e-3)) != by_set).any()
    for k, bad in ((0, 0.0), (13, 9.5), (11, np.nan)):
        worse = values.copy()
        worse[k] = bad
        assert plant.status("prepare", x, u, values=worse) == EINVAL


@needs_compiler
def test_only_the_last_row_of_a_generated_block_is_nonlinear(make: Make) -> None:
    plant = make(EXAMPLES / "cstr2.py")
    generator = np.random.default_rng(5)
    for _ in range(20):
        z = np.array([350, -500, 330, 100]) * generator.uniform(0.9, 1.1, 4)
        dz = plant.value("field", z, np.array([5, 50]))
        assert (dz[[0, 2]] == z[[1, 3]]).all()


def test_command_writes_the_plant_and_says_how_it_was_made(dse: Command, tmp_path: Path) -> None:
    target = tmp_path / "tanks.c"
    done = dse("design", "normal-form", EXAMPLES / "cstr2.py", "-o", target, "--check")
    assert done.code == 0, done.err
    assert "closed form" in done.out and "4 of 4" in done.out and "WRONG" not in done.out
    text = target.read_text()
    for told in ("Generated by dse", "CasADi", "cstr2.py", "SHA-256", "const struct dse_plant"):
        assert told in text
    for forbidden in ("malloc", "math.h>", " exp(", " sqrt(", "casadi_"):
        assert forbidden not in text
    assert text == dse_again(dse, target)


def dse_again(dse: Command, target: Path) -> str:
    dse("design", "normal-form", EXAMPLES / "cstr2.py", "-o", target)
    return target.read_text()


def test_library_functions_stand_for_those_of_the_platform(
    dse: Command, model_file: Callable[[str], Path], tmp_path: Path
) -> None:
    text = (
        HEAD
        + """
name = "functions"
states, outputs = signals("a", "b"), signals("y")
sets = [ParameterSet("one", "one", {"k": 1}, {"a": 0.4, "b": 0.3})]
subsystems = [Subsystem("1", ["a", "b"], ["y"])]
def f(t, x, u, p):
    a = ca.sqrt(1 + x.a**2) + ca.fabs(x.a) ** 1.5 + ca.log(2 + ca.cos(x.a)) + ca.tan(x.a)
    return {"a": ca.exp(x.b), "b": ca.if_else(x.a > p.k, ca.fmax(a, x.b), ca.sign(x.b) * a)}
def h(t, x, u, p): return {"y": x.a}
"""
    )
    target = tmp_path / "functions.c"
    assert dse("design", "normal-form", model_file(text), "-o", target, "--check").code == 0
    written = target.read_text()
    for name in ("sqrt", "abs", "pow", "log", "cos", "sin", "exp", "max"):
        assert f"dse_{name}(" in written
    missing = model_file(text.replace("ca.tan(x.a)", "ca.erf(x.a)"))
    done = dse("design", "normal-form", missing)
    assert done.code == 2 and "erf has no counterpart" in done.err


# what is changed in COUPLED, and what the message must say
MISTAKES = [
    ("def h", "def g", "does not define h"),
    ('"b": -x.a,', '"b": -x.q,', "f: no state is called 'q'"),
    ("p.k * ca.sin", "p.kk * ca.sin", "did you mean k?"),
    ('"c": x.d + p.k * ca.tanh(x.b)', '"c": x.c', "not observable"),
    ('{"k": 0.3}', '{"k": 11}', "k = 11 is not within 0..10"),
    ('{"k": 0.3}', "{}", "values has no k"),
    ('{"k": 0.3}', '{"k": "x"}', "k is not a number"),
    ('"e": 0.2}', '"e": float("nan")}', "e is not a number"),
    ('signals("y1", "y2")', '("y1", "y2")', "outputs: must be a list of Signal"),
    ("def h(t", "domain = 1\ndef h(t", "domain: must be a function"),
    ("def h(t", "def domain(*_): return 1\ndef h(t", "domain must give a list"),
    ('"e": 0.2}', "}", "x0 has no e"),
    ('["a", "b"], ["y1"]', '["b", "a"], ["y1"]', "subsystem by subsystem"),
    ('["c", "d", "e"], ["y2"]', '["c", "d", "e"], []', "outputs must be listed"),
    ('name = "coupled"', 'name = "Coupled plant"', "becomes a C name"),
    ('{"y1": x.a, "y2": x.c}', '{"y1": x.a}', "h must give {y1, y2}, not y1"),
    ('"b": -x.a,', '"b": [1, 2],', "must be one number"),
    ('"b": -x.a,', '"b": 1 / 0,', "ZeroDivisionError"),
    ("def f(t", "def f(t t", "SyntaxError"),
]


@pytest.mark.parametrize(("old", "new", "told"), MISTAKES)
def test_mistakes_in_a_plant_file_are_told_in_one_line(
    dse: Command, model_file: Callable[[str], Path], old: str, new: str, told: str
) -> None:
    assert old in COUPLED
    path = model_file(COUPLED.replace(old, new))
    done = dse("design", "normal-form", path)
    assert done.code == 2 and told in done.err, done.err
    assert done.err.startswith("dse design normal-form: ") and len(done.err.splitlines()) == 1


def test_state_that_cannot_be_seen_at_an_operating_point_is_named(
    dse: Command, model_file: Callable[[str], Path], tmp_path: Path
) -> None:
    text = (
        HEAD
        + """
name = "blind"
states, outputs = signals("level", "hidden"), signals("y")
sets = [ParameterSet("one", "one", {"k": 1}, {"level": 1, "hidden": 0.5})]
subsystems = [Subsystem("1", ["level", "hidden"], ["y"])]
points = {"empty": {"level": 0.0}}
def f(t, x, u, p): return {"level": x.level * x.hidden, "hidden": -x.hidden}
def h(t, x, u, p): return {"y": x.level}
"""
    )
    target = tmp_path / "blind.c"
    done = dse("design", "normal-form", model_file(text), "-o", target)
    assert done.code == 2 and not target.exists()
    assert "not observable at 'empty': hidden cannot be told" in done.err
    assert "rank 1 of 2" in done.err
    seen = dse("design", "normal-form", model_file(text.replace('"level": 0.0', '"level": 2.0')))
    assert seen.code == 0 and "2 of 2" in seen.out


def test_input_that_breaks_the_triangular_form_is_refused(
    dse: Command, model_file: Callable[[str], Path]
) -> None:
    text = (
        HEAD
        + """
name = "pushed"
states, outputs, inputs = signals("a", "b"), signals("y"), signals("v")
inputs_in_map = False
sets = [ParameterSet("one", "one", {"k": 1}, {"a": 1, "b": 0.5})]
subsystems = [Subsystem("1", ["a", "b"], ["y"])]
def f(t, x, u, p): return {"a": x.b + u.v * x.b, "b": -x.a}
def h(t, x, u, p): return {"y": x.a}
"""
    )
    done = dse("design", "normal-form", model_file(text))
    assert done.code == 2 and "not triangular" in done.err
    allowed = text.replace("u.v * x.b", "u.v * x.a")
    assert dse("design", "normal-form", model_file(allowed), "--check").code == 0
    bent = dse("design", "normal-form", model_file(text.replace("u.v * x.b", "u.v**2")))
    assert bent.code == 2 and "affinely" in bent.err
    whole = text.replace("inputs_in_map = False", "").replace("u.v * x.b", "u.v**2 * x.b")
    assert dse("design", "normal-form", model_file(whole), "--check").code == 0
