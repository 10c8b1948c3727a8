"""dse design uio, functional and luenberger against independent designs, and their refusals."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from conftest import Command
from numpy.typing import NDArray

from dse.design import algebra, descriptor_file, functional_matrices, luenberger, uio_matrices
from dse.design.algebra import Floats, Infeasible
from dse.design.descriptor_file import DescriptorPlant, Node
from dse.errors import UserError

GOLDEN = Path(__file__).parents[2] / "tests" / "golden" / "observer_design"


def golden(name: str) -> Any:  # noqa: ANN401 - a JSON file
    return json.loads((GOLDEN / f"{name}.json").read_text())


def array(value: Any) -> Floats:  # noqa: ANN401 - from a JSON file
    return np.array(value, dtype=float)


def agree(got: Floats, want: Any, tolerance: float, what: str) -> None:  # noqa: ANN401
    wanted = array(want)
    # an empty matrix is [] or [[], []] in JSON
    assert got.size == wanted.size, what
    assert np.abs(got.ravel() - wanted.ravel()).max(initial=0) <= tolerance, what


def plant_of(**matrices: Any) -> DescriptorPlant:  # noqa: ANN401
    """From E, A, B, F, L as lists of rows and nodes as dictionaries."""
    A = array(matrices["A"])
    m, n = A.shape
    F = array(matrices["F"]) if "F" in matrices else np.zeros((m, 0))
    nodes = []
    for one in matrices["nodes"]:
        C = array(one["C"])
        G = array(one["G"]) if "G" in one else np.zeros((len(C), F.shape[1]))
        nodes.append(Node(C, G, {k: array(v) for k, v in one.items() if k not in "CG"}))
    return DescriptorPlant(
        path=Path("plant.yaml"),
        E=array(matrices["E"]) if "E" in matrices else np.eye(n),
        A=A,
        B=array(matrices["B"]) if "B" in matrices else np.zeros((m, 0)),
        F=F,
        L=array(matrices["L"]) if "L" in matrices else np.zeros((0, n)),
        Q=array(matrices["Q"]) if "Q" in matrices else np.eye(n),
        discrete=bool(matrices.get("discrete", False)),
        nodes=nodes,
    )


# ---- unknown inputs ----

PUBLISHED = {  # printed in the thesis: Lambda, TE, L2, H, z(0) - TE x(0)
    0: (-1, [0, 1, 1, 0], [1, -1, 0], [0, 1], -10),
    1: (-1, [0, -1, 1, 0], [-1, 3, -2], [0, -1], -40),
    2: (-1.5, [0, 1, 1.5, 0], [1, 0.75, -1], [0, 1], -140),
    3: (-1, [0, 1, 1, 0], [1, 0, -1], [0, 1], -30),
    4: (-2, [0, 1, 2, 0], [-1, 2, -1], [0, 1], -80),
    5: (-2.5, [0, -1.5, 1, 0], [-1.5, 1.5, -4.75], [0, -1.5], -15),
}


def test_uio_of_the_shipped_plant_has_the_published_and_the_reference_matrices() -> None:
    plant = descriptor_file.load("descriptor_uio", uio_matrices.NODE_KEYS)
    for i, (node, want) in enumerate(zip(plant.nodes, golden("uio_design")["nodes"], strict=True)):
        made = uio_matrices.reduced_order(plant, node)
        renamed = {"Lam": "Lambda", "Pi_U1": "Pi"}
        for key, value in want.items():
            if key not in ("s", "r"):
                agree(made.design[renamed.get(key, key)], value, 1e-10, f"node {i}: {key}")
        Lambda, TE, L2, H, eps = PUBLISHED[i]
        for key, printed in (("Lambda", Lambda), ("TE", TE), ("L2", L2), ("H", H)):
            agree(made.design[key], printed, 1e-12, f"node {i}: published {key}")
        assert made.z0[0] - (made.design["TE"] @ [15, 30, 40, -1])[0] == pytest.approx(eps)


def test_uio_with_unknown_input_in_the_measurements_has_the_reference_matrices() -> None:
    want = golden("uio_design_general")
    given = {key: want[key] for key in ("P", "R", "S", "Q", "Z")}
    node = {"C": want["Cstar"], "G": want["Gstar"], **given}
    plant = plant_of(
        E=want["Estar"], A=want["Astar"], B=want["Bstar"], F=want["Fstar"], nodes=[node]
    )
    made = uio_matrices.reduced_order(plant, plant.nodes[0])
    for key in ("E", "A", "B", "F", "A1", "B1", "C", "G", "C1", "C2", "F11", "F12", "Phi", "M",
                "Delta", "phi", "alpha", "Omega", "Theta", "T", "TE", "N", "H", "L1", "L2",
                "D"):  # fmt: skip
        agree(made.design[key], want[key], 1e-9, key)
    agree(made.Lambda, want["Lam"], 1e-9, "Lambda")
    assert max(made.checks.values()) < 1e-12
    # the default gain is that of the same Riccati equation
    free = plant_of(
        E=want["Estar"], A=want["Astar"], B=want["Bstar"], F=want["Fstar"],
        nodes=[{k: v for k, v in node.items() if k != "Z"}],
    )  # fmt: skip
    agree(uio_matrices.reduced_order(free, free.nodes[0]).design["Z"], want["Z"], 1e-9, "Z")


def test_full_order_uio_has_the_reference_matrices() -> None:
    want = golden("uio_fullorder")
    plant = plant_of(**{k: want[k] for k in "ABF"}, nodes=[{"C": n["C"]} for n in want["nodes"]])
    for i, (node, one) in enumerate(zip(plant.nodes, want["nodes"], strict=True)):
        made = uio_matrices.full_order(plant, node)
        for key in ("J", "P", "K", "Ao", "L", "H"):
            agree(made.design[key], one[key], 1e-9, f"node {i}: {key}")
        agree(made.Pi, one["Pi_U1"], 1e-9, f"node {i}: Pi")


def simulate(
    made: Any,  # noqa: ANN401 - an ObserverNode
    A: NDArray[Any],
    B: NDArray[Any],
    F: NDArray[Any],
    C: NDArray[Any],
    G: NDArray[Any],
) -> float:
    """|xh - x| at the end of x' = A x + B u + F v with u, v at will and the raw y, u."""
    n = A.shape[0]
    state = np.concatenate([np.linspace(1, -1, n), made.z0 + 1])
    h = 0.005

    def signals(t: float, x: Floats) -> tuple[Floats, Floats, Floats]:
        u, v = np.array([np.cos(2 * t), np.sin(t)]), np.array([5 * np.sin(t) + 2])
        return u[: B.shape[1]], v[: F.shape[1]], C @ x + G @ v[: F.shape[1]]

    def f(t: float, s: Floats) -> Floats:
        x, z = s[:n], s[n:]
        u, v, y = signals(t, x)
        dz = made.Lambda @ z + made.L @ y + made.H @ u
        return np.concatenate([A @ x + B @ u + F @ v, dz])

    for k in range(4000):
        t = k * h
        k1 = f(t, state)
        k2 = f(t + h / 2, state + h / 2 * k1)
        k3 = f(t + h / 2, state + h / 2 * k2)
        k4 = f(t + h, state + h * k3)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    u, _, y = signals(4000 * h, state[:n])
    xh = made.M @ state[n:] + made.N @ y + made.J @ u
    return float(np.abs(xh - state[:n]).max())


