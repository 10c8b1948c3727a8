"""Identification and observability with the shipped plants' own equations."""

from pathlib import Path

import lcm
import numpy as np
import pytest
from compiled import COMPILER, ROOT
from conftest import Command
from synthetic import Plan, Writer, parts, plant_info, put_info, put_node

from dse import lcmtypes
from dse.design.linear_windows import window
from dse.design.observability import seen
from dse.design.output_error import Data, Problem, fit, identify
from dse.design.scenario_file import find
from dse.errors import UserError
from dse.plants import ModelError, Plant

pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler")

NAMES = ["ap1", "ap2", "ad1", "ad2", "ad3", "b1", "b2"]
PERIOD = 1 / 3600
NOISE = 0.3


@pytest.fixture
def tank(library: Path) -> Plant:
    return Plant("three_tank")


def truth(tank: Plant) -> np.ndarray:
    return tank.set("rig").values[[tank.parameter(name) for name in NAMES]]


def inputs(tank: Plant, samples: int) -> np.ndarray:
    """Binary, +-12 %, bits of 60 samples."""
    bits = np.random.default_rng(7).integers(0, 2, (samples // 60 + 1, 2))
    return tank.nominal_inputs * (0.88 + 0.24 * np.repeat(bits, 60, axis=0)[:samples])


def problem(tank: Plant, seed: int, noise: float = NOISE, samples: int = 4000) -> Problem:
    """A record of the rig, and a start that is 20 to 40 % off."""
    u, rig = inputs(tank, samples), tank.set("rig")
    y = tank.simulate(rig.values, rig.x0, u, PERIOD)[1]
    y = y + noise * np.random.default_rng(seed).standard_normal(y.shape)
    off = dict(zip(NAMES, (0.7, 1.3, 1.3, 0.7, 1.25, 0.65, 1.35), strict=True))
    values = rig.values.copy()
    for name, factor in off.items():
        values[tank.parameter(name)] *= factor
    data = Data(PERIOD, u, y)
    return Problem(tank, data, round(0.75 * samples), list(NAMES), values, rig.x0)


# ---- the plants ----


def test_names_and_numbers_are_those_of_the_c_plant(tank: Plant) -> None:
    assert [one.name for one in tank.states] == ["x1", "x2", "x3", "x5", "x4"]
    assert [one.name for one in tank.outputs] == ["y1", "y2", "y3"]
    assert [one.name for one in tank.sets] == ["identified", "rig"]
    assert (tank.time_unit, tank.time_unit_s) == ("h", 3600.0)
    assert tank.states[0].unit == "cm" and tank.states[0].scale == 5.0
    assert tank.set().values[tank.parameter("ad2")] == 7.78
    assert tank.parameters[tank.parameter("g")].low == 900.0
    with pytest.raises(UserError, match="did you mean ad"):
        tank.parameter("ad")
    with pytest.raises(UserError, match="did you mean three_tank"):
        Plant("three_tanks")


def test_a_sample_is_one_euler_step_or_runge_kutta_steps(tank: Plant) -> None:
    rig, u = tank.set("rig"), np.tile(1.2 * tank.nominal_inputs, (50, 1))
    x = rig.x0.copy()
    euler, outputs = tank.simulate(rig.values, rig.x0, u, PERIOD)
    for k in range(50):
        np.testing.assert_allclose(euler[k], x, rtol=1e-14)
        np.testing.assert_allclose(outputs[k], x[[0, 2, 3]], rtol=1e-14)
        x = x + PERIOD * tank.evaluate("f", rig.values, x, u[k])
    one, many = (tank.simulate(rig.values, rig.x0, u, PERIOD, steps)[0] for steps in (1, 10))
    # RK4's local error is of the fifth order, Euler's of the second
    assert np.abs(one - many).max() < 1e-9 < 1e-4 < np.abs(euler - many).max()


def test_jacobians_are_those_of_the_equations(library: Path) -> None:
    plant = Plant("cstr4")  # without inputs
    values, x, u = plant.sets[0].values, plant.sets[0].x0, np.empty(0)
    slope = plant.evaluate("dfdx", values, x, u)
    for k in range(len(x)):
        step = np.zeros(len(x))
        step[k] = 1e-5
        up, down = (plant.evaluate("f", values, x + sign * step, u) for sign in (1, -1))
        np.testing.assert_allclose(slope[:, k], (up - down) / 2e-5, rtol=1e-5, atol=1e-5)


def test_what_cannot_be_evaluated_is_an_error(tank: Plant, library: Path) -> None:
    rig = tank.set("rig")
    with pytest.raises(ModelError, match="cannot be evaluated"):
        tank.evaluate("f", rig.values, rig.x0 * np.nan, tank.nominal_inputs)
    with pytest.raises(ModelError, match="outside its range"):
        tank.evaluate("f", -rig.values, rig.x0, tank.nominal_inputs)


def test_a_missing_library_says_how_to_build_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("DSE_PLANTS", raising=False)
    monkeypatch.setattr("dse.plants.ROOT", tmp_path)
    with pytest.raises(UserError, match="cmake --build"):
        Plant("three_tank")
    with pytest.raises(UserError, match="no such library"):
        Plant("three_tank", tmp_path / "none.so")


# ---- identification ----


def test_without_noise_the_parameters_are_found_exactly(tank: Plant) -> None:
    found = identify(problem(tank, 0, noise=0.0, samples=2000))
    np.testing.assert_allclose(found.value, truth(tank), rtol=1e-5)
    np.testing.assert_allclose(found.fit_validation, 100, atol=1e-2)


def test_with_noise_they_are_found_within_the_stated_numbers(tank: Plant) -> None:
    """As the spec's check on stand-in data; fit 90, 34, 89 % there."""
    found = identify(problem(tank, 1, samples=12000))
    error = np.abs(found.value / truth(tank) - 1)
    assert error[:2].max() < 0.052  # a_p
    assert error[2:5].max() < 0.04  # a_d
    assert error[5:].max() < 0.005  # b
    assert found.fit_validation[[0, 2]].min() > 80 > 60 > found.fit_validation[1] > 15


def test_intervals_hold_the_truth_about_as_often_as_they_say(tank: Plant) -> None:
    inside = []
    for seed in range(30):
        found = identify(problem(tank, seed, samples=1500))
        inside.append(np.abs(found.value - truth(tank)) <= found.half_width)
    # 95 % of 210, which is 199.5 +- 3.2 were they independent
    assert 0.88 < np.mean(inside) < 0.99


def test_missing_values_are_left_out(tank: Plant) -> None:
    whole = problem(tank, 1, noise=0.0, samples=2000)
    whole.data.y[np.random.default_rng(1).random(whole.data.y.shape) < 0.3] = np.nan
    found = identify(whole)
    np.testing.assert_allclose(found.value, truth(tank), rtol=1e-5)


def test_parameters_that_only_act_together_are_refused(tank: Plant) -> None:
    both = problem(tank, 1, samples=500)
    both.names[:] = ["ap1", "ap2", "Sp"]  # p = a_p S_p: one too many
    with pytest.raises(UserError, match="do not determine the parameters"):
        identify(both)


def test_coupled_parameters_are_named(tank: Plant) -> None:
    found = identify(problem(tank, 1, samples=1500))
    found.correlation[:] = np.eye(7)
    found.correlation[3, 1] = found.correlation[1, 3] = -0.97
    assert found.coupled(NAMES) == [("ad2", "ap2", -0.97)]


def test_fit_is_perfect_or_that_of_the_mean() -> None:
    y = np.random.default_rng(1).standard_normal((100, 2))
    mean = np.tile(y.mean(axis=0), (100, 1))
    np.testing.assert_allclose(fit(y, y), 100)
    np.testing.assert_allclose(fit(y, mean), 0, atol=1e-9)
    np.testing.assert_allclose(fit(y, (y + mean) / 2), 50)


# ---- on a log ----


def write_log(path: Path, one: Problem) -> Path:
    """The record of a problem as a log, measured in three groups."""
    log = lcm.EventLog(path, "w", overwrite=True)
    plan, role = Plan(samples=len(one.data.y)), lcmtypes.header_t.ROLE_PLANT
    writer, info = Writer(log, plan), plant_info(plan)
    info["plant"] |= {
        "name": "three_tank",
        "states": [{"name": state.name} for state in one.plant.states],
        "inputs": [{"name": "u1"}, {"name": "u2"}],
        "outputs": [{"name": output.name} for output in one.plant.outputs],
        "groups": [{"name": f"tank {i + 1}", "outputs": [i]} for i in range(3)],
    }
    put_info(writer, role, -1, 0, info)
    put_node(writer, 0, 0, 0, np.zeros(2), 0.0)
    for k in range(plan.samples):
        for number, whole, count, values in parts(one.data.u[k]):
            told = lcmtypes.input_t()
            told.header = writer.header("input", role, -1, 0, k)
            told.part, told.parts, told.count, told.value = number, whole, count, values
            writer.put("DSE_INPUT", told)
        for group in range(3):
            seen_ = lcmtypes.measurement_t()
            seen_.header = writer.header("measurement", role, -1, group, k)
            seen_.measured_at, seen_.parts, seen_.count = k, 1, 1
            seen_.valid = [int(k % 50 != 9), *[0] * 31]
            seen_.value = [one.data.y[k, group], *[0.0] * 31]
            writer.put(f"DSE_MEASUREMENT_{group}", seen_)
    log.close()
    return path


@pytest.fixture(scope="session")
def record(native: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    one = problem(Plant("three_tank", native), 1, samples=3000)
    return write_log(tmp_path_factory.mktemp("record") / "prbs.lcm", one)


def test_identify_writes_what_a_scenario_takes(
    dse: Command, library: Path, record: Path, tank: Plant, tmp_path: Path
) -> None:
    import yaml

    done = dse(
        *("design", "identify", record, "--fit", ",".join(NAMES), "--start", "ap1=2.6"),
        *("-o", tmp_path / "out"),
    )
    assert done.code == 0, done.err
    listed = yaml.safe_load((tmp_path / "out" / "parameters.yaml").read_text())
    assert [one["name"] for one in listed] == NAMES
    got = np.array([one["value"] for one in listed])
    assert np.abs(got / truth(tank) - 1).max() < 0.1
    assert (tmp_path / "out" / "identify.png").stat().st_size > 10000
    assert "Fit in percent" in done.out and "+- 95 %" in done.out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--fit", "ap3"], "no parameter is called 'ap3'"),
        (["--fit", "ap1", "--set", "rigg"], "no parameter set is called 'rigg'"),
        (["--fit", "ap1", "--start", "ap1=x"], "'x' is not a number"),
        (["--fit", "ap1", "--x0", "1,2"], "three_tank has 5 states: x1, x2, x3, x5, x4"),
        (["--fit", "ap1", "--train", "1"], "a part is between 0 and 1"),
        (["--fit", "ap1", "--steps", "-1"], "must be 0 or more"),
        (["--fit", ","], "no parameters to identify"),
        (["--fit", "ap1", "--start", "ap1=-1"], "cannot be simulated with the start values"),
    ],
)
def test_identify_refuses_with_a_reason(
    dse: Command, library: Path, record: Path, arguments: list[str], words: str
) -> None:
    done = dse("design", "identify", record, *arguments)
    assert done.code == 2
    assert words in done.err


# ---- observability ----


def test_observability_of_the_tanks_is_that_of_the_spec(dse: Command, library: Path) -> None:
    """6.2.1 at the initial point: rank 5, singular values of unit rows, eigenvalues."""
    done = dse("design", "observability", "ahg-61", "--network", "ekf")
    assert done.code == 0, done.err
    line = next(line for line in done.out.splitlines() if "the initial state" in line)
    assert "5 of 5" in line
    assert "2.78  2.11  1.62  0.39  0.19" in line
    assert "-16.7  -13.3  -9.8  0.0  0.0" in line


def test_a_state_that_no_output_shows_is_named(dse: Command, library: Path) -> None:
    # without recycles nobody upstream sees the last reactor
    scenario = ROOT / "tools" / "tests" / "series.yaml"
    done = dse("design", "observability", scenario)
    assert done.code == 0, done.err
    done = dse("design", "observability", scenario, "--outputs", "y1,y2,y3")
    assert done.code == 1
    assert "not observable at the initial state: the outputs do not show" in done.out
    last = done.out.splitlines()[-1]
    assert "T4" in last and "C4" in last and "T3" not in last


def test_singular_values_of_a_double_integrator() -> None:
    A, C = np.array([[0.0, 2.0], [0.0, 0.0]]), np.array([[1.0, 0.0]])  # noqa: N806
    found = seen(A, C, np.ones(2), ["p", "v"])
    np.testing.assert_allclose(found.singular, [1, 1])
    assert found.rank == 2
    blind = seen(A, C[:, ::-1], np.ones(2), ["p", "v"])
    assert blind.rank == 1 and list(blind.weakest) == ["p"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["ahg-6"], "shipped scenarios that begin so"),
        (["none"], "no scenario file"),
        (["ahg-61", "--network", "ek"], "no network is called 'ek'"),
        (["ahg-61", "--outputs", "y9"], "no output is called 'y9'"),
        (["ahg-61", "--at", "x9=1"], "no state is called 'x9'"),
        (["ahg-61", "--at", "x1=high"], "'high' is not a number"),
    ],
)
def test_observability_refuses_with_a_reason(
    dse: Command, library: Path, arguments: list[str], words: str
) -> None:
    done = dse("design", "observability", *arguments)
    assert done.code == 2
    assert words in done.err


