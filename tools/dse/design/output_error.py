"""Parameters of a model from recorded inputs and outputs: output error, Levenberg-Marquardt.

    min_p  sum_k sum_j ((y_j(t_k) - yhat_j(t_k; p)) / scale_j)^2

yhat: outputs of the noise-free model under the recorded inputs from its initial state. With white
measurement noise of equal size relative to the scales, and the right model, this is the maximum
likelihood estimate; then the intervals are right, too. A model error makes them too narrow.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from dse.errors import UserError
from dse.plants import ModelError, Plant
from dse.run import Floats

Transform = Callable[[Floats], Floats]

CONFIDENCE = 0.95
FAR = 1e6
"""Residual, in scales, where the model cannot be evaluated: worse than anything real."""
DETERMINED = 1e-6
"""Smallest singular value of the Jacobian beside the largest; less is no effect at all."""
COUPLED = 0.95
"""A correlation beyond this is worth a word."""


@dataclass
class Data:
    """What was recorded; K samples."""

    period: float
    """Plant time."""
    u: Floats
    """(K, nu), held over the samples."""
    y: Floats
    """(K, ny), NaN where a value is missing."""


@dataclass
class Problem:
    """Which parameters are sought, and what is known."""

    plant: Plant
    data: Data
    train: int
    """Samples 0 .. train - 1 are fitted, the others judge."""
    names: list[str]
    """Of the parameters that are sought."""
    values: Floats
    """(n_parameters,): start of those, values of all others."""
    x0: Floats
    """(nx,): state at the first sample."""
    steps: int = 0
    """Runge-Kutta steps per sample, 0: one Euler step."""

    def with_parameters(self, found: Floats) -> Floats:
        """All parameter values with those in place of the sought ones."""
        values = self.values.copy()
        values[[self.plant.parameter(name) for name in self.names]] = found
        return values

    def outputs(self, values: Floats, samples: int) -> Floats:
        """(samples, ny) of the model."""
        return self.plant.simulate(
            values, self.x0, self.data.u[:samples], self.data.period, self.steps
        )[1]


@dataclass
class Found:
    """What came out."""

    start: Floats
    value: Floats
    half_width: Floats
    """Of the confidence interval."""
    correlation: Floats
    """(n, n)."""
    evaluations: int
    """Of the model, those for differences included."""
    fit_train: Floats
    """(ny,), see fit()."""
    fit_validation: Floats
    simulated: Floats
    """(K, ny) with the values found."""

    def coupled(self, names: list[str]) -> list[tuple[str, str, float]]:
        """Pairs of parameters that the data can hardly tell apart."""
        n = len(names)
        return [
            (names[i], names[j], float(self.correlation[i, j]))
            for i in range(n)
            for j in range(i)
            if abs(self.correlation[i, j]) > COUPLED
        ]


def fit(y: Floats, simulated: Floats) -> Floats:
    """Of each output, in percent: 100 (1 - |y - yhat| / |y - mean y|); 100 is perfect."""
    error = np.sqrt(np.nansum((y - simulated) ** 2, axis=0))
    spread = np.sqrt(np.nansum((y - np.nanmean(y, axis=0)) ** 2, axis=0))
    return np.asarray(100 * (1 - error / np.where(spread > 0, spread, np.nan)))


def identify(problem: Problem) -> Found:
    """Fit the training part; UserError where that cannot work."""
    plant, data, train = problem.plant, problem.data, problem.train
    index = [plant.parameter(name) for name in problem.names]
    start = problem.values[index]
    _check(problem, start)
    to, back = _transform(start)
    scale = np.array([output.scale for output in plant.outputs])
    known = np.isfinite(data.y[:train])
    evaluations = 0

    def residual(moved: Floats) -> Floats:
        nonlocal evaluations
        evaluations += 1
        try:
            simulated = problem.outputs(problem.with_parameters(back(moved)), train)
        except ModelError:
            return np.full(int(known.sum()), FAR)
        error = ((simulated - data.y[:train]) / scale)[known]
        return np.asarray(np.nan_to_num(np.clip(error, -FAR, FAR), nan=FAR))

    result = least_squares(residual, to(start), method="lm", xtol=1e-8, ftol=1e-10)
    value = back(result.x)
    unit = np.where(start != 0, value, 1.0)  # d value / d moved
    covariance = _covariance(_slope(residual, result.x), result.fun) * np.outer(unit, unit)
    deviation = np.sqrt(np.diag(covariance))
    freedom = max(int(known.sum()) - len(index), 1)
    simulated = problem.outputs(problem.with_parameters(value), len(data.y))
    return Found(
        start=start,
        value=value,
        half_width=deviation * float(student.ppf(0.5 + CONFIDENCE / 2, freedom)),
        correlation=covariance / np.outer(deviation, deviation),
        evaluations=evaluations,
        fit_train=fit(data.y[:train], simulated[:train]),
        fit_validation=fit(data.y[train:], simulated[train:]),
        simulated=simulated,
    )


def _transform(start: Floats) -> tuple[Transform, Transform]:
    """There and back: log(p / start), so that sizes count alike and no sign changes; p if 0."""
    moves = start != 0
    size = np.where(moves, start, 1.0)
    return (
        lambda p: np.where(moves, np.log(np.where(moves, p, 1.0) / size), p),
        lambda q: np.where(moves, np.exp(np.where(moves, np.clip(q, -50, 50), 0.0)) * size, q),
    )


def _check(problem: Problem, start: Floats) -> None:
    try:
        problem.outputs(problem.values, problem.train)
    except ModelError as error:
        raise UserError(f"the model cannot be simulated with the start values: {error}") from None
    if not np.isfinite(problem.data.u).all():
        raise UserError("the log lacks inputs of some samples: the model cannot be simulated")
    if not len(start):
        raise UserError("no parameters to identify: name them with --fit")


def _slope(function: Transform, at: Floats) -> Floats:
    """Central differences: sharper than those that the search gets by with."""
    columns = []
    for k in range(len(at)):
        step = np.zeros(len(at))
        step[k] = 1e-4
        columns.append((function(at + step) - function(at - step)) / 2e-4)
    return np.stack(columns, axis=1)


def _covariance(slope: Floats, residual: Floats) -> Floats:
    """s^2 (J'J)^-1; UserError where the data say nothing about a parameter."""
    _, singular, rows = np.linalg.svd(slope, full_matrices=False)
    if not singular[-1] > DETERMINED * singular[0]:
        raise UserError(
            "the data do not determine the parameters: some combination of them changes no output"
        )
    freedom = max(len(residual) - len(rows), 1)
    inverse = rows.T / singular
    return np.asarray(float(residual @ residual) / freedom * inverse @ inverse.T)
