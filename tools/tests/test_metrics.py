"""Metrics against what they must be for known errors."""

import math

import numpy as np
import pytest

from dse.metrics import (
    aggregate_error,
    disagreement,
    error_norm,
    integral,
    l2_norm,
    late,
    max_error,
    nees,
    node_average_error,
    rmse,
    settling_band,
    settling_time,
)

TIME = np.linspace(0, 2, 2001)


def test_rmse_and_maximum_of_a_sine() -> None:
    error = np.stack([3 * np.sin(2 * np.pi * TIME), -2 * np.ones_like(TIME)], axis=1)
    np.testing.assert_allclose(rmse(error), [3 / math.sqrt(2), 2], rtol=1e-3)
    np.testing.assert_allclose(max_error(error), [3, 2], rtol=1e-4)


def test_metrics_of_nothing_are_nan() -> None:
    nothing = np.zeros((0, 3))
    assert np.isnan(rmse(nothing)).all()
    assert np.isnan(max_error(nothing)).all()
    assert settling_time(np.zeros(0), np.zeros(0), 1.0) is None


@pytest.mark.parametrize("samples", [1800, 1801, 10, 2, 1])
def test_late_is_the_last_two_fifths(samples: int) -> None:
    time = np.arange(samples) / 3600
    chosen = late(time)
    assert chosen[-1]
    if samples > 2:
        assert chosen.sum() == pytest.approx(0.4 * samples, abs=1)
    assert (np.diff(chosen.astype(int)) >= 0).all()


@pytest.mark.parametrize("rate", [3.0, 10.0, 40.0])
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_settling_time_of_a_decaying_error(rate: float, noise: float) -> None:
    generator = np.random.default_rng(1)
    error = 10 * np.exp(-rate * TIME) + noise * generator.standard_normal(len(TIME)) * (TIME > 0)
    settled = settling_time(TIME, error, settling_band(error, math.nan))
    # 10 exp(-rate t) = 0.5; noise well below the band may shift it by about a window (0.04).
    assert settled == pytest.approx(math.log(20) / rate, abs=0.001 if noise == 0 else 0.06)


def test_single_spikes_do_not_unsettle_but_a_lasting_error_does() -> None:
    error = 10 * np.exp(-10 * TIME)
    spiked = error.copy()
    spiked[1500] = 2.0
    assert settling_time(TIME, spiked, 0.5) == settling_time(TIME, error, 0.5)
    lasting = error.copy()
    lasting[1500:1600] = 2.0
    later = settling_time(TIME, lasting, 0.5)
    assert later is not None
    assert later == pytest.approx(1.6, abs=0.01)


def test_an_error_that_stays_outside_never_settles() -> None:
    assert settling_time(TIME, np.ones_like(TIME), 0.5) is None
    assert settling_time(TIME, np.where(TIME > 1.9, 1.0, 0.0), 0.5) is None
    assert settling_time(TIME, np.full_like(TIME, np.inf), 0.5) is None
    assert settling_time(TIME, np.zeros_like(TIME), 0.0) == 0.0


def test_the_settling_band_has_a_floor_of_the_scale() -> None:
    assert settling_band(np.array([10.0, 0.0]), 1.0) == 0.5
    assert settling_band(np.array([-0.1, 0.0]), 1.0) == 0.02
    assert settling_band(np.array([-10.0, 0.0]), math.nan) == 0.5
    assert settling_band(np.array([0.0]), math.nan) == 0.0


def test_nees_is_one_for_an_honest_variance() -> None:
    generator = np.random.default_rng(2)
    variance = np.full((200000, 2), [4.0, 4.0])
    error = 2 * generator.standard_normal(variance.shape) * [1, 3]
    np.testing.assert_allclose(nees(error, variance), [1, 9], rtol=0.02)
    assert np.isnan(nees(error, np.full_like(error, np.nan))).all()


def test_error_norm_is_the_mean_over_scaled_states() -> None:
    error = np.array([[3.0, 8.0], [0.0, 0.0]])
    np.testing.assert_allclose(error_norm(error, np.array([1.0, 2.0])), [math.sqrt(12.5), 0])
    # A state without scale does not take part.
    np.testing.assert_allclose(error_norm(error, np.array([1.0, math.nan])), [3, 0])


# ---- nodes together ----


def test_node_average_error_and_aggregate_of_known_errors() -> None:
    """Three nodes, two states: each node's error is (3, 4), of length 5."""
    error = np.broadcast_to([3.0, 4.0], (3, 5, 2))
    np.testing.assert_allclose(aggregate_error(error), 5 * math.sqrt(3))
    np.testing.assert_allclose(node_average_error(error), 5 / math.sqrt(3))


def test_disagreement_does_not_see_a_common_error() -> None:
    value = np.array([[[1.0], [7.0]], [[-1.0], [7.0]]])
    np.testing.assert_allclose(disagreement(value), [math.sqrt(2), 0])
    np.testing.assert_allclose(disagreement(value + 100), disagreement(value))


def test_l2_norm_of_a_decaying_error_has_its_closed_form() -> None:
    """sum_i e_i^2 integrated: (4 + 9) (1 - exp(-2 T)) / 2."""
    error = np.array([2.0, -3.0])[:, None, None] * np.exp(-TIME)[:, None]
    assert l2_norm(TIME, error) == pytest.approx(math.sqrt(13 * (1 - math.exp(-4)) / 2), rel=1e-6)
    assert integral(TIME, TIME) == pytest.approx(2.0)
    assert math.isnan(l2_norm(TIME[:0], error[:, :0]))
