"""What a reduced flow model is good for: certificate, fit, observability."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dse.design.pod_model import Reduced
from dse.flow import DT, PERIOD, SNAPSHOTS, TEST
from dse.run import Floats

ROUNDING = 1e-12


@dataclass(frozen=True)
class Certificate:
    """V = |x|^2 / 2 does not grow on x' = A x + q(x) when both properties hold."""

    rates: Floats
    """Eigenvalues of (A + A')/2, ascending."""
    cubic: float
    """Largest |F_i[j][k] + F_j[i][k] + F_k[i][j]| relative to the largest |F_i[j][k]|."""

    @property
    def dissipative(self) -> bool:
        """No eigenvalue is positive, to rounding."""
        return bool(self.rates[-1] <= ROUNDING * np.abs(self.rates).max())

    @property
    def lossless(self) -> bool:
        """x'q(x) = 0 for all x, to rounding."""
        return self.cubic <= ROUNDING


def certify(made: Reduced) -> Certificate:
    """The certificate of 4.1."""
    F = made.F  # noqa: N806
    cubic = F + F.transpose(1, 0, 2) + F.transpose(2, 1, 0)
    rates: Floats = np.linalg.eigvalsh((made.A + made.A.T) / 2).astype(np.float64)
    return Certificate(rates, float(np.abs(cubic).max() / max(np.abs(F).max(), 1e-300)))


def simulate(made: Reduced, x0: Floats, samples: int = SNAPSHOTS) -> Floats:
    """The model's own trajectory (samples, N), PERIOD apart, Runge-Kutta steps of DT."""
    x = np.empty((samples, len(x0)))
    x[0] = x0
    for k in range(1, samples):
        now = x[k - 1]
        for _ in range(round(PERIOD / DT)):
            k1 = made.rhs(now)
            k2 = made.rhs(now + DT / 2 * k1)
            k3 = made.rhs(now + DT / 2 * k2)
            k4 = made.rhs(now + DT * k3)
            now = now + DT / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        x[k] = now
    return x


def fit(made: Reduced) -> tuple[list[float], list[float]]:
    """Relative rms over the test run, per field: of the model, and of what projecting loses.

    The model's is that of its coefficients from those of the projected flow.
    """
    states = made.flow.advance(made.flow.start(TEST))
    projected = np.array([made.project(z) for z in states])
    model = simulate(made, projected[0])
    fields = [np.array(rows) for rows in zip(*(made.flow.fields(z) for z in states), strict=True)]
    of_model, of_projection = [], []
    for own, basis, truth in zip(made.slices, made.bases, fields, strict=True):
        of_model.append(_relative(model[:, own], projected[:, own]))
        of_projection.append(_relative(projected[:, own] @ basis.modes, truth))
    return of_model, of_projection


def _relative(found: Floats, wanted: Floats) -> float:
    return float(np.linalg.norm(found - wanted) / np.linalg.norm(wanted))


@dataclass(frozen=True)
class Seen:
    """How one sensor sees the state."""

    sensor: int
    where: str
    rank: int
    least: float
    """Smallest singular value of (C; C Ad; ..; C Ad^(N-1)), Ad = exp(J(x) PERIOD)."""


def observability(made: Reduced) -> Iterator[Seen]:
    """At x = 0 and at the start, the middle and the end of the model's test run."""
    from scipy.linalg import expm

    path = simulate(made, made.starts[0])
    points = {"0": np.zeros(len(made.A)), "t = 0": path[0]}
    for k in (SNAPSHOTS // 2, SNAPSHOTS - 1):
        points[f"t = {k * PERIOD:g}"] = path[k]
    for sensor, C in enumerate(made.C):  # noqa: N806
        for where, x in points.items():
            step = expm(PERIOD * (made.A + 2 * np.einsum("kij,i->kj", made.F, x)))
            rows = [C]
            for _ in range(len(x) - 1):
                rows.append(rows[-1] @ step)
            singular = np.linalg.svd(np.vstack(rows), compute_uv=False)
            noise = max(np.vstack(rows).shape) * np.finfo(float).eps * singular[0]
            yield Seen(sensor, where, int(np.sum(singular > noise)), float(singular[-1]))
