"""Certificates of coordinated moving horizon estimation, against reference data and the tables."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from compiled import COMPILER, ROOT
from conftest import Command

from dse.design.certificates import certify, dual_hessian, iteration_map, radius
from dse.design.window import Model, Window, window
from dse.errors import UserError

GOLDEN = ROOT / "tests" / "golden"
CERTIFICATES = json.loads(Path(__file__).with_name("coordinated_mhe_certificates.json").read_text())
NAMES = ["xA1", "xB1", "T1", "xA2", "xB2", "T2", "xA3", "xB3", "T3"]
SQRT_Q = [0.82, 0.1, 0.8, 0.52, 0.8, 1.2, 0.2, 0.1, 0.3]

WEIGHTS: dict[str, dict[str, Any]] = {
    "SEP3_pred": {"Q": np.square(SQRT_Q), "R": np.ones(3), "D": np.ones(9)},
    "SEP3_price": {"Q": np.array([1e-6, 1e-6, 1e-2] * 3), "R": np.full(3, 1e-4), "D": np.ones(9)},
    "CSTR2": {"Q": np.array([0.6**2, 0.98**2] * 2), "R": np.full(2, 0.8**2), "D": np.ones(4)},
}


def model(name: str) -> Model:
    parts, case = (3, "sep3") if name.startswith("SEP3") else (2, "cstr2_cdm")
    plant = json.loads((GOLDEN / "plants" / f"{case}.json").read_text())
    A = np.array(plant["A"])  # noqa: N806
    C = np.eye(9)[[2, 5, 8]] if parts == 3 else np.eye(4)[[0, 2]]  # noqa: N806
    names = NAMES if parts == 3 else []
    return Model(A, C, [len(A) // parts] * parts, [1] * parts, names=names, **WEIGHTS[name])


def write(path: Path, name: str, longest: int, shortest: int, **changes: Any) -> Path:  # noqa: ANN401
    """The model as a file of plain matrices."""
    m = model(name)
    about: dict[str, Any] = {"A": m.A.tolist(), "C": m.C.tolist(), "blocks": m.states}
    about |= {"states": list(m.names), "Q": m.Q.tolist(), "R": m.R.tolist()}
    about |= {"Hp": longest, "Hmin": shortest}
    path.write_text(yaml.safe_dump(about | changes))
    return path


def test_stacked_matrices_are_those_of_the_reference() -> None:
    want = json.loads((GOLDEN / "coordinated_mhe" / "matrices.json").read_text())["CSTR2_H3"]
    w = window(model("CSTR2"), 3)
    found = {"GA": w.G_A, "Gb": w.Gb, "Th": w.Th, "CRC": w.M_C, "Psi": w.Psi, "Om": w.Omega}
    assert {"GA", "Psi"} <= want.keys()
    for key in found.keys() & want.keys():
        np.testing.assert_allclose(found[key], want[key], rtol=1e-10, atol=1e-12, err_msg=key)
    if "H0_price" in want:
        np.testing.assert_allclose(dual_hessian(w)[1], want["H0_price"], rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("name", WEIGHTS)
def test_certificates_are_those_of_the_reference(name: str) -> None:
    for text, want in CERTIFICATES[name].items():
        if int(text) > 10:  # the longest ones below, on rho_L alone
            continue
        one = certify(window(model(name), int(text)))
        assert one.exists and all(one.exists_local)
        close = {"rel": 1e-6}
        assert min(one.min_eig_Omega) == pytest.approx(want["min_eig_Om"], **close)
        assert one.min_eig_Psi == pytest.approx(want["min_eig_Psi"], **close)
        assert one.min_eig_test == pytest.approx(want["min_eig_test"], **close)
        # windows of three samples have double eigenvalues: below
        if int(text) > 3:
            assert one.rho_literal == pytest.approx(want["rho_literal"], **close)
        assert one.rho_consistent == pytest.approx(want["rho_consistent"], **close)
        assert one.dual_range is not None and one.cond_Hd is not None
        low, high = want["price_H0_min"], want["price_H0_max"]
        assert one.dual_range == pytest.approx((low, high), **close)
        assert one.cond_Hd == pytest.approx(low / high, **close)


@pytest.mark.parametrize(
    ("name", "want"),
    [
        ("SEP3_pred", 0.511713243661),
        ("SEP3_price", 0.511713243661),
        ("CSTR2", abs(0.10759508885 + 5.68633808558e-5j)),
    ],
)
def test_rho_of_the_shortest_windows_is_near_its_exact_value(name: str, want: float) -> None:
    """Eigenvalues by arithmetic of 60 digits: they are double, or nearly so.

    In double precision they scatter; the reference has 0.514068 for SEP3_price.
    """
    assert certify(window(model(name), 3)).rho_literal == pytest.approx(want, rel=2e-4)


TABLE = {
    "SEP3_pred": {3: 0.512, 4: 0.520, 6: 0.557, 12: 0.736, 25: 1.006},
    "SEP3_price": {4: 0.551, 6: 0.599, 12: 0.678, 25: 1.054},
    "CSTR2": {3: 0.108, 4: 0.124, 6: 0.237, 12: 0.468, 20: 0.528, 25: 0.526},
}


@pytest.mark.parametrize("name", TABLE)
def test_rho_is_that_of_the_table_for_every_horizon(name: str) -> None:
    for H, want in TABLE[name].items():  # noqa: N806
        found = certify(window(model(name), H)).rho_literal
        assert found == pytest.approx(want, abs=6e-4), H


@pytest.mark.parametrize(("name", "want"), [("SEP3_pred", 0.672), ("CSTR2", 0.411)])
def test_rho_is_proportional_to_the_coupling(name: str, want: float) -> None:
    for gamma in (0.25, 1.0, 1.4):
        one = certify(window(model(name).coupled(gamma), 10))
        assert one.rho_literal == pytest.approx(gamma * want, rel=1e-3)
        assert gamma * one.admissible_coupling == pytest.approx(1 / want, rel=1e-3)
    assert certify(window(model(name).coupled(0), 10)).rho_literal < 1e-6


def test_the_certificate_is_the_rate_of_the_iteration_that_agents_run() -> None:
    """Algorithm 2 with the agents' own W, from the local problems, not from the closed form."""
    w = window(model("SEP3_pred"), 5)
    generator = np.random.default_rng(3)
    X, W = generator.standard_normal(w.x_of.size), generator.standard_normal(w.w_of.size)  # noqa: N806
    changes = []
    for _ in range(400):
        h, p, old = -w.Th @ X, W / w.q, X
        X = np.linalg.solve(w.Omega, w.Gb.T @ (h / w.q) - w.Th.T @ p)  # noqa: N806
        W = w.Gb @ X - h  # noqa: N806
        changes.append(np.linalg.norm(X - old))
    rate = (changes[-1] / changes[-201]) ** (1 / 200)
    assert rate == pytest.approx(certify(w).rho_literal, rel=5e-3)


