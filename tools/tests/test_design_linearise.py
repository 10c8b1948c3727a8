"""Shipped plants around their steady states, against reference data and by their own equations."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from compiled import COMPILER, ROOT
from conftest import Command

from dse.design.linearise import linearise, steady_state
from dse.errors import UserError
from dse.plants import Plant

pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler")

CASES = {"sep3": ("sep3", None), "cstr2_cdm": ("cstr2", "cdm")}


def reference(case: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((ROOT / f"tests/golden/plants/{case}.json").read_text())
    return found


def observability(A: np.ndarray, C: np.ndarray) -> np.ndarray:  # noqa: N803
    """Singular values of [C; CA; ..; CA^(n-1)]."""
    rows = [C @ np.linalg.matrix_power(A, k) for k in range(len(A))]
    return np.linalg.svd(np.vstack(rows), compute_uv=False)


@pytest.mark.parametrize("case", CASES)
def test_the_steady_state_and_its_matrix_are_those_of_the_reference(
    case: str, library: Path
) -> None:
    name, chosen = CASES[case]
    plant, want = Plant(name), reference(case)
    one = plant.set(chosen)
    rest = steady_state(plant, one.values, plant.nominal_inputs, one.x0)
    np.testing.assert_allclose(rest, want["steady_state"], rtol=1e-12)
    found = linearise(plant, one.values, plant.nominal_inputs, rest, want["dt_h"])
    np.testing.assert_allclose(found.jacobian, want["Ac"], rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(found.A, want["A"], rtol=1e-10, atol=1e-13)


def test_eigenvalues_and_observability_are_those_of_the_source(library: Path) -> None:
    """As the specification prints them: continuous, discrete, singular values by subsystem."""
    plant = Plant("sep3")
    one = plant.set()
    rest = steady_state(plant, one.values, plant.nominal_inputs, one.x0)
    found = linearise(plant, one.values, plant.nominal_inputs, rest, 0.005)
    poles = np.sort(np.linalg.eigvals(found.jacobian).real)
    printed = [-181.5, -82.8, -44.4, -31.7, -31.7, -22.3, -22.3, -8.13, -5.09]
    np.testing.assert_allclose(poles, printed, rtol=3e-3)
    moduli = np.sort(np.abs(np.linalg.eigvals(found.A)))
    pairs = [abs(0.8529 + 0.0257j)] * 2 + [abs(0.8933 + 0.0435j)] * 2
    np.testing.assert_allclose(moduli, [0.4036, 0.6610, 0.8010, *pairs, 0.9602, 0.9749], rtol=2e-4)
    seen = [(63.8, 1.31, 0.94), (24.6, 1.05, 0.128), (1.98, 0.744, 0.0314)]
    for i, want in enumerate(seen):
        block = slice(3 * i, 3 * i + 3)
        own = observability(found.A[block, block], np.array([[0.0, 0.0, 1.0]]))
        np.testing.assert_allclose(own, want, rtol=6e-3)

    plant = Plant("cstr2")
    one = plant.set("cdm")
    rest = steady_state(plant, one.values, plant.nominal_inputs, one.x0)
    found = linearise(plant, one.values, plant.nominal_inputs, rest, 0.005)
    poles = np.sort(np.linalg.eigvals(found.jacobian).real)
    np.testing.assert_allclose(poles, [-54.8, -54.6, -8.51, -8.31], rtol=2e-3)
    singular = observability(found.A, found.C)
    np.testing.assert_allclose(singular, [1.91, 1.44, 0.0140, 0.0092], rtol=6e-3)


def test_the_section_is_a_plant_that_moves_like_the_nonlinear_one(
    library: Path, tmp_path: Path, dse: Command
) -> None:
    target = tmp_path / "plant.yaml"
    assert dse("design", "linearise", "sep3", "--period", "18", "-o", target).code == 0
    about = yaml.safe_load(target.read_text())["plant"]["linear"]
    assert (about["time"], about["unit_s"], about["nx"]) == ("discrete", 3600.0, 9)
    assert about["groups"] == [1, 1, 1] and about["blocks"] == [3, 3, 3]
    assert about["states"][:3] == ["xA1", "xB1", "T1"]
    A, C = (np.array(about[key], dtype=float).reshape(-1, 9) for key in "AC")  # noqa: N806
    np.testing.assert_allclose(A, reference("sep3")["A"], rtol=1e-10, atol=1e-13)
    np.testing.assert_array_equal(C, np.eye(9)[[2, 5, 8]])
    origin = np.array(about["origin"], dtype=float)

    plant = Plant("sep3")
    one, u = plant.set(), np.tile(plant.nominal_inputs, (10, 1))
    small = 1e-4 * np.array([state.scale for state in plant.states])
    moved = plant.simulate(one.values, origin + small, u, 0.005, 20)[0]
    linear = small
    for x in moved:
        np.testing.assert_allclose(x - origin, linear, atol=1e-3 * np.abs(small).max())
        linear = A @ linear


def test_without_a_period_the_matrix_is_the_jacobian(library: Path, dse: Command) -> None:
    done = dse("design", "linearise", "cstr2", "--set", "cdm", "--at", "T1=310,C2=2")
    about = yaml.safe_load(done.out)["plant"]["linear"]
    assert about["time"] == "continuous"
    assert about["origin"][0] == 310 and about["origin"][3] == 2
    plant = Plant("cstr2")
    jacobian = plant.evaluate(
        "dfdx", plant.set("cdm").values, np.array(about["origin"]), plant.nominal_inputs
    )
    np.testing.assert_array_equal(np.array(about["A"], float).reshape(4, 4), jacobian)


def test_a_plant_without_a_steady_state_is_told(library: Path) -> None:
    plant = Plant("descriptor_uio")  # E x' = .. has rows without a derivative
    with pytest.raises(UserError, match="no steady state"):
        steady_state(plant, plant.set().values, plant.nominal_inputs, plant.set().x0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("sep33",), "did you mean sep3"),
        (("sep3", "--set", "x"), "x"),
        (("sep3", "--at", "T9=1"), "T9"),
        (("sep3", "--at", "T1=warm"), "'warm' is not a number"),
        (("sep3", "--inputs", "1,2"), "has 3 inputs, not 2"),
        (("sep3", "--period", "0"), "must be positive"),
    ],
)
def test_what_cannot_be_is_refused(
    arguments: tuple[str, ...], words: str, library: Path, dse: Command
) -> None:
    done = dse("design", "linearise", *arguments)
    assert done.code == 2 and words in done.err