@pytest.mark.parametrize("order", ["reduced", "full"])
def test_uio_in_raw_signals_forgets_its_start_whatever_the_unknown_input_does(order: str) -> None:
    A = [[-1.0, 1, 0], [-1, -1, 0], [0, -1, -1]]
    B, F, C = [[1.0, 0], [0, 1], [0, 0]], [[-1.0], [0], [0]], [[1.0, 0, 0], [0, 0, 1]]
    plant = plant_of(A=A, B=B, F=F, nodes=[{"C": C}])
    form = uio_matrices.reduced_order if order == "reduced" else uio_matrices.full_order
    made = form(plant, plant.nodes[0])
    assert simulate(made, plant.A, plant.B, plant.F, plant.nodes[0].C, plant.nodes[0].G) < 1e-6


def test_uio_in_raw_signals_takes_the_unknown_input_in_the_measurements() -> None:
    A = [[-1.0, 1, 0], [-1, -1, 0], [0, -1, -1]]
    B, F, C = [[1.0, 0], [0, 1], [0, 0]], [[-1.0], [0], [0]], [[1.0, 0, 0], [0, 0, 1], [0, 1, 0]]
    plant = plant_of(A=A, B=B, F=F, nodes=[{"C": C, "G": [[1.0], [0.5], [0]]}])
    made = uio_matrices.reduced_order(plant, plant.nodes[0])
    assert simulate(made, plant.A, plant.B, plant.F, plant.nodes[0].C, plant.nodes[0].G) < 1e-6