def place(w: Window, name: str, at: int) -> list[int]:
    return [int(w.x_of[at, NAMES.index(name)])]


def test_an_active_bound_changes_the_certificate_as_in_the_reference() -> None:
    """Windows of the reference with the oldest xA3 at zero; and with nothing active."""
    full, early = window(model("SEP3_pred"), 10), window(model("SEP3_pred"), 5)
    assert radius(iteration_map(full, [])) == pytest.approx(0.6719657960449471, rel=1e-8)
    assert radius(iteration_map(early, [])) == pytest.approx(0.5349551219912949, rel=1e-8)
    one = radius(iteration_map(full, place(full, "xA3", 0)))
    assert one == pytest.approx(3.3105665265194606, rel=1e-7)
    one = radius(iteration_map(early, place(early, "xA3", 0)))
    assert one == pytest.approx(1.1581910953232546, rel=1e-7)


def test_single_active_bounds_have_the_ranges_of_the_source() -> None:
    w = window(model("SEP3_pred"), 10)
    ranges = {"xA3": (2.5, 3.4), "xB1": (1.13, 1.21), "xA1": (0.67, 1.00)}
    for name, (low, high) in ranges.items():
        found = [radius(iteration_map(w, place(w, name, at))) for at in (0, 3, 6, 9)]
        assert low - 0.06 <= min(found) and max(found) <= high + 0.06, (name, found)
    # bounds of disturbances do no harm
    found = [radius(iteration_map(w, [], [int(w.w_of[at, j])])) for at in (0, 8) for j in (0, 2, 6)]
    assert 0.6 <= min(found) and max(found) <= 0.69


