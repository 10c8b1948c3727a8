"""Proper orthogonal decomposition and Galerkin models of flows, (2.1) to (2.4), (3.1) to (3.47).

Fields are vectors as dse.flow has them; the inner product of two fields is h^2 times their dot
product.
"""

from dataclasses import dataclass

import numpy as np

from dse.errors import UserError
from dse.flow import SENSORS, TEST, TRAIN, Flow
from dse.run import Floats

NU = KAPPA = 0.0025
ZETA = NU / 0.71
"""Viscosity and diffusivities, as sim/flow.h has them."""
NOISE = 1e-12
"""Eigenvalues below this share of the largest one are rounding errors."""
COUNTS = (4, 3, 3)
"""Modes of velocity, contaminant and temperature in the benchmark."""


@dataclass(frozen=True)
class Basis:
    """Modes of one field."""

    modes: Floats
    """(count, size), orthonormal."""
    weights: Floats
    """(count, snapshots): modes = weights @ snapshots."""
    eigenvalues: Floats
    """All of the correlation matrix, largest first."""

    @property
    def count(self) -> int:
        """How many modes are kept."""
        return len(self.modes)

    @property
    def energy(self) -> Floats:
        """Share of the energy that the first 1, 2, .. modes hold."""
        total: Floats = np.cumsum(self.eigenvalues) / np.sum(self.eigenvalues)
        return total


@dataclass(frozen=True)
class Reduced:
    """x' = d + A x + sum_k e_k x'F_k x, y = C x, and where it comes from."""

    flow: Flow
    bases: tuple[Basis, Basis, Basis]
    A: Floats
    F: Floats
    """(N, N, N), each F_k symmetric."""
    d: Floats
    C: Floats
    """(sensors, 3, N)."""
    starts: Floats
    """(4, N): projected initial states of the test run and the runs of the snapshots."""

    @property
    def slices(self) -> tuple[slice, slice, slice]:
        """The coefficients of velocity, contaminant and temperature."""
        n, p, q = (basis.count for basis in self.bases)
        return slice(0, n), slice(n, n + p), slice(n + p, n + p + q)

    def project(self, z: Floats) -> Floats:
        """The coefficients (N,) of a state of the flow."""
        fields = self.flow.fields(z)
        return np.concatenate(
            [b.modes @ f / self.flow.n**2 for b, f in zip(self.bases, fields, strict=True)]
        )

    def fields(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Velocity, contaminant and temperature of coefficients (N,)."""
        v, c, t = (x[s] @ b.modes for s, b in zip(self.slices, self.bases, strict=True))
        return v, c, t

    def rhs(self, x: Floats) -> Floats:
        """X' at x (N,)."""
        value: Floats = self.d + self.A @ x + np.einsum("kij,i,j->k", self.F, x, x)
        return value


def snapshots(flow: Flow, runs: list[int] = TRAIN) -> list[Floats]:
    """Velocity, contaminant and temperature (snapshots, size) of some runs."""
    states = np.vstack([flow.advance(flow.start(run)) for run in runs])
    return [np.array(rows) for rows in zip(*(flow.fields(z) for z in states), strict=True)]


def pod(fields: Floats, product: float, count: int | None = None, energy: float = 1.0) -> Basis:
    """Modes of snapshots (m, size) with the inner product `product` times the dot product.

    R_ij = <s_i, s_j> / m, R c = lambda c, mode = sum_k c_k s_k / sqrt(m lambda), as many as
    `count` or as the share `energy` asks for. Each mode's sign makes <mode, s_1> > 0.
    """
    m = len(fields)
    R = product / m * fields @ fields.T  # noqa: N806
    values, vectors = np.linalg.eigh(R)
    values, vectors = values[::-1], vectors[:, ::-1]
    if not values[0] > 0:
        raise UserError("the snapshots are zero")
    held = np.cumsum(values) / np.sum(values)
    if count is None:
        count = int(np.searchsorted(held, energy)) + 1
    usable = int(np.sum(values > NOISE * values[0]))
    if not 1 <= count <= usable:
        raise UserError(f"{count} modes: the snapshots have 1 to {usable}")
    weights = (vectors[:, :count] / np.sqrt(m * values[:count])).T
    weights *= np.where(vectors[0, :count] < 0, -1.0, 1.0)[:, None]  # <mode, s_1> ~ lambda c_1
    return Basis(weights @ fields, weights, values)


def reduce(
    flow: Flow,
    counts: tuple[float, float, float] | None = None,
    energies: tuple[float, float, float] | None = None,
    fields: list[Floats] | None = None,
) -> Reduced:
    """The Galerkin model of snapshots, by default those of the benchmark.

    So many modes of each field, or as many as hold a share of its energy; neither: COUNTS.
    """
    if counts is None and energies is None:
        counts = COUNTS
    v, c, t = (
        pod(
            rows,
            1 / flow.n**2,
            int(counts[i]) if counts else None,
            energies[i] if energies else 1.0,
        )
        for i, rows in enumerate(snapshots(flow) if fields is None else fields)
    )
    return galerkin(flow, (v, c, t))


def galerkin(flow: Flow, bases: tuple[Basis, Basis, Basis]) -> Reduced:
    """(3.44) to (3.47), with the minus of (3.8), (3.22), (3.35) and the sources kept in d."""
    velocity = bases[0].modes
    sizes = [basis.count for basis in bases]
    n, total = sizes[0], sum(sizes)
    A, F = np.zeros((total, total)), np.zeros((total, total, total))  # noqa: N806
    d = np.zeros(total)
    area, at = 1 / flow.n**2, 0
    for basis, diffusion, source in zip(bases, (NU, KAPPA, ZETA), flow.sources(), strict=True):
        own = slice(at, at + basis.count)
        laplacians = np.array([flow.laplacian(mode) for mode in basis.modes])
        A[own, own] = diffusion * area * basis.modes @ laplacians.T
        d[own] = area * basis.modes @ source
        for i in range(n):  # - <(alpha_i . grad) mode_j, mode_k>
            carried = np.array([flow.convection(velocity[i], mode) for mode in basis.modes])
            F[own, i, own] -= area * basis.modes @ carried.T
        at += basis.count
    F = (F + F.transpose(0, 2, 1)) / 2  # noqa: N806
    C = np.array([rows(flow, bases, cell) for cell in SENSORS])  # noqa: N806
    made = Reduced(flow, bases, A, F, d, C, np.zeros((1 + len(TRAIN), total)))
    for row, run in enumerate((TEST, *TRAIN)):
        made.starts[row] = made.project(flow.start(run))
    return made


def rows(flow: Flow, bases: tuple[Basis, Basis, Basis], cell: tuple[int, int]) -> Floats:
    """What a sensor in a cell reads (3, N): sum of velocities, contaminant, temperature.

    (3.13), (3.27), (3.40).
    """
    columns: list[Floats] = []
    for which, basis in enumerate(bases):
        for mode in basis.modes:
            column = np.zeros(3)
            column[which] = value(flow, which, mode, cell)
            columns.append(column)
    return np.array(columns).T


def value(flow: Flow, which: int, field: Floats, cell: tuple[int, int]) -> float:
    """A field at the centre of a cell: u + v of a velocity (which 0), or a scalar."""
    if which == 0:
        u, v = flow.at_centres(field)
        return float(u[cell] + v[cell])
    return float(field.reshape(flow.n, flow.n)[cell])