def test_node_that_measures_everything_needs_no_observer() -> None:
    plant = plant_of(A=[[-1, 1], [0, -1]], F=[[1], [0]], nodes=[{"C": [[1, 1], [0, 1]]}])
    made = uio_matrices.reduced_order(plant, plant.nodes[0])
    assert not made.M.any()
    agree(made.N, np.linalg.inv([[1, 1], [0, 1]]), 1e-12, "N")


STILL = [[0.0, 0], [0, -1]]
REFUSED_UIO: dict[str, tuple[dict[str, Any], str]] = {
    "the unknown input does not reach the sensors": (
        dict(A=[[-1, 0], [0, -1]], F=[[1], [0]], nodes=[{"C": [[0, 1]]}]),
        r"rank \[E A F 0.* is 2, needed 3",
    ),
    "two inputs act alike": (
        dict(A=STILL, F=[[1, 2], [0, 0]], nodes=[{"C": [[1, 0], [0, 1]]}]),
        r"rank \[F; G\] is 1, needed 2",
    ),
    "more unknown inputs than sensors": (
        dict(A=STILL, F=[[1, 0], [0, 1]], nodes=[{"C": [[1, 0]]}]),
        "1 measurements for 2 unknown inputs: needed at least 2",
    ),
    "a measurement twice": (
        dict(A=STILL, F=[[1], [0]], nodes=[{"C": [[1, 0], [2, 0]]}]),
        r"rank \[C G\] is 1, needed 2",
    ),
    "an unstable zero": (  # x2 = x1 + v: v can hold y at 0 while x2 grows
        dict(A=[[-1, 1], [0, 1]], F=[[1], [0]], nodes=[{"C": [[1, 0]]}]),
        r"unstable zeros s = 1",
    ),
}


@pytest.mark.parametrize("why", REFUSED_UIO)
def test_uio_that_does_not_exist_is_refused_with_the_rank(why: str) -> None:
    matrices, reason = REFUSED_UIO[why]
    plant = plant_of(**matrices)
    with pytest.raises(Infeasible, match=reason):
        uio_matrices.reduced_order(plant, plant.nodes[0])


def test_given_gain_that_does_not_stabilise_is_refused() -> None:
    plant = descriptor_file.load("descriptor_uio", uio_matrices.NODE_KEYS)
    node = plant.nodes[0]
    node = Node(node.C, node.G, {**node.given, "Z": -node.given["Z"]})
    with pytest.raises(Infeasible, match="the given Z does not make Lambda"):
        uio_matrices.reduced_order(plant, node)


def test_full_order_uio_is_refused_when_an_input_is_not_seen_at_once() -> None:
    plant = plant_of(A=[[-1, 1], [0, -1]], F=[[0], [1]], nodes=[{"C": [[1, 0]]}])
    with pytest.raises(Infeasible, match="rank C F is 0, needed 1"):
        uio_matrices.full_order(plant, plant.nodes[0])


# ---- functionals ----


def test_functional_observer_of_the_shipped_plant_has_the_reference_matrices() -> None:
    plant = descriptor_file.load("descriptor_fo", functional_matrices.NODE_KEYS)
    want = golden("fo_design")
    for i, (node, one) in enumerate(zip(plant.nodes, want["nodes"], strict=True)):
        made = functional_matrices.descriptor(plant, node)
        for key, value in one.items():
            name = {"Pi_U1": "Pi"}.get(key, key)
            got = made.design[name]
            # D = (C L^+)' is r x p; the reference lists it so too
            agree(got, value, 1e-9, f"node {i}: {key}")
        assert max(made.checks.values()) < 1e-12
        agree(made.D, [[1]], 1e-12, f"node {i}: consistent residual zh - W yt")


def test_full_order_functional_observer_has_the_reference_matrices() -> None:
    want = golden("fo_fullorder")
    plant = plant_of(**{k: want[k] for k in "ABL"}, nodes=[{"C": n["C"]} for n in want["nodes"]])
    for i, (node, one) in enumerate(zip(plant.nodes, want["nodes"], strict=True)):
        made = functional_matrices.full_order(plant, node, one["N"][0][0], consistent=False)
        for key in ("F", "G", "Z", "N", "Q", "K", "T", "J", "H"):
            agree(made.design[key], one[key], 1e-9, f"node {i}: {key}")
        agree(made.C2 if made.C2 is not None else np.zeros(0), one["D"], 1e-9, f"node {i}: D'")