def test_a_bound_on_every_state_leaves_nothing_to_iterate_on() -> None:
    w = window(model("CSTR2"), 3)
    found = iteration_map(w, list(range(w.x_of.size)))
    assert np.abs(found[: w.w_of.size]).max() < 1e-12  # interactions stand still


def test_an_arrival_cost_stands_on_the_oldest_states() -> None:
    bare, weighted = model("CSTR2"), model("CSTR2")
    weighted.arrival = np.array([1.0, 2.0, 3.0, 4.0])
    more = window(weighted, 4).Psi - window(bare, 4).Psi
    assert np.count_nonzero(more) == 4
    np.testing.assert_array_equal(more[[0, 1, 8, 9], [0, 1, 8, 9]], [1, 2, 3, 4])


def test_relaxation_tames_what_swings() -> None:
    """The rate of z <- (1 - beta) z + beta T z, T swinging and growing by itself."""
    w = window(model("CSTR2").coupled(7), 5)
    T, one = iteration_map(w), certify(w, 0.5)  # noqa: N806
    assert one.rho_literal > 1.2
    z = np.random.default_rng(5).standard_normal(len(T))
    norms = []
    for _ in range(400):
        z = 0.5 * z + 0.5 * T @ z
        norms.append(np.linalg.norm(z))
    rate = (norms[-1] / norms[-201]) ** (1 / 200)
    assert rate < 1 and one.rho_relaxed == pytest.approx(rate, rel=5e-3)


# ---- the command ----


def test_a_sound_network_passes(tmp_path: Path, dse: Command) -> None:
    target = tmp_path / "out.yaml"
    file = write(tmp_path / "cstr2.yaml", "CSTR2", 5, 2, D=[1.0] * 4)
    done = dse("design", "mhe-check", file, "-o", target)
    assert done.code == 0, done.out + done.err
    assert "WARNING" not in done.out
    windows = yaml.safe_load(target.read_text())["cstr2"]["windows"]
    assert [one["H"] for one in windows] == [2, 3, 4, 5]
    want = CERTIFICATES["CSTR2"]["5"]["rho_literal"]
    assert windows[-1]["rho_literal"] == pytest.approx(want, rel=1e-6)
    assert windows[-1]["cond_Hd"] > 1


def test_a_network_that_diverges_is_told_with_its_numbers(tmp_path: Path, dse: Command) -> None:
    file = write(tmp_path / "sep3.yaml", "SEP3_pred", 10, 3)
    done = dse("design", "mhe-check", file, "--horizons", "10", "--coupling", "1.6")
    assert done.code == 1
    assert "H = 10: rho_L = 1.075 is not below 1" in done.out
    assert "below 1.488 times" in done.out
    assert dse("design", "mhe-check", file, "--horizons", "10", "--coupling", "1.4").code == 0


def test_too_short_a_window_does_not_exist(tmp_path: Path, dse: Command) -> None:
    file = write(tmp_path / "sep3.yaml", "SEP3_pred", 3, 2)
    done = dse("design", "mhe-check", file)
    assert done.code == 1
    assert "H = 2: subsystem 1 is not observable from its own outputs" in done.out
    assert "H = 3: subsystem" not in done.out


def test_too_large_a_weight_on_interactions_is_told(tmp_path: Path, dse: Command) -> None:
    file = write(tmp_path / "sep3.yaml", "SEP3_price", 4, 4, D=[1e8] * 9)
    done = dse("design", "mhe-check", file)
    assert done.code == 1 and "the dual's condition number is" in done.out