def test_a_whole_name_is_no_beginning_of_another() -> None:
    """cno-pod_free_flow begins like cno-pod_free."""
    assert find("cno-pod_free").stem == "cno-pod_free"
    assert find("ahg-61").stem.startswith("ahg-61_")


def test_observability_of_a_swinging_plant_is_that_of_each_sensor_group(dse: Command) -> None:
    """Floquet multipliers 0.6242 = exp(-0.075 2 pi): the plant without noise is stable."""
    done = dse("design", "observability", "aho-e2")
    assert done.code == 0
    told = done.out
    assert "0, 2, 4" in told
    assert "1, 3, 5" in told
    assert told.count("2 of 2") == 2
    assert "factors 0.6242, 0.6242" in told


def test_a_sensor_group_that_does_not_see_a_state_is_named(dse: Command, tmp_path: Path) -> None:
    scenario = tmp_path / "blind.yaml"
    plant = (
        "plant: {name: linear, linear: {nx: 2, A: [-1, 0, 1, -2], C: [0, 1, 1, 0], groups: [1, 1]}}"
    )
    scenario.write_text(plant + "\nnoise: {process: {scale: [0, 1]}}\n")
    done = dse("design", "observability", scenario)
    assert done.code == 1
    assert "not observable by sensor groups 1: x2" in done.out
    assert "process noise does not reach x1" in done.out


