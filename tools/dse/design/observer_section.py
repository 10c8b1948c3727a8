"""The scenario section `distributed_observer` as `dse design` writes it.

    distributed_observer:
      residual: neighbours      or own: whose residual teaches the gains
      gain: edge                or node
      gamma: 0.01               adaptation rate
      leak: 0.01                left out: none
      states: [2]               plant states that functionals pick; left out: all
      nodes:
        - Lambda: [..]          z' = Lambda z + L y + H u + coupling      nz x nz
          L: [..]               nz x ny, y as the node's sensors give it
          H: [..]               nz x nu; left out: no known inputs
          M: [..]               xh = M z + N y + J u                      nx x nz
          N: [..]               nx x ny
          J: [..]               nx x nu; left out: zero
          z0: [..]              nz
          Pi: [..]              Lambda'Pi + Pi Lambda = -I                nz x nz
          C2: [..]              rows in which estimates are compared      k x nx; left out: all
          D: [..]               own residual r = D z + D_y y + D_u u      nr x nz
          D_y: [..]             nr x ny
          D_u: [..]             nr x nu; left out: zero

Matrices are flat, row by row, with the meaning of struct dse_distributed_observer_config in
lib/include/dse/distributed_observer.h. nz, nx and ny follow from the lengths of Lambda, M and N.
Behind the section stands `design:`, all matrices on the way with the names of the source, as rows;
a scenario does not need them.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dse.design.algebra import Floats

ORDER = ("Lambda", "L", "H", "M", "N", "J", "z0", "Pi", "C2", "D", "D_y", "D_u")
OPTIONAL = ("H", "J", "C2", "D_u")
"""May be None: left out."""


@dataclass
class ObserverNode:
    """One node's matrices under the section's keys, and those on the way to them."""

    Lambda: Floats
    L: Floats
    H: Floats
    M: Floats
    N: Floats
    J: Floats
    z0: Floats
    Pi: Floats
    C2: Floats | None = None
    D: Floats | None = None
    D_y: Floats | None = None
    D_u: Floats | None = None
    design: dict[str, Floats] = field(default_factory=dict)
    """Names of the source."""
    checks: dict[str, float] = field(default_factory=dict)
    """Identities and their largest residuals."""


@dataclass(frozen=True)
class Coupling:
    """The scalars of the section."""

    residual: str
    gain: str
    gamma: float
    leak: float = 0.0
    states: list[int] | None = None


def text(head: str, coupling: Coupling, nodes: list[ObserverNode]) -> str:
    """The YAML file; head goes into comments."""
    lines = [f"# {line}".rstrip() for line in head.splitlines()]
    lines += ["distributed_observer:", f"  residual: {coupling.residual}"]
    lines += [f"  gain: {coupling.gain}", f"  gamma: {_number(coupling.gamma)}"]
    if coupling.leak > 0:
        lines.append(f"  leak: {_number(coupling.leak)}")
    if coupling.states is not None:
        lines.append(f"  states: {coupling.states}")
    lines.append("  nodes:")
    for node in nodes:
        lead = "    - "
        for key in ORDER:
            value = getattr(node, key)
            if value is None or value.size == 0:
                continue
            if key in OPTIONAL and key != "C2" and not clean(value).any():
                continue
            lines.append(f"{lead}{key}: {flat(value)}")
            lead = "      "
    return "\n".join([*lines, *design_lines([(n.design, n.checks) for n in nodes]), ""])


def design_lines(nodes: list[tuple[dict[str, Floats], dict[str, float]]]) -> list[str]:
    """The part `design:` with matrices as rows and the checks that were made."""
    lines = ["design:", "  nodes:"]
    for matrices, checks in nodes:
        lead = "    - "
        for key, value in matrices.items():
            lines.append(f"{lead}{key}: {rows(value)}")
            lead = "      "
        if checks:
            done = ", ".join(f'"{what}": {_number(value)}' for what, value in checks.items())
            lines.append(f"{lead}residuals: {{{done}}}")
    return lines


def clean(A: Floats) -> Floats:
    """The matrix with rounding errors around zero put to zero: below 1e-14 of its largest entry.

    The largest entry counts as at least 1: what was computed from numbers of that size.
    """
    size = max(1.0, float(np.abs(A).max(initial=0)))
    return np.where(np.abs(A) < 1e-14 * size, 0.0, A)


def flat(A: Floats) -> str:
    """All entries in one list."""
    return "[" + ", ".join(_number(value) for value in clean(A).ravel()) + "]"


def rows(A: Floats) -> str:
    """A list of rows."""
    return "[" + ", ".join(flat(row) for row in np.atleast_2d(clean(A))) + "]"


def _number(value: float) -> str:
    found = repr(float(value))
    # YAML 1.1 takes 1e-05 for a text: a number with an exponent needs a point
    return found.replace("e", ".0e") if "e" in found and "." not in found else found


def write(path: Path | None, content: str) -> None:
    """Into the file, or to standard output."""
    if path is None:
        print(content, end="")
    else:
        path.write_text(content)
