"""Conditions and ultimate bounds of the high-gain theorems, from constants.

Section 4.8 of the specification; equation numbers are the source's. V = sum eps_i' S_i eps_i is the
Lyapunov function, S_min I <= S_i <= S_max I (the source's delta or alpha, min and max).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

Constants = Mapping[str, float]

MEANINGS = {
    "n": "states of the whole plant",
    "n_y": "subsystems",
    "n_star": "states of the largest subsystem",
    "q": "smallest eigenvalue of all Q_i",
    "R_min": "smallest R_i",
    "theta_m": "half of the largest theta",
    "theta_min": "smallest theta (default 1)",
    "S_min": "lower bound of all S_i = P_i^-1",
    "S_max": "upper bound of all S_i",
    "L_b": "Lipschitz constant of b in z",
    "L_b_star": "largest norm of the Jacobians b_i*",
    "db_dz": "largest norm of db_i/dz_j, j /= i (Theorem 1)",
    "K_2": "Lipschitz constant of the Jacobians as Lemma 2 combines it (Theorem 1)",
    "Delta": "time between exchanges, or between checks of the trigger",
    "D": "largest accepted delay, in exchanges",
    "T_m": "most losses in a row, in exchanges",
    "d_m": "diameter of the set of states",
    "L_w": "Lipschitz constant of b in the process noise",
    "phi_w": "bound of the process noise",
    "phi_v": "bound of the measurement noise",
    "L_z": "largest trigger threshold",
    "M": "largest norm of z_i'",
    "delta": "small positive constant of Theorem 6 (default 0)",
}
"""Constants, in units of the plant's time and of the coordinates z."""
DEFAULTS = {"theta_min": 1.0, "delta": 0.0}


@dataclass
class Condition:
    """value > limit is what the theorem asks for."""

    what: str
    value: float
    limit: float

    @property
    def satisfied(self) -> bool:
        """NaN counts as not satisfied."""
        return bool(self.value > self.limit)


@dataclass
class Result:
    """What a theorem says for the given constants."""

    theorem: str
    conditions: list[Condition] = field(default_factory=list)
    bounds: dict[str, float] = field(default_factory=dict)
    """Only what holds under the conditions."""
    missing: list[str] = field(default_factory=list)
    """Constants that it needs and that are not given."""

    @property
    def satisfied(self) -> bool:
        """All conditions hold."""
        return not self.missing and all(one.satisfied for one in self.conditions)


def evaluate(constants: Constants) -> list[Result]:
    """All theorems, each as far as its constants are there."""
    given = {**DEFAULTS, **constants}
    results = []
    for title, needs, compute in THEOREMS:
        missing = [name for name in needs.split() if name not in given]
        if missing:
            results.append(Result(title, missing=missing))
            continue
        conditions, bounds = compute(given)
        result = Result(title, conditions)
        # a bound with a denominator that is not positive is no bound
        result.bounds = bounds if result.satisfied else {}
        results.append(result)
    return results


def _exp(exponent: float) -> float:
    with np.errstate(over="ignore"):
        return float(np.exp(exponent))


def _ratio(numerator: float, denominator: float) -> float:
    return numerator / denominator if denominator > 0 else float("nan")


Computed = tuple[list[Condition], dict[str, float]]


def _exponential(c: Constants) -> Computed:
    """Theorem 1: exponential convergence with continuous communication (2.47-2.50, 2.53)."""
    ratio = c["S_max"] / c["S_min"]
    K_1 = c["n_y"] * np.sqrt(c["n"]) * c["db_dz"]
    psi = c["q"] * c["S_min"] - 2 * K_1 * ratio
    lipschitz = 2 * (c["L_b"] + c["n_y"] * c["L_b_star"]) * ratio
    scale = 2 * c["K_2"] * (2 * c["theta_m"]) ** (c["n_star"] - 1) * c["S_max"]
    conditions = [
        Condition("psi = q S_min - 2 K_1 S_max/S_min > 0 (2.48)", psi, 0),
        Condition(
            "theta_m q S_min > 2 (L_b + n_y L_b*) S_max/S_min: any error falls (2.53)",
            c["theta_m"] * c["q"] * c["S_min"],
            lipschitz,
        ),
    ]
    return conditions, {
        "psi, rate of decay of |eps|^2 (2.58)": psi,
        "largest scaled V from which it decays at theta = 1 (2.47)": _ratio(
            psi**2 * c["S_min"] ** 3, 4 * scale**2
        ),
    }


def _rows(c: Constants) -> Condition:
    """Condition (a) of Theorems 2 to 5 (3.24, 3.55, 4.14, 4.35)."""
    limit = 2 * c["n_y"] * c["L_b_star"] * c["S_max"] / c["S_min"] ** 2
    return Condition("q > 2 n_y L_b* S_max/S_min^2", c["q"], limit)


