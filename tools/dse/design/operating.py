"""Checks of a normal form at operating points: observability, and whether derivatives are right."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dse.design.lie import NormalForm
from dse.design.numeric import Numeric, Point, operating_points
from dse.errors import UserError
from dse.run import Floats

SINGULAR = 1e-10
"""A singular value below this part of the largest counts as zero."""
RANDOM = 20
"""Points per operating point at which derivatives are checked."""
SPREAD = 0.3
"""How far from the operating point, in the states' scales."""
TOLERANCE = 1e-5
"""Largest relative deviation from central differences that passes."""


@dataclass
class Observability:
    """dPhi/dchi at a point, states in units of their scales and rows of length one."""

    point: str
    n: int
    singular: Floats
    """(n,) descending."""
    weakest: list[str]
    """States along the direction that is seen least."""
    blind: list[str]
    """Subsystems whose own block dPhi_i/dchi_i is singular, with the state: no `mapped` form."""

    @property
    def rank(self) -> int:
        """Number of singular values that are not zero."""
        return int((self.singular > SINGULAR * self.singular[0]).sum())

    @property
    def hidden(self) -> str:
        """What a failure means."""
        return (
            f"not observable at '{self.point}': {' and '.join(self.weakest)} cannot be told from"
            f" the outputs and their derivatives (dPhi/dchi has rank {self.rank} of {self.n},"
            f" singular values {', '.join(f'{value:.3g}' for value in self.singular)})"
        )


def observability(form: NormalForm, numeric: Numeric, at: Point) -> Observability:
    """Singular values of the scaled dPhi/dchi; UserError where there is no plant."""
    plant = form.plant
    names = [state.name for state in plant.states]
    if not numeric.inside(at, at.x):
        raise UserError(
            f"{plant.path}: the plant or its coordinates are not defined at '{at.name}'"
        )
    slope = numeric("slope", at, at.x) * np.array([state.scale for state in plant.states])
    if not np.isfinite(slope).all():
        raise UserError(f"{plant.path}: dPhi/dchi is not finite at '{at.name}'")
    singular, weakest = _weakest(slope, names)
    blind = []
    for subsystem, block in zip(plant.subsystems, plant.blocks, strict=True):
        own, states = _weakest(slope[np.ix_(block, block)], [names[k] for k in block])
        if own[-1] <= SINGULAR * own[0]:
            blind.append(f"{subsystem.name} ({', '.join(states)})")
    return Observability(at.name, len(names), singular, weakest, blind)


def check_triangular(form: NormalForm) -> None:
    """b_i,k may depend on z_i1 .. z_ik only, except in the last row of a chain (eq 2.3)."""
    plant, numeric = form.plant, Numeric(form)
    for at in operating_points(form):
        z = numeric("phi", at, at.x)
        slope, rest = (numeric(name, at, at.x, z) for name in ("slope", "rest_x"))
        by_z = numeric("rest_z", at, at.x, z) - numeric("shift", at, at.x)
        effect = np.abs(by_z + rest @ np.linalg.inv(slope)) * (np.abs(slope) @ np.abs(at.x))
        for chain, output in zip(plant.chains, plant.outputs, strict=True):
            for k in chain[:-1]:
                allowed = range(chain[0], k + 1)
                others = [j for j in range(len(z)) if j not in allowed]
                if effect[k, others].max(initial=0) > SINGULAR * effect[k].max():
                    raise UserError(
                        f"{plant.path}: not triangular: an input moves derivative {k - chain[0]} of"
                        f" {output.name} through states that this coordinate does not hold; that"
                        " needs inputs_in_map = True"
                    )


def _weakest(matrix: Floats, names: list[str]) -> tuple[Floats, list[str]]:
    length = np.linalg.norm(matrix, axis=1, keepdims=True)
    _, singular, directions = np.linalg.svd(matrix / np.where(length > 0, length, 1))
    part = np.abs(directions[-1])
    return singular, [names[k] for k in np.flatnonzero(part >= 0.5 * part.max())]