def test_active_bounds_are_tried_by_name(tmp_path: Path, dse: Command) -> None:
    file = write(tmp_path / "sep3.yaml", "SEP3_pred", 10, 10)
    done = dse("design", "mhe-check", file, "--active", "xA3@0")
    assert done.code == 1 and "with xA3@0 at a bound rho is up to 3.311" in done.out
    done = dse("design", "mhe-check", file, "--active", "w:xA3@0,w:T1@3")
    assert done.code == 0, done.out
    file = write(tmp_path / "cstr2.yaml", "CSTR2", 3, 3)
    done = dse("design", "mhe-check", file, "--active", "each")
    assert [f"x{j}" in done.out for j in (1, 2, 3, 4)] == [True] * 4


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"Q": [1.0] * 8}, "Q is (8,), must be (9,)"),
        ({"Q": [0.0] * 9}, "variances must be positive"),
        ({"R": [float("nan")] * 3}, "not finite"),
        ({"blocks": [3, 3]}, "do not make up"),
        ({"groups": [2, 1, 0]}, "an output sees states of another subsystem"),
        ({"Hmin": 11}, "not in order"),
        ({"A": [[1.0]]}, "Q is (9,), must be (1,)"),
        ({"A": [1.0, 2.0]}, "cannot be understood"),
        ({"Hp": None}, "cannot be understood"),
    ],
)
def test_what_does_not_fit_is_refused(
    changes: dict[str, Any], words: str, tmp_path: Path, dse: Command
) -> None:
    done = dse("design", "mhe-check", write(tmp_path / "x.yaml", "SEP3_pred", 10, 3, **changes))
    assert done.code == 2 and words in done.err, done.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--network", "y"), "y"),
        (("--horizons", "1"), "two samples at least"),
        (("--horizons", "a"), "not whole numbers"),
        (("--active", "xA3"), "must be STATE@PLACE"),
        (("--active", "xA9@0"), "xA9"),
        (("--active", "xA3@3"), "places are 0 to 2"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(
    arguments: tuple[str, ...], words: str, tmp_path: Path, dse: Command
) -> None:
    done = dse("design", "mhe-check", write(tmp_path / "x.yaml", "SEP3_pred", 3, 3), *arguments)
    assert done.code == 2 and words in done.err, done.err


SCENARIO = """
name: two
time: {{period_s: 18, duration_s: 180}}
plant:
  {plant}
networks:
  - name: coordinated
    guess: [1, 1, 1, 1]
    coordinated_mhe: &section {{scheme: prediction, Hp: 10, Hmin: 2, {origin}
      Q: [0.36, 0.9604, 0.36, 0.9604], R: [0.64, 0.64]}}
  - name: alone
    guess: [1, 1, 1, 1]
    coordinated_mhe: {{<<: *section, scheme: decentralised}}
"""


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
def test_a_scenario_is_checked_about_its_linear_or_nonlinear_plant(
    tmp_path: Path, dse: Command, library: Path
) -> None:
    plant = json.loads((GOLDEN / "plants" / "cstr2_cdm.json").read_text())
    flat = ", ".join(repr(float(v)) for row in plant["A"] for v in row).replace("e-", ".0e-")
    flat = ", ".join(
        text if text.count(".") < 2 else text.replace(".0e", "e") for text in flat.split(", ")
    )
    linear = (
        f"name: linear\n  linear: {{time: discrete, nx: 4, A: [{flat}],"
        " C: [1, 0, 0, 0, 0, 0, 1, 0], groups: [1, 1], blocks: [2, 2]}"
    )
    origin = f"origin: {plant['steady_state']},"
    texts = {
        "linear": SCENARIO.format(plant=linear, origin=""),
        "nonlinear": SCENARIO.format(plant="name: cstr2\n  set: cdm", origin=origin),
    }
    for name, text in texts.items():
        file, target = tmp_path / f"{name}.yaml", tmp_path / f"{name}.out"
        file.write_text(text)
        done = dse("design", "mhe-check", file, "--horizons", "10", "-o", target)
        assert done.code == 0, done.out + done.err
        assert "coordinated, alone" in done.out  # the same windows, shown once
        found = yaml.safe_load(target.read_text())["coordinated, alone"]["windows"]
        assert found[0]["rho_literal"] == pytest.approx(
            CERTIFICATES["CSTR2"]["10"]["rho_literal"], rel=1e-6
        )


def test_prices_without_a_weight_on_interactions_are_singular(tmp_path: Path, dse: Command) -> None:
    """The source's window of 10 samples has rank 91 of 111 in each subsystem."""
    done = dse(
        "design", "mhe-check", write(tmp_path / "x.yaml", "SEP3_price", 10, 10, scheme="price")
    )
    assert done.code == 1
    assert "H = 10: price-driven without D: the local problems are singular" in done.out
    assert "lack 20, 20, 20 ranks" in done.out


def test_a_scenario_without_such_a_network_is_refused(dse: Command) -> None:
    done = dse("design", "mhe-check", "ahg-43")
    assert done.code == 2 and "no network has a section coordinated_mhe" in done.err


def test_a_wrong_model_names_its_part() -> None:
    wrong = model("CSTR2")
    wrong.D = np.array([1.0, -1.0, 1.0, 1.0])
    with pytest.raises(UserError, match="D: variances must be positive"):
        wrong.check()
