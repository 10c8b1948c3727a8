"""A normal form in numbers: for checks at operating points."""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from dse.design.lie import NormalForm
from dse.design.plant_file import ParameterSet
from dse.run import Floats


@dataclass(frozen=True)
class Point:
    """An operating point: parameters, state and inputs."""

    name: str
    p: Floats
    x: Floats
    u: Floats


def operating_points(form: NormalForm) -> list[Point]:
    """Initial states of all sets, and the file's own points with the first set's parameters."""
    plant = form.plant
    nominal = {s.name: s.nominal for s in [*plant.states, *plant.inputs]}

    def point(name: str, one: ParameterSet, values: dict[str, float]) -> Point:
        at = {**nominal, **values}
        return Point(
            name,
            np.array([one.values[q.name] for q in plant.parameters], float),
            np.array([at[q.name] for q in plant.states], float),
            np.array([at[q.name] for q in plant.inputs], float),
        )

    starts = [point(f"start of {one.name}", one, dict(one.x0)) for one in plant.sets]
    return starts + [point(n, plant.sets[0], dict(v)) for n, v in plant.points.items()]


class Numeric:
    """Functions of a normal form at given parameters; t = 0."""

    def __init__(self, form: NormalForm) -> None:
        self.form = form
        s = form.symbols
        arguments, blocks = [s.t, s.x, s.u, s.p, s.z], form.plant.blocks
        rest_x, rest_z = ca.jacobian(form.rest, s.x), ca.jacobian(form.rest, s.z)
        shift = ca.jacobian(form.shift(s.z), s.z)
        everything = {
            "f": form.f,
            "dfdx": ca.jacobian(form.f, s.x),
            "domain": ca.vertcat(*form.domain) if form.domain else ca.SX(1),
            "phi": form.phi,
            "slope": ca.jacobian(form.phi, s.x),
            "field": form.shift(s.z) + form.rest,
            "rest_x": rest_x,
            "rest_z": rest_z + shift,
            "shift": shift,
        }
        if form.chi is not None:
            everything["chi"] = form.chi
            z_field = form.field(form.chi)
            for i, block in enumerate(blocks):
                rows = list(block)
                everything[f"F{i}"] = ca.jacobian(z_field[rows], s.z[rows])
        self.functions = {name: ca.Function(name, arguments, [e]) for name, e in everything.items()}

    def __call__(self, name: str, at: Point, x: Floats, z: Floats | None = None) -> Floats:
        """A function's value; vectors come as (n,), matrices as they are."""
        zero = np.zeros(len(x)) if z is None else z
        found: Any = self.functions[name](0, x, at.u, at.p, zero)
        array: Floats = np.array(found, float)
        vector = name in ("f", "domain", "phi", "field", "chi")
        return array[:, 0] if vector else array

    def inside(self, at: Point, x: Floats) -> bool:
        """There is a plant at x, and coordinates."""
        whole = np.isfinite(self("phi", at, x)).all() and np.isfinite(self("f", at, x)).all()
        return bool(whole and (self("domain", at, x) > 0).all())

    def decode(self, at: Point, z: Floats, near: Floats) -> Floats:
        """Phi^-1(z); where it needs an iteration, that one begins at near."""
        if "chi" in self.functions:
            return self("chi", at, near, z)
        x = near.copy()
        for _ in range(20):
            x = x - np.linalg.solve(self("slope", at, x), self("phi", at, x) - z)
        return x

    def field(self, at: Point, z: Floats, near: Floats) -> Floats:
        """The field z' at z."""
        return self("field", at, self.decode(at, z, near), z)

    def jacobian(self, i: int, at: Point, z: Floats, near: Floats) -> Floats:
        """F_i (n_i, n_i) at z."""
        rows = list(self.form.plant.blocks[i])
        if "chi" in self.functions:
            found: Floats = np.array(self.functions[f"F{i}"](0, near, at.u, at.p, z), float)
            return found
        x = self.decode(at, z, near)
        inverse = np.linalg.inv(self("slope", at, x))
        whole = self("rest_z", at, x, z) + self("rest_x", at, x, z) @ inverse
        return whole[np.ix_(rows, rows)]
