"""How good estimates are: functions of arrays.

Shapes: K samples, n states. Errors are estimate minus truth, in the states' units.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dse.run import Estimates, Floats, Ints, Series

LATE = 0.4
"""The late part of a run is this fraction at its end."""
NAN = float("nan")


def rmse(error: Floats) -> Floats:
    """Root mean square per state. error: (K, n) in the states' units; result: (n,)."""
    if not len(error):
        return np.full(error.shape[1], NAN)
    result: Floats = np.sqrt(np.mean(error**2, axis=0))
    return result


def max_error(error: Floats) -> Floats:
    """Largest absolute error per state. error: (K, n); result: (n,)."""
    if not len(error):
        return np.full(error.shape[1], NAN)
    result: Floats = np.abs(error).max(axis=0)
    return result


def late(time: Floats, fraction: float = LATE) -> NDArray[np.bool_]:
    """Which samples belong to the last `fraction` of the run. time: (K,); result: (K,)."""
    if not len(time):
        return np.zeros(0, dtype=bool)
    start, end = time[0], time[-1]
    # One part in 1e9 of slack: 0.6 x 0.5 h must not depend on how its sum was rounded.
    result: NDArray[np.bool_] = time > start + (1 - fraction) * (end - start) * (1 + 1e-9)
    result[-1] = True
    return result


def settling_band(error: Floats, scale: float) -> float:
    """Half width of the band: max(5 % of the initial error, 2 % of the scale). error: (K,)."""
    floor = 0.02 * scale if math.isfinite(scale) else 0.0
    return float(max(0.05 * abs(error[0]), floor)) if len(error) else NAN


def settling_time(time: Floats, error: Floats, band: float) -> float | None:
    """Time since the start from which the error stays within the band; None if never.

    The error is judged by its root mean square over windows of W = max(1, K/50) samples: settled
    at k means that the error at k is within the band, and so is each window that begins at k or
    later. time, error: (K,).
    """
    if not len(error) or not math.isfinite(band) or not np.isfinite(error).all():
        return None
    window = max(1, len(error) // 50)
    power = np.lib.stride_tricks.sliding_window_view(error**2, window).mean(axis=1)
    outside = np.flatnonzero(np.sqrt(power) > band)
    first = int(outside[-1]) + 1 if len(outside) else 0
    inside = np.flatnonzero(np.abs(error[first : len(power)]) <= band)
    return float(time[first + inside[0]] - time[0]) if len(inside) else None


def error_norm(error: Floats, scale: Floats) -> Floats:
    """(1/n sum_i (e_i/s_i)^2)^(1/2) per sample. error: (K, n); scale: (n,); result: (K,)."""
    usable = np.isfinite(scale) & (scale > 0)
    if not usable.any():
        return np.full(len(error), NAN)
    result: Floats = np.sqrt(np.mean((error[:, usable] / scale[usable]) ** 2, axis=1))
    return result


def nees(error: Floats, variance: Floats) -> Floats:
    """Mean of e^2/P per state, NaN where there is no positive variance. (K, n), (K, n) -> (n,)."""
    known = np.isfinite(variance) & (variance > 0)
    ratio = np.where(known, error**2 / np.where(known, variance, 1), 0)
    count = known.sum(axis=0)
    result: Floats = np.where(count > 0, ratio.sum(axis=0) / np.maximum(count, 1), NAN)
    return result


def errors(truth: Series, estimates: Estimates, states: Sequence[int]) -> tuple[Ints, Floats]:
    """Estimate minus truth (K, n) and their samples (K,), where both exist.

    An estimate that is not a finite number has an infinite error.
    """
    common, mine, true = np.intersect1d(
        estimates.sample, truth.sample, assume_unique=True, return_indices=True
    )
    with np.errstate(invalid="ignore"):
        error = estimates.value[mine] - truth.value[true][:, list(states)]
    return common, np.where(np.isfinite(estimates.value[mine]), error, np.inf)


# ---- several nodes that estimate the same states; N nodes ----


def aggregate_error(error: Floats) -> Floats:
    """|e| = (sum_i e_i'e_i)^(1/2) per sample. error: (N, K, n); result: (K,)."""
    result: Floats = np.sqrt(np.sum(error**2, axis=(0, 2)))
    return result


def node_average_error(error: Floats) -> Floats:
    """(1/N) (sum_i e_i'e_i)^(1/2) per sample. error: (N, K, n); result: (K,)."""
    result: Floats = aggregate_error(error) / len(error)
    return result


def disagreement(value: Floats) -> Floats:
    """(sum_i |x_i - mean_j x_j|^2)^(1/2) per sample. value: (N, K, n), estimates; result: (K,)."""
    return aggregate_error(value - value.mean(axis=0))


def integral(time: Floats, value: Floats) -> float:
    """Integral over the run by the trapezoidal rule. time, value: (K,)."""
    return float(np.trapezoid(value, time)) if len(time) else NAN


def l2_norm(time: Floats, error: Floats) -> float:
    """(integral of sum_i e_i'e_i dt)^(1/2), trapezoidal. time: (K,); error: (N, K, n)."""
    return math.sqrt(integral(time, np.sum(error**2, axis=(0, 2)))) if len(time) else NAN