def test_full_order_functional_observer_is_refused_with_the_rank() -> None:
    want = golden("fo_fullorder")
    plant = plant_of(**{k: want[k] for k in "ABL"}, nodes=[{"C": want["C_infeasible"]}])
    with pytest.raises(Infeasible, match=r"rank \[L A; C A; C; L\] is 4, needed 3"):
        functional_matrices.full_order(plant, plant.nodes[0])


def test_functional_that_no_sensor_tells_is_refused_with_the_rank() -> None:
    # E = diag(1, 0): the algebraic state x2 enters no equation that a sensor sees
    plant = plant_of(E=[[1, 0], [0, 0]], A=[[-1, 0], [1, 0]], L=[[0, 1]], nodes=[{"C": [[1, 0]]}])
    with pytest.raises(Infeasible, match=r"rank \[E A; 0 E; 0 C; 0 L\] is 3, needed 2"):
        functional_matrices.descriptor(plant, plant.nodes[0])


def test_undetectable_functional_is_refused() -> None:
    plant = plant_of(A=[[-1, 0], [0, 1]], L=[[0, 1]], nodes=[{"C": [[1, 0]]}])
    with pytest.raises(Infeasible, match="s = 1"):
        functional_matrices.full_order(plant, plant.nodes[0])


def test_two_functionals_at_once_get_a_riccati_gain() -> None:
    plant = descriptor_file.load("descriptor_fo", functional_matrices.NODE_KEYS)
    node = Node(plant.nodes[0].C, plant.nodes[0].G, {})
    two = DescriptorPlant(**{**vars(plant), "L": np.array([[0.0, 0, 1, 0], [1, 0, 0, 0]])})
    made = functional_matrices.descriptor(two, node)
    assert made.Lambda.shape == (2, 2) and algebra.is_hurwitz(made.Lambda)
    assert max(made.checks.values()) < 1e-10


def test_common_rows_are_those_in_both_row_spaces() -> None:
    L, Ct = np.array([[1.0, 0, 0], [0, 1, 0]]), np.array([[0.0, 2, 0], [0, 0, 1]])
    Db, W = functional_matrices.common_rows(L, Ct)
    assert Db.shape == (2, 1) and abs(Db[0, 0]) < 1e-12
    np.testing.assert_allclose(W @ Ct, Db.T @ L, atol=1e-12)
    assert functional_matrices.common_rows(L, np.array([[0.0, 0, 1]]))[0].shape == (2, 0)


# ---- constant gains ----


def test_kalman_bucy_gains_have_the_reference_values() -> None:
    want = golden("kf_lti4")
    plant = plant_of(A=want["A"], nodes=[{"C": d["C"], "R": d["R"]} for d in want["design"]])
    for i, (node, one) in enumerate(zip(plant.nodes, want["design"], strict=True)):
        made = luenberger.design(plant, node, None)
        for key, name in (("P", "P"), ("K", "K"), ("Pi_U_eye", "Pi"), ("D_U_eye", "D")):
            agree(made.design[name], one[key], 1e-9, f"node {i}: {key}")


def test_discrete_luenberger_gains_have_the_reference_values() -> None:
    want = golden("luenberger_lti")
    plant = plant_of(A=want["A"], discrete=True, nodes=[{"C": [[1, 0]]}, {"C": [[0, 1]]}])
    for node, L, D in zip(plant.nodes, want["L"], want["D"], strict=True):
        made = luenberger.design(plant, node, [0.95, 0.93])
        agree(made.design["K"], L, 1e-9, "L")
        agree(made.design["D"], D, 1e-9, "D")
    target = want["rotating_target"]
    plant = plant_of(A=target["A"], discrete=True, nodes=[{"C": target["C"]}])
    made = luenberger.design(plant, plant.nodes[0], [complex(p) for p in target["poles"]])
    agree(made.design["K"], target["L"], 1e-9, "rotating target")


def test_discrete_kalman_gain_solves_its_riccati_equation() -> None:
    A, C = [[0.9, 0.2], [0, 0.7]], [[1.0, 0]]
    plant = plant_of(A=A, discrete=True, nodes=[{"C": C, "R": [[0.5]]}])
    made = luenberger.design(plant, plant.nodes[0], None)
    P = np.eye(2)
    for _ in range(500):  # the filter's own recursion ends there
        K = plant.A @ P @ array(C).T / (0.5 + P[0, 0])
        P = plant.A @ P @ plant.A.T - K @ array(C) @ P @ plant.A.T + np.eye(2)
    agree(made.design["P"], P, 1e-10, "P")
    agree(made.design["K"], K, 1e-10, "K")


