"""dse design bounds: the theorems' conditions and what makes their bounds grow."""

import math
from pathlib import Path

import pytest
from conftest import Command

from dse.design import theorems
from dse.design.bounds import read
from dse.design.theorems import Result, evaluate

GOOD = read(Path(theorems.__file__).parent / "examples" / "bounds.yaml")
"""Satisfies all six theorems."""


def result(theorem: int, **changed: float) -> Result:
    found = evaluate({**GOOD, **changed})[theorem - 1]
    assert found.theorem.startswith(f"Theorem {theorem}:")
    return found


def bound(theorem: int, **changed: float) -> float:
    found = result(theorem, **changed)
    assert found.satisfied
    (value,) = (v for k, v in found.bounds.items() if k.startswith("eps"))
    return value


# theorem, constant; a ratio of 1.5 keeps all conditions
GROWS = [
    *((3, name) for name in ("Delta", "d_m", "L_w", "phi_w", "phi_v", "L_b", "S_max")),
    *((5, name) for name in ("Delta", "D", "T_m", "d_m", "L_w", "phi_w", "phi_v", "L_b")),
    *((6, name) for name in ("Delta", "L_z", "M", "L_w", "phi_w", "phi_v", "L_b")),
]


@pytest.mark.parametrize(("theorem", "name"), GROWS)
def test_ultimate_bound_grows_with(theorem: int, name: str) -> None:
    values = [
        bound(theorem, **{name: factor * GOOD[name]}) for factor in (0, 1, 1.5)[name == "S_max" :]
    ]
    assert values == sorted(values) and values[0] < values[-1]
    assert all(math.isfinite(value) and value > 0 for value in values)


@pytest.mark.parametrize("theorem", [3, 5, 6])
def test_ultimate_bound_shrinks_with_a_higher_gain_from_below(theorem: int) -> None:
    assert bound(theorem, theta_min=2.0, theta_m=2.0) < bound(theorem, theta_m=2.0)


@pytest.mark.parametrize("name", ["Delta", "D", "T_m"])
def test_older_states_make_the_asymptotic_condition_harder(name: str) -> None:
    near, far = (result(4, **{name: f * GOOD[name]}).conditions[-1] for f in (1, 1.5))
    assert far.limit > near.limit and far.value < near.value


def test_delays_and_losses_count_like_a_longer_interval() -> None:
    assert bound(5) == pytest.approx(bound(3, Delta=0.05), rel=1e-14)
    assert bound(5, D=1, T_m=0) == bound(3)


def test_bounds_are_those_of_the_formulas() -> None:
    # Theorem 3: E = exp(1.5 0.01), c = 0.2/1.5
    E, c = math.exp(0.015), 0.2 / 1.5
    top = 2 * 2 * 0.5 * E * (2 * 10 + 2 * c) + 2 * c * 2 + 4 * 1.5 * 2 * 0.1
    assert bound(3) == pytest.approx(top / (50 - 2 * 2 * 2 * 0.3), rel=1e-14)
    # Theorem 6
    top = 2 * 2 * 1 * 0.5 * (0.05 + 2 * 0.01) * 2 + 2 * 2 * 2 * 0.2 + 4 * 1.5 * 2 * 0.1 + 0.5
    assert bound(6, delta=0.5) == pytest.approx(top / (50 - 2 * 2 * 1.3 * 2), rel=1e-14)
    # Theorem 1: K_1 = 2 sqrt(4) 0.2
    psi = 50 - 2 * 0.8 * 2
    found = list(result(1).bounds.values())
    assert found == pytest.approx([psi, psi**2 / (4 * (2 * 0.1 * 3 * 2) ** 2)], rel=1e-14)
    # Theorem 2
    growth = 2 * 0.5 * E
    left = 2 * growth / (50 - 2 * 2 * 0.3 * 2)
    right = 0.5 * (1 - (3 + 1 + growth) * 0.01) ** 2
    last = result(2).conditions[-1]
    assert (last.value, last.limit) == pytest.approx((right, left), rel=1e-14)


def test_theorem_without_a_positive_denominator_promises_nothing() -> None:
    for theorem in (2, 3, 4, 5):
        found = result(theorem, q=2.4)  # exactly the limit 2 2 0.3 2/1
        assert not found.satisfied and not found.bounds
    assert not result(6, q=10).satisfied and not result(6, q=10).bounds
    assert not result(1, q=3).satisfied


def test_square_does_not_hide_a_negative_bracket() -> None:
    # 1 - 5 H = -4: its square would be larger than the other side
    found = result(2, Delta=1.0)
    assert found.conditions[-1].value > found.conditions[-1].limit
    assert found.conditions[-2].value < 0 and not found.satisfied


def test_constants_beyond_all_reason_do_not_satisfy() -> None:
    found = result(2, L_b=1e5)
    assert not found.satisfied and not found.bounds
    assert bound(3, L_b=1e5, Delta=0.1) == math.inf


def write(path: Path, constants: dict[str, object]) -> Path:
    path.write_text("".join(f"{name}: {value}\n" for name, value in constants.items()))
    return path


def test_command_shows_conditions_bounds_and_what_is_missing(dse: Command, tmp_path: Path) -> None:
    done = dse("design", "bounds", write(tmp_path / "c.yaml", GOOD))
    assert done.code == 0 and "NOT SATISFIED" not in done.out
    assert done.out.count("satisfied") == 6 and "eps_t" in done.out
    weak = dse("design", "bounds", write(tmp_path / "c.yaml", {**GOOD, "q": 2.4}))
    assert weak.code == 0 and weak.out.count("NOT SATISFIED") == 6 and "eps" not in weak.out
    part = {k: v for k, v in GOOD.items() if k not in ("D", "L_z")}
    partly = dse("design", "bounds", write(tmp_path / "c.yaml", part))
    assert "needs D" in partly.out and "needs L_z" in partly.out


@pytest.mark.parametrize(
    ("constants", "told"),
    [
        ({"Lb": 1}, "did you mean L_b"),
        ({"q": "x"}, "'x' is not a number"),
        ({"q": "1e-3"}, "YAML wants a point"),
        ({"q": -1}, "not negative"),
        ({"S_min": 0}, "must be positive"),
        ({"S_min": 3, "S_max": 2}, "larger than S_max"),
        ({"theta_m": 0.5}, "at least 1"),
        ({"q": ".nan"}, "not negative"),
        ({"q": "[1"}, "c.yaml"),
    ],
)
def test_mistakes_in_the_constants_are_told(
    dse: Command, tmp_path: Path, constants: dict[str, object], told: str
) -> None:
    done = dse("design", "bounds", write(tmp_path / "c.yaml", constants))
    assert done.code == 2 and told in done.err and len(done.err.splitlines()) == 1
    assert dse("design", "bounds", tmp_path / "nothing.yaml").code == 2
