"""Inverse of a coordinate map, in closed form where there is one.

The equations z = Phi(chi) are put into block-triangular order (which unknowns does an equation
still have when others are solved?). A block with one equation is solved by taking its expression
apart from outside: sum, product, root .. around the unknown. What cannot be taken apart, and blocks
of several equations, are left to an iteration.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from dse.design.plant_file import Plant
from dse.errors import UserError

SX = Any


@dataclass
class Step:
    """One block of the solution."""

    rows: list[int]
    """Equations z_r = Phi_r."""
    unknowns: list[int]
    """States that they determine."""
    solution: SX | None = None
    """The unknown in terms of z, u, p, t and states of earlier steps; None: iterate."""
    conditions: list[SX] = field(default_factory=list)
    """Must be positive for the solution to be one."""


def solve(plant: Plant, phi: SX, x: SX, z: SX) -> list[Step]:
    """The steps, in an order in which each needs the states of those before it only."""
    pattern = np.array(ca.DM(ca.jacobian_sparsity(phi, x), 1).full(), dtype=bool)
    steps = _order(_blocks(plant, pattern), pattern)
    for step in steps:
        if len(step.rows) == 1:
            row, unknown = step.rows[0], step.unknowns[0]
            isolated = isolate(phi[row], x[unknown], z[row])
            if isolated is not None:
                step.solution, step.conditions = isolated
    return steps


def _blocks(plant: Plant, pattern: np.ndarray[Any, np.dtype[np.bool_]]) -> list[Step]:
    """Diagonal blocks of the block-triangular form of dPhi/dchi."""
    names = [state.name for state in plant.states]
    unseen = [name for k, name in enumerate(names) if not pattern[:, k].any()]
    if unseen:
        raise UserError(
            f"{plant.path}: not observable: no derivative of an output depends on"
            f" {', '.join(unseen)}"
        )
    sparsity = ca.sparsify(ca.DM(pattern.astype(float))).sparsity()
    if ca.sprank(ca.DM(sparsity, 1)) < len(names):
        raise UserError(
            f"{plant.path}: not observable: the derivatives of the outputs depend on too few"
            f" combinations of {', '.join(names)}"
        )
    _, rows, columns, row_ends, column_ends, *_ = sparsity.btf()
    return [
        Step(rows[a:b], columns[c:d])
        for a, b, c, d in zip(row_ends, row_ends[1:], column_ends, column_ends[1:], strict=False)
    ]


def _order(blocks: list[Step], pattern: np.ndarray[Any, np.dtype[np.bool_]]) -> list[Step]:
    ordered: list[Step] = []
    solved: set[int] = set()
    waiting = sorted(blocks, key=lambda step: min(step.unknowns))
    while waiting:
        for step in waiting:
            needed = set(np.flatnonzero(pattern[step.rows].any(axis=0)).tolist())
            if needed <= solved | set(step.unknowns):
                break
        waiting.remove(step)
        ordered.append(step)
        solved |= set(step.unknowns)
    return ordered


def isolate(e: SX, v: SX, target: SX) -> tuple[SX, list[SX]] | None:
    """Solve e(v) = target for v: the solution and what must be positive; None if that fails."""
    conditions: list[SX] = []
    while True:
        slope = ca.jacobian(e, v)
        if not ca.depends_on(slope, v):
            return (target - ca.substitute(e, v, 0)) / slope, conditions
        parts = [e.dep(k) for k in range(e.n_dep())]
        inside = [k for k, part in enumerate(parts) if ca.depends_on(part, v)]
        if len(inside) != 1:
            return None
        undone = _undo(e.op(), inside[0], parts, target)
        if undone is None:
            return None
        target, needs = undone
        conditions += needs
        e = parts[inside[0]]


def _undo(op: int, k: int, parts: list[SX], target: SX) -> tuple[SX, list[SX]] | None:
    """Invert one operation in its k-th operand: that operand's value, and what must be positive."""
    other: SX = parts[1 - k] if len(parts) == 2 else None
    first = k == 0
    simple: dict[int, Callable[[], SX]] = {
        ca.OP_ADD: lambda: target - other,
        ca.OP_SUB: lambda: target + other if first else other - target,
        ca.OP_MUL: lambda: target / other,
        ca.OP_DIV: lambda: target * other if first else other / target,
        ca.OP_NEG: lambda: -target,
        ca.OP_TWICE: lambda: 0.5 * target,
        ca.OP_INV: lambda: 1 / target,
        ca.OP_LOG: lambda: ca.exp(target),
    }
    if op in simple:
        return simple[op](), []
    if op == ca.OP_SQRT:  # the root itself is what must not be negative
        return target * target, [target]
    if op == ca.OP_EXP:
        return ca.log(target), [target]
    if op == ca.OP_TANH:  # artanh
        return 0.5 * ca.log((1 + target) / (1 - target)), [1 - target * target]
    # a power of a base that must be positive anyway: not one with an integer exponent
    if op in (ca.OP_POW, ca.OP_CONSTPOW) and first and other.is_constant():
        exponent = float(other)
        if exponent != round(exponent):
            return target ** (1 / exponent), [target]
    return None
