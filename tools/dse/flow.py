"""The flow benchmark of the simulator (sim/flow.h): libdse_plants through ctypes.

n x n cells, first index x. A state is the vector (psi, c, T) of a stream function at the inner
corners and two scalars at the cells' centres; a velocity w is the vector of u on the faces across
x, (n + 1) x n, then v on the faces across y, n x (n + 1).
"""

import ctypes
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from dse.errors import UserError
from dse.plants import find
from dse.run import Floats

CELLS = 32
PERIOD = 0.25
"""Between snapshots."""
DT = 0.025
SNAPSHOTS = 41
TEST, *TRAIN = range(4)
"""Numbers of the runs."""
SENSORS = ((9, 9), (22, 9), (22, 22), (9, 22))
"""Cells of the benchmark's four sensors."""

_Numbers = ctypes.POINTER(ctypes.c_double)


@cache
def _load(path: Path) -> ctypes.CDLL:
    library = ctypes.CDLL(str(path))
    count, text = ctypes.c_int, ctypes.c_char_p
    for name, arguments in (
        ("start", (count, count, _Numbers)),
        ("sources", (count, count, _Numbers)),
        ("rhs", (count, count, _Numbers, _Numbers)),
        ("advance", (count, count, count, ctypes.c_double, count, _Numbers)),
        ("velocity", (count, _Numbers, _Numbers)),
        ("operator", (count, text, _Numbers, _Numbers, _Numbers)),
    ):
        try:
            getattr(library, f"flow_{name}").argtypes = arguments
        except AttributeError:
            raise UserError(f"{path} is too old to know flows: build dse_plants again") from None
    return library


def _pointer(values: Floats) -> "ctypes._Pointer[ctypes.c_double]":
    return values.ctypes.data_as(_Numbers)


@dataclass(frozen=True)
class Flow:
    """The flow on n x n cells, free or forced."""

    forced: bool = False
    n: int = CELLS
    library: Path | None = None

    @property
    def faces(self) -> int:
        """Numbers in a velocity."""
        return 2 * self.n * (self.n + 1)

    @property
    def cells(self) -> int:
        """Numbers in a scalar field."""
        return self.n**2

    @property
    def corners(self) -> int:
        """Numbers in a stream function."""
        return (self.n - 1) ** 2

    @property
    def size(self) -> int:
        """Numbers in a state."""
        return self.corners + 2 * self.cells

    @property
    def _call(self) -> ctypes.CDLL:
        return _load(find(self.library))

    def start(self, run: int) -> Floats:
        """The initial state of a run, TEST or one of TRAIN."""
        z = np.empty(self.size)
        if self._call.flow_start(self.n, run, _pointer(z)) != 0:
            raise ValueError(f"run {run} of {self.n} x {self.n} cells")
        return z

    def rhs(self, z: Floats) -> Floats:
        """The derivative of a state."""
        given, out = np.ascontiguousarray(z), np.empty(self.size)
        self._call.flow_rhs(self.n, int(self.forced), _pointer(given), _pointer(out))
        return out

    def advance(
        self, z: Floats, samples: int = SNAPSHOTS, period: float = PERIOD, dt: float = DT
    ) -> Floats:
        """States (samples, size), the first one z, `period` apart, in Runge-Kutta steps of dt."""
        states = np.empty((samples, self.size))
        states[0] = z
        steps = round(period / dt)
        self._call.flow_advance(self.n, int(self.forced), steps, dt, samples, _pointer(states))
        return states

    def sources(self) -> tuple[Floats, Floats, Floats]:
        """The force on the faces, the sources of contaminant and heat in the cells."""
        out = np.empty(self.faces + 2 * self.cells)
        self._call.flow_sources(self.n, int(self.forced), _pointer(out))
        force, contaminant, heat = np.split(out, [self.faces, self.faces + self.cells])
        return force, contaminant, heat

    def fields(self, z: Floats) -> tuple[Floats, Floats, Floats]:
        """Velocity, contaminant and temperature of a state."""
        psi, c, T = np.split(z, [self.corners, self.corners + self.cells])  # noqa: N806
        return self.velocity(psi), c, T

    def velocity(self, psi: Floats) -> Floats:
        """The velocity of a stream function."""
        given, w = np.ascontiguousarray(psi), np.empty(self.faces)
        self._call.flow_velocity(self.n, _pointer(given), _pointer(w))
        return w

    def convection(self, by: Floats, field: Floats) -> Floats:
        """(by . grad) of a velocity or scalar field."""
        return self._operator(b"c" if field.size == self.faces else b"C", by, field)

    def laplacian(self, field: Floats) -> Floats:
        """The Laplacian of a velocity or scalar field."""
        return self._operator(b"l" if field.size == self.faces else b"L", field, field)

    def _operator(self, what: bytes, by: Floats, field: Floats) -> Floats:
        carried, given = np.ascontiguousarray(by), np.ascontiguousarray(field)
        out = np.empty(field.size)
        self._call.flow_operator(self.n, what, _pointer(carried), _pointer(given), _pointer(out))
        return out

    def components(self, w: Floats) -> tuple[Floats, Floats]:
        """U (n + 1, n) and v (n, n + 1) of a velocity."""
        n = self.n
        return w[: n * (n + 1)].reshape(n + 1, n), w[n * (n + 1) :].reshape(n, n + 1)

    def at_centres(self, w: Floats) -> tuple[Floats, Floats]:
        """The means (n, n) of a velocity's components at the cells' centres."""
        u, v = self.components(w)
        return (u[1:] + u[:-1]) / 2, (v[:, 1:] + v[:, :-1]) / 2
