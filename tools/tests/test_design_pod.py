"""Reduced flow models: the modes, what they are worth, and that the shipped data are these."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from compiled import ROOT
from conftest import Command

from dse.design import pod_checks, pod_emit, pod_model
from dse.design.pod_model import Reduced
from dse.flow import SENSORS, TEST, Flow

GOLDEN = ROOT / "tests" / "golden" / "cavity"
CASES = ("free", "forced")
# a number as the C data and the header of a table have it; digits of a name are none
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w])")


@pytest.fixture(scope="module")
def made(native: Path) -> dict[str, Reduced]:
    """The models of both cases."""
    return {case: pod_model.reduce(Flow(case == "forced", library=native)) for case in CASES}


def golden(case: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((GOLDEN / f"{case}.json").read_text())
    return found


@pytest.mark.parametrize("case", CASES)
def test_eigenvalues_and_energies_are_those_of_an_independent_implementation(
    made: dict[str, Reduced], case: str
) -> None:
    reference = golden(case)
    for basis, field in zip(made[case].bases, "vcT", strict=True):
        wanted = np.array(reference[f"eig_{field}"])
        np.testing.assert_allclose(basis.eigenvalues[: len(wanted)], wanted, rtol=1e-8)
        np.testing.assert_allclose(basis.energy[: len(wanted)], reference[f"energy_{field}"])


def test_the_energies_are_the_published_targets(made: dict[str, Reduced]) -> None:
    # free 99.5 % of velocity, 97.3 % of contaminant, 99.2 % of temperature
    held = [100 * basis.energy[basis.count - 1] for basis in made["free"].bases]
    np.testing.assert_allclose(held, [99.52, 97.26, 99.17], atol=0.005)
    held = [100 * basis.energy[basis.count - 1] for basis in made["forced"].bases]
    np.testing.assert_allclose(held, [99.82, 98.57, 99.15], atol=0.005)


@pytest.mark.parametrize("case", CASES)
def test_coefficients_are_those_of_an_independent_implementation(
    made: dict[str, Reduced], case: str
) -> None:
    reference, model = golden(case), made[case]
    for name in "AdC":
        wanted = np.array(reference[name])
        np.testing.assert_allclose(getattr(model, name), wanted, atol=1e-11)
    F = np.zeros_like(model.F)  # noqa: N806
    for k, i, j, value in reference["F"]:
        F[int(k), int(i), int(j)] = value
    np.testing.assert_allclose(model.F, F, atol=1e-11)


def test_modes_are_orthonormal_and_show_the_first_snapshot_positively(
    made: dict[str, Reduced],
) -> None:
    model = made["forced"]
    for basis, first in zip(model.bases, model.starts[1][[0, 4, 7]], strict=True):
        np.testing.assert_allclose(
            basis.modes @ basis.modes.T / model.flow.n**2, np.eye(basis.count), atol=1e-11
        )
        assert first > 0
    assert np.all(model.starts[1] > 0)


@pytest.mark.parametrize(
    ("case", "rates"), [("free", (-0.369, -0.0656)), ("forced", (-0.382, -0.0531))]
)
def test_both_models_have_the_certificate_of_stability(
    made: dict[str, Reduced], case: str, rates: tuple[float, ...]
) -> None:
    found = pod_checks.certify(made[case])
    assert found.dissipative
    assert found.lossless
    np.testing.assert_allclose([found.rates[0], found.rates[-1]], rates, rtol=2e-3)


@pytest.mark.parametrize(
    ("case", "wanted"), [("free", (0.030, 0.098, 0.047)), ("forced", (0.029, 0.25, 0.050))]
)
def test_the_model_follows_the_flow_as_well_as_published(
    made: dict[str, Reduced], case: str, wanted: tuple[float, ...]
) -> None:
    found, _ = pod_checks.fit(made[case])
    np.testing.assert_allclose(found, wanted, rtol=0.02)


@pytest.mark.parametrize(
    ("case", "wanted"), [("free", (0.33, 0.29, 0.19)), ("forced", (0.20, 0.30, 0.14))]
)
def test_without_the_minus_of_the_convection_the_model_does_not_follow_the_flow(
    made: dict[str, Reduced], case: str, wanted: tuple[float, ...]
) -> None:
    model = made[case]
    turned = Reduced(model.flow, model.bases, model.A, -model.F, model.d, model.C, model.starts)
    np.testing.assert_allclose(pod_checks.fit(turned)[0], wanted, rtol=0.03)


def test_the_eigenvalues_converge_with_the_grid(made: dict[str, Reduced], native: Path) -> None:
    coarse = Flow(n=16, library=native)
    found = [
        pod_model.pod(rows, 1 / 16**2, 1).eigenvalues[0] for rows in pod_model.snapshots(coarse)
    ]
    np.testing.assert_allclose(found, [0.0520, 0.01842, 0.1194], rtol=1e-3)
    fine = [basis.eigenvalues[0] for basis in made["free"].bases]
    np.testing.assert_allclose(fine, [0.0528, 0.01846, 0.1205], rtol=1e-3)


def test_more_modes_follow_the_flow_better(native: Path) -> None:
    found, _ = pod_checks.fit(pod_model.reduce(Flow(library=native), (8, 8, 8)))
    np.testing.assert_allclose(found, [0.028, 0.058, 0.020], rtol=0.03)


def test_one_sensor_sees_the_state_along_the_run_and_hardly_at_rest(
    made: dict[str, Reduced],
) -> None:
    for seen in pod_checks.observability(made["free"]):
        assert seen.rank == 10
        if seen.where == "0":
            assert seen.least < 5e-6
        else:
            assert 1e-3 < seen.least < 0.1


def test_sensors_read_the_mean_of_the_faces_around_a_cell(made: dict[str, Reduced]) -> None:
    model = made["free"]
    x = np.linspace(-1, 1, 10)
    v, c, t = model.fields(x)
    u, w = model.flow.components(v)
    for C, (i, j) in zip(model.C, SENSORS, strict=True):  # noqa: N806
        wanted = (u[i, j] + u[i + 1, j] + w[i, j] + w[i, j + 1]) / 2
        np.testing.assert_allclose(C @ x, [wanted, c[i * 32 + j], t[i * 32 + j]], atol=1e-12)


def test_a_fields_projection_is_its_coefficients(made: dict[str, Reduced]) -> None:
    model = made["free"]
    z = model.flow.start(TEST)
    x = model.project(z)
    back = np.concatenate(
        [b.modes @ f / 32**2 for b, f in zip(model.bases, model.fields(x), strict=True)]
    )
    np.testing.assert_allclose(back, x, atol=1e-12)
    np.testing.assert_allclose(x, golden("free")["projected"][0], atol=1e-11)


# ---- what is written ----


def numbers(text: str) -> list[float]:
    return [float(word) for word in NUMBER.findall(text)]


@pytest.mark.parametrize("case", CASES)
def test_the_shipped_data_are_what_the_command_makes(made: dict[str, Reduced], case: str) -> None:
    for path, text in pod_emit.files(case, made[case], "dse design pod --write .").items():
        shipped = (ROOT / path).read_text()
        assert NUMBER.sub("#", shipped).split() == NUMBER.sub("#", text).split(), path
        # another LAPACK rounds differently; weights of weak modes are large
        np.testing.assert_allclose(numbers(shipped), numbers(text), rtol=1e-8, atol=1e-8)


def test_write_makes_four_files(dse: Command, library: Path, tmp_path: Path) -> None:
    for room in ("lib/plants", "sim"):
        (tmp_path / room).mkdir(parents=True)
    assert dse("design", "pod", "--write", tmp_path).code == 0
    written = sorted(str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*.c"))
    assert written == [
        "lib/plants/cavity_forced_data.c",
        "lib/plants/cavity_free_data.c",
        "sim/flow_weights_forced.c",
        "sim/flow_weights_free.c",
    ]


def test_snapshots_make_the_same_model_when_read_from_a_file(
    dse: Command, library: Path, tmp_path: Path
) -> None:
    file, one, two = tmp_path / "s.npz", tmp_path / "one.yaml", tmp_path / "two.yaml"
    first = dse("design", "pod", "free", "--snapshots", file, "-o", one)
    assert first.code == 0
    for text in ("99.52 %", "97.26 %", "99.17 %", "lossless", "9.82 %", "10 of 10"):
        assert text in first.out
    assert dse("design", "pod", file, "-o", two).code == 0
    assert one.read_text().splitlines()[1:] == two.read_text().splitlines()[1:]


def test_a_model_as_yaml_is_the_model(
    dse: Command, library: Path, made: dict[str, Reduced], tmp_path: Path
) -> None:
    import yaml

    file = tmp_path / "m.yaml"
    assert dse("design", "pod", "forced", "-o", file).code == 0
    found, model = yaml.safe_load(file.read_text()), made["forced"]
    x = np.linspace(-0.3, 0.4, 10)
    rhs = np.array(found["d"]) + np.array(found["A"]) @ x
    for k, i, j, value in found["quadratic"]:
        rhs[k] += value * x[i] * x[j]
    np.testing.assert_allclose(rhs, model.rhs(x), atol=1e-12)
    np.testing.assert_allclose([s["C"] for s in found["sensors"]], model.C)
    assert [tuple(s["cell"]) for s in found["sensors"]] == list(SENSORS)


def test_shares_of_the_energy_choose_the_number_of_modes(
    dse: Command, library: Path, tmp_path: Path
) -> None:
    import yaml

    file = tmp_path / "m.yaml"
    assert dse("design", "pod", "free", "--energy", "0.995,0.9,0.99", "-o", file).code == 0
    assert yaml.safe_load(file.read_text())["modes"] == [4, 2, 3]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["fre"], "free"),
        (["free", "--modes", "4,3"], "three numbers"),
        (["free", "--modes", "4,3,200"], "200 modes"),
    ],
)
def test_mistakes_are_told(dse: Command, library: Path, words: list[str], says: str) -> None:
    outcome = dse("design", "pod", *words)
    assert outcome.code == 2
    assert says in outcome.err


def test_a_file_of_something_else_is_told(dse: Command, library: Path, tmp_path: Path) -> None:
    file = tmp_path / "s.npz"
    np.savez(file, u=np.zeros((3, 9, 8)))
    outcome = dse("design", "pod", file)
    assert outcome.code == 2
    assert "u, v, c and T" in outcome.err
    wide = {"u": np.zeros((3, 9, 8)), "v": np.zeros((3, 8, 9)), "c": np.zeros((3, 8, 8))}
    np.savez(file, **wide, T=np.zeros((3, 9, 8)))
    assert "not on the same cells" in dse("design", "pod", file).err
    np.savez(file, **wide, T=np.zeros((3, 8, 8)))
    assert "do not have the sensors' cells" in dse("design", "pod", file).err