def test_gains_that_do_not_exist_are_refused() -> None:
    plant = plant_of(A=[[1, 0], [0, -1]], nodes=[{"C": [[0, 1]]}])
    with pytest.raises(Infeasible, match="not detectable: the modes 1"):
        luenberger.design(plant, plant.nodes[0], None)
    with pytest.raises(Infeasible, match="rank 1, needed 2"):
        luenberger.design(plant, plant.nodes[0], [-1, -2])
    with pytest.raises(Infeasible, match="2 eigenvalues are to be placed, 1 are given"):
        luenberger.design(plant, plant.nodes[0], [-1])
    discrete = plant_of(A=[[0.5, 1], [0, 0.5]], discrete=True, nodes=[{"C": [[1, 0]]}])
    with pytest.raises(Infeasible, match="rank 1, needed 2: no eigenvalue may be 0"):
        luenberger.design(discrete, discrete.nodes[0], [0, 0.5])


# ---- the commands ----


def section(text: str) -> dict[str, Any]:
    found = yaml.safe_load(text)["distributed_observer"]
    assert isinstance(found, dict)
    return found


def test_section_has_flat_matrices_of_the_sizes_that_it_says(dse: Command) -> None:
    made = section(dse("design", "uio", "descriptor_uio").out)
    assert (made["residual"], made["gain"], made["gamma"]) == ("neighbours", "edge", 0.01)
    sizes = {"Lambda": 1, "L": 2, "H": 2, "M": 4, "N": 8, "J": 8, "z0": 1, "Pi": 1, "C2": 12}
    for node in made["nodes"]:
        assert {key: len(value) for key, value in node.items()} == sizes
        assert all(isinstance(x, float) for value in node.values() for x in value)


def test_law_decides_which_matrices_are_written(dse: Command) -> None:
    printed = section(dse("design", "uio", "descriptor_uio", "--law", "printed").out)
    assert printed["residual"] == "own"
    assert "C2" not in printed["nodes"][0] and len(printed["nodes"][0]["D"]) == 3
    made = dse("design", "uio", "descriptor_uio", "--law=projected", "--leak=0.01", "--gain=node")
    projected = section(made.out)
    assert len(projected["nodes"][0]["C2"]) == 12
    assert (projected["leak"], projected["gain"]) == (0.01, "node")
    consistent = section(dse("design", "functional", "descriptor_fo").out)
    assert [node["C2"] for node in consistent["nodes"]] == [[1.0]] * 4
    printed = section(dse("design", "functional", "descriptor_fo", "--law=printed").out)
    assert [node["C2"] for node in printed["nodes"]] == [[0, 1], [1, 0], [0, 1], [1, 0]]


def test_refusal_names_file_node_and_rank(dse: Command, tmp_path: Path) -> None:
    path = tmp_path / "blind.yaml"
    path.write_text("A: [[-1, 0], [0, -1]]\nF: [[1], [0]]\nnodes: [{C: [[1, 0]]}, {C: [[0, 1]]}]\n")
    result = dse("design", "uio", path)
    assert result.code == 2
    assert "blind.yaml: node 1: no such observer: rank [E A F 0" in result.err
    assert "is 2, needed 3" in result.err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("A: [[1, 2]]\nnodes: [{C: [[1, 0]]}]", "without E it must be square"),
        ("A: [[1]]\nnodes: [{C: [[1, 0]]}]", "nodes[0].C has 2 columns, needed 1"),
        ("A: [[1]]\nB: [[1], [2]]\nnodes: [{C: [[1]]}]", "B has 2 rows, needed 1"),
        ("A: [[1]]\nnodes: []", "nodes: must be a list"),
        ("A: [[1]]\nnodes: [{G: [[1]]}]", "nodes[0]: must have a matrix C"),
        ("A: [[1]]\nnodes: [{C: [[1]], Zz: 1}]", "no key is called 'Zz'"),
        ("A: [[1]]\nK: [[1]]\nnodes: [{C: [[1]]}]", "no key of a plant is called 'K'"),
        ("A: [[1, 2], [3]]\nnodes: [{C: [[1]]}]", "A: must be numbers in rows of equal length"),
        ("A: [[.nan]]\nnodes: [{C: [[1]]}]", "A: has entries that are not finite"),
        ("A: [[1]]\nnodes: [{C: [[1]], guess: [1, 2]}]", "guess has 2 values"),
    ],
)
def test_plant_file_that_is_wrong_says_where(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "plant.yaml"
    path.write_text(text)
    with pytest.raises(UserError, match="plant.yaml") as caught:
        descriptor_file.load(str(path), uio_matrices.NODE_KEYS)
    assert message in str(caught.value)
