"""Normal form of a plant: Lie derivatives by algorithmic differentiation.

Section numbers: adaptive high-gain EKF, 4.1 of the specification; equations of the source.
"""

from dataclasses import dataclass
from typing import Any

import casadi as ca

from dse.design.invert import Step, solve
from dse.design.plant_file import Plant, Values, call
from dse.errors import UserError

SX = Any
"""casadi.SX; columns unless said otherwise."""


@dataclass
class Symbols:
    """What expressions are made of."""

    t: SX
    x: SX
    u: SX
    p: SX
    z: SX
    d: SX
    """A change of x."""


@dataclass
class NormalForm:
    """All expressions of a plant. n states, m inputs, blocks i of n_i states."""

    plant: Plant
    symbols: Symbols
    f: SX
    """(n,) in t, x, u, p."""
    h: SX
    """(ny,) in t, x, u, p."""
    domain: list[SX]
    """Must be positive; in t, x, u, p."""
    phi: SX
    """(n,) coordinates in t, x, u, p."""
    rest: SX
    """(n,) what a row of z' has beside A_i z_i: b in terms of t, x, u, p, and z where a derivative
    is a coordinate."""
    steps: list[Step]
    """How Phi is inverted."""

    @property
    def chi(self) -> SX | None:
        """(n,) inverse of Phi in t, z, u, p; None when a part of it needs an iteration."""
        if any(step.solution is None for step in self.steps):
            return None
        x = ca.SX(self.symbols.x)
        for step in self.steps:
            x[step.unknowns[0]] = self.in_z(step.solution, x)
        return x

    def in_z(self, expression: SX, chi: SX) -> SX:
        """An expression with chi for x."""
        return ca.substitute(expression, self.symbols.x, chi)

    def field(self, chi: SX) -> SX:
        """The field z' = A z + b (n,) for a given chi."""
        return self.shift(self.symbols.z) + self.in_z(self.rest, chi)

    def shift(self, z: SX) -> SX:
        """A z (n,): each chain moved up by one, zero below."""
        rows = []
        for chain in self.plant.chains:
            rows += [z[k + 1] for k in chain[:-1]] + [ca.SX(0)]
        return ca.vertcat(*rows)


def derive(plant: Plant) -> NormalForm:
    """All expressions of a plant's normal form."""
    s = _symbols(plant)
    arguments = (
        s.t,
        Values("state", dict(zip([v.name for v in plant.states], ca.vertsplit(s.x), strict=True))),
        Values("input", _members([v.name for v in plant.inputs], s.u)),
        Values("parameter", _members([v.name for v in plant.parameters], s.p)),
    )
    f = _column(plant, "f", [v.name for v in plant.states], arguments)
    h = _column(plant, "h", [v.name for v in plant.outputs], arguments)
    domain = [] if plant.domain is None else call(plant, "domain", *arguments)
    if not isinstance(domain, list):
        raise UserError(f"{plant.path}: domain must give a list")
    phi, rest = _coordinates(plant, s, f, h)
    steps = solve(plant, phi, s.x, s.z)
    return NormalForm(plant, s, f, h, [ca.SX(d) for d in domain], phi, rest, steps)


def _symbols(plant: Plant) -> Symbols:
    def column(prefix: str, names: list[str]) -> SX:
        return ca.vertcat(*[ca.SX.sym(f"{prefix}{name}") for name in names])

    states = [signal.name for signal in plant.states]
    return Symbols(
        t=ca.SX.sym("t"),
        x=column("", states),
        u=column("", [signal.name for signal in plant.inputs]),
        p=column("", [parameter.name for parameter in plant.parameters]),
        z=column("z_", states),
        d=column("d_", states),
    )


def _members(names: list[str], column: SX) -> dict[str, SX]:
    return {name: column[k] for k, name in enumerate(names)}


def _column(plant: Plant, what: str, names: list[str], arguments: tuple[Any, ...]) -> SX:
    """What f or h of the file gives, as a column in the order of names."""
    found = call(plant, what, *arguments)
    if not isinstance(found, dict) or sorted(found) != sorted(names):
        have = ", ".join(map(str, found)) if isinstance(found, dict) else type(found).__name__
        raise UserError(f"{plant.path}: {what} must give {{{', '.join(names)}}}, not {have}")
    try:
        column = ca.vertcat(*[ca.SX(found[name]) for name in names])
    except (NotImplementedError, TypeError, RuntimeError):
        raise UserError(f"{plant.path}: {what}: not all members are casadi expressions") from None
    if column.shape != (len(names), 1):
        raise UserError(f"{plant.path}: {what}: each member must be one number")
    return column


def _coordinates(plant: Plant, s: Symbols, f: SX, h: SX) -> tuple[SX, SX]:
    """Phi and b (n,) of all blocks, in t, x, u, p.

    The derivative of e along the plant is D e = de/dx f + de/dt + de/du u', where u'_j is the input
    that is declared as rate of input j, or 0.

    - inputs_in_map: z_i,k+1 = D z_i,k, so that b has a last entry only, whatever u does.
    - otherwise f = f_0 + g u with f_0 at u = 0, z_i,k+1 = L_f0 z_i,k, and (eq 1.7, with L_f^n h in
      the last row) b_i,k = (dz_i,k/dx) g u, b_i,n = D z_i,n.
    """
    rate = ca.vertcat(*[s.u[r] if r >= 0 else ca.SX(0) for r in plant.rate_index])

    def along(e: SX, field: SX) -> SX:
        return ca.jtimes(e, s.x, field) + ca.jacobian(e, s.t)

    def total(e: SX, field: SX) -> SX:
        moved = along(e, field)
        return moved + ca.jtimes(e, s.u, rate) if plant.inputs else moved

    drift, push = _affine(plant, s, f) if not plant.inputs_in_map else (f, ca.SX.zeros(f.shape))
    if not plant.inputs_in_map and ca.depends_on(h, s.u):
        raise UserError(f"{plant.path}: h depends on an input: that needs inputs_in_map = True")
    phi: list[SX] = []
    rest: list[SX] = []
    known = ca.SX(f)  # f, with z_k+1 + b_k for the derivative of a state that is coordinate k
    for i, chain in enumerate(plant.chains):
        e = h[i]
        for k in chain[:-1]:
            phi.append(e)
            rest.append(ca.jtimes(e, s.x, push))
            for j in range(len(plant.states)):
                if ca.is_equal(e, s.x[j]):
                    known[j] = s.z[k + 1] + rest[k]
            e = total(e, f) if plant.inputs_in_map else along(e, drift)
        phi.append(e)
        rest.append(ca.SX(0))
    for chain in plant.chains:
        rest[chain[-1]] = total(phi[chain[-1]], known)
    return ca.vertcat(*phi), ca.vertcat(*rest)


def _affine(plant: Plant, s: Symbols, f: SX) -> tuple[SX, SX]:
    """f_0 and g u with f = f_0 + g u, both (n,)."""
    g = ca.jacobian(f, s.u)
    for k, signal in enumerate(plant.inputs):
        if ca.depends_on(g[:, k], s.u):
            raise UserError(
                f"{plant.path}: input {signal.name} does not enter f affinely: that needs"
                " inputs_in_map = True"
            )
    return ca.substitute(f, s.u, ca.SX.zeros(s.u.shape)), ca.mtimes(g, s.u)