def test_gramian_of_an_integrator_chain_is_its_closed_form() -> None:
    """C = [1 0], A = [0 1; 0 0] over T = 1: [[1, 1/2], [1/2, 1/3]]; discrete: a sum."""
    found = window({"nx": 2, "A": [0, 1, 0, 0], "C": [1, 0]})
    assert found.length == 1
    M = found.gramian(np.array([[1.0, 0.0]]))  # noqa: N806
    assert pytest.approx(np.array([[1, 1 / 2], [1 / 2, 1 / 3]]), rel=1e-5) == M
    sampled = window({"nx": 1, "A": [0.5], "C": [1], "time": "discrete"})
    assert sampled.gramian(np.array([[1.0]]))[0, 0] == pytest.approx(1 + 1 / 4 + 1 / 16 + 1 / 64)


def test_noise_of_a_decaying_state_has_its_closed_form() -> None:
    """X' = -x + w: W = (1 - exp(-2 T)) / 2; discrete x(k+1) = x / 2 + w: a geometric sum."""
    found = window({"nx": 1, "A": [-1], "C": [1]})
    assert found.length == 5
    assert found.excited(np.ones(1))[0, 0] == pytest.approx((1 - np.exp(-10)) / 2, rel=1e-4)
    sampled = window({"nx": 1, "A": [0.5], "C": [1], "time": "discrete"})
    assert sampled.excited(np.ones(1))[0, 0] == pytest.approx(1 + 1 / 4 + 1 / 16 + 1 / 64)