def check_observability(form: NormalForm) -> list[Observability]:
    """At every operating point; UserError that names the state where one fails."""
    numeric = Numeric(form)
    found = [observability(form, numeric, at) for at in operating_points(form)]
    for one in found:
        if one.rank < one.n:
            raise UserError(f"{form.plant.path}: {one.hidden}")
    check_triangular(form)
    return found


def check_derivatives(form: NormalForm) -> dict[str, float]:
    """Worst relative deviation of each function from what it must be, around all operating points.

    Jacobians and z' are compared with central differences, row by row relative to the largest
    effect that a state's scale has in that row; decode(encode(x)) with x, relative to the states'
    sizes.
    """
    numeric = Numeric(form)
    worst: dict[str, float] = {}
    generator = np.random.default_rng(1)
    scale = np.array([state.scale for state in form.plant.states])
    for at in operating_points(form):
        for _ in range(RANDOM):
            x = at.x + SPREAD * scale * generator.uniform(-1, 1, len(scale))
            if numeric.inside(at, x):
                for name, value in _deviations(form, numeric, at, x, scale).items():
                    worst[name] = max(worst.get(name, 0.0), value)
    return worst


def _deviations(
    form: NormalForm, numeric: Numeric, at: Point, x: Floats, scale: Floats
) -> dict[str, float]:
    plant = form.plant
    z, size = numeric("phi", at, x), np.abs(x) + scale
    slope, aside = numeric("slope", at, x), x + 0.01 * scale
    found = {
        "decode(encode(x)) = x": float((np.abs(numeric.decode(at, z, aside) - x) / size).max()),
        "df/dx": _relative(
            numeric("dfdx", at, x), _differences(lambda v: numeric("f", at, v), x, size), size
        ),
        "dPhi_i/dchi_i": _relative(
            slope, _differences(lambda v: numeric("phi", at, v), x, size), size
        ),
        "z' along the plant": _along(form, numeric, at, x, z),
    }
    z_size = np.abs(slope) @ scale
    field = _differences(lambda v: numeric.field(at, v, x), z, z_size)
    found["A_i + b_i*"] = max(
        _relative(numeric.jacobian(i, at, z, x), field[np.ix_(block, block)], z_size[list(block)])
        for i, block in enumerate(plant.blocks)
    )
    return found


def _along(form: NormalForm, numeric: Numeric, at: Point, x: Floats, z: Floats) -> float:
    """Compare z' with (Phi(x + h x', u + h u') - Phi(x - h x', u - h u')) / 2h."""
    plant, dx = form.plant, numeric("f", at, x)
    rate = np.array([at.u[r] if r >= 0 else 0.0 for r in plant.rate_index])
    size = np.abs(x) + np.array([state.scale for state in plant.states])
    h = 1e-5 / max(float((np.abs(dx) / size).max()), 1e-300)
    ends = [
        numeric("phi", Point(at.name, at.p, x, at.u + sign * h * rate), x + sign * h * dx)
        for sign in (1, -1)
    ]
    expected = (ends[0] - ends[1]) / (2 * h)
    got = numeric("field", at, x, z)
    reference = np.abs(numeric("slope", at, x)) @ np.abs(dx) + np.abs(expected) + 1e-300
    return float((np.abs(got - expected) / reference).max())


def _differences(function: Callable[[Floats], Floats], x: Floats, size: Floats) -> Floats:
    columns = []
    for k in range(len(x)):
        step = np.zeros(len(x))
        step[k] = 6e-6 * size[k]
        columns.append((function(x + step) - function(x - step)) / (2 * step[k]))
    return np.stack(columns, axis=1)


def _relative(exact: Floats, differences: Floats, size: Floats) -> float:
    effect = np.abs(differences * size).max(axis=1, keepdims=True)
    return float((np.abs(exact - differences) * size / np.where(effect > 0, effect, 1)).max())