def _asymptotic(c: Constants, H: float) -> Computed:
    """Theorems 2 and 4: no noise, a state of age up to H (3.24-3.25, 4.14-4.15).

    The bracket is that of the proofs (3.41), with the + 1 that the statements lack, and with H as
    factor; it must be positive, which its square would hide.
    """
    growth = np.sqrt(c["n"]) * c["L_b"] * _exp((c["L_b"] + 1) * H)
    decay = (
        c["theta_min"] * c["q"] * c["S_min"]
        - 2 * c["n_y"] * c["L_b_star"] * c["S_max"] / c["S_min"]
    )
    slope = 2 * c["theta_m"] / (c["R_min"] * c["S_min"]) + 1 + growth
    bracket = 1 - slope * H if H > 0 else 1.0
    left = _ratio(2 * growth, decay)
    conditions = [
        _rows(c),
        Condition("min theta q S_min - 2 n_y L_b* S_max/S_min > 0 (denominator)", decay, 0),
        Condition("1 - (2 theta_m/(R_min S_min) + 1 + sqrt(n) L_b E) H > 0 (bracket)", bracket, 0),
        Condition(
            "S_min/S_max bracket^2 > 2 sqrt(n) L_b E / denominator (b)",
            c["S_min"] / c["S_max"] * bracket**2,
            left,
        ),
    ]
    return conditions, {
        "growth of a prediction's error over H, sqrt(n) E": growth / c["L_b"]
        if c["L_b"] > 0
        else float(np.sqrt(c["n"])) * _exp(H)
    }


def _noisy(c: Constants, H: float) -> Computed:
    """Theorems 3 and 5: ultimate bound under noise, a state of age up to H (3.56, 4.36)."""
    E = _exp((c["L_b"] + 1) * H)
    noise = c["L_w"] * c["phi_w"] / (c["L_b"] + 1)
    denominator = (
        c["theta_min"] * c["q"] * c["S_min"] ** 2 - 2 * c["S_max"] * c["n_y"] * c["L_b_star"]
    )
    numerator = (
        2 * c["S_max"] * c["L_b"] * E * (np.sqrt(c["n"]) * c["d_m"] + 2 * noise)
        + 2 * noise * c["S_max"]
        + 4 * c["theta_m"] * c["n_y"] * c["phi_v"] / c["R_min"]
    )
    conditions = [
        _rows(c),
        Condition("min theta q S_min^2 - 2 S_max n_y L_b* > 0 (denominator)", denominator, 0),
    ]
    return conditions, {"eps*, ultimate bound of |eps|": _ratio(numerator, denominator)}


def _triggered(c: Constants) -> Computed:
    """Theorem 6: ultimate bound with triggered communication (5.7, 5.9)."""
    coupling = 2 * c["n_y"] * (c["n_y"] * c["L_b"] + c["L_b_star"]) * c["S_max"]
    denominator = c["S_min"] ** 2 * c["theta_min"] * c["q"] - coupling
    held = 2 * c["n_y"] * (c["n_y"] - 1) * c["L_b"] * (c["L_z"] + c["M"] * c["Delta"]) * c["S_max"]
    numerator = (
        held
        + 2 * c["S_max"] * c["n_y"] * c["L_w"] * c["phi_w"]
        + 4 * c["theta_m"] * c["n_y"] * c["phi_v"] / c["R_min"]
        + c["delta"]
    )
    conditions = [
        Condition("q > 2 n_y (n_y L_b + L_b*) S_max/S_min^2", c["q"], coupling / c["S_min"] ** 2),
        Condition("S_min^2 min theta q - 2 n_y (n_y L_b + L_b*) S_max > 0", denominator, 0),
    ]
    return conditions, {"eps_t, ultimate bound of |eps|": _ratio(numerator, denominator)}


def _late(c: Constants) -> float:
    """Oldest state that is used, (D + T_m) Delta."""
    return (c["D"] + c["T_m"]) * c["Delta"]


_COMMON = "n n_y q R_min theta_m S_min S_max L_b L_b_star"
THEOREMS: tuple[tuple[str, str, Callable[[Constants], Computed]], ...] = (
    (
        "Theorem 1: continuous communication, no noise",
        f"{_COMMON} n_star db_dz K_2",
        _exponential,
    ),
    (
        "Theorem 2: an exchange every Delta, no noise",
        f"{_COMMON} Delta",
        lambda c: _asymptotic(c, c["Delta"]),
    ),
    (
        "Theorem 3: an exchange every Delta, noise",
        f"{_COMMON} Delta d_m L_w phi_w phi_v",
        lambda c: _noisy(c, c["Delta"]),
    ),
    (
        "Theorem 4: delays and losses, no noise",
        f"{_COMMON} Delta D T_m",
        lambda c: _asymptotic(c, _late(c)),
    ),
    (
        "Theorem 5: delays and losses, noise",
        f"{_COMMON} Delta D T_m d_m L_w phi_w phi_v",
        lambda c: _noisy(c, _late(c)),
    ),
    (
        "Theorem 6: triggered communication, noise",
        f"{_COMMON} Delta L_z M L_w phi_w phi_v",
        _triggered,
    ),
)
"""Title, constants that are needed, computation."""
