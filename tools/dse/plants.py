"""The shipped plants' own equations: libdse_plants through ctypes.

The library is built with the agents (build/*/lib/libdse_plants.so). What is designed with it is
designed with the same equations that run.
"""

import ctypes
import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from dse.errors import UserError, unknown
from dse.run import Floats, Signal

ROOT = Path(__file__).resolve().parents[2]
NAME = "libdse_plants.so"
VARIABLE = "DSE_PLANTS"
"""Environment variable with the path of the library."""

_Numbers = ctypes.POINTER(ctypes.c_double)
_STATUS = {
    -1: "an argument is outside its range",
    -4: "a number is not finite",
    -6: "a linear system has no unique solution",
    -8: "the model cannot be evaluated there",
}
"""Of lib/include/dse/status.h, what the calls below can answer."""


class ModelError(Exception):
    """The equations cannot be evaluated."""


@dataclass(frozen=True)
class Parameter:
    """A physical parameter with its allowed range."""

    name: str
    unit: str
    title: str
    low: float
    high: float


@dataclass(frozen=True)
class ParameterSet:
    """One operating case of the plant's source."""

    name: str
    title: str
    values: Floats
    """(n_parameters,)."""
    x0: Floats
    """(nx,)."""


@dataclass(frozen=True)
class Subsystem:
    """Who measures and estimates what."""

    name: str
    states: list[int]
    outputs: list[int]


def find(path: str | Path | None = None) -> Path:
    """The library: as given, from $DSE_PLANTS, or the newest below build/."""
    if given := path or os.environ.get(VARIABLE):
        if not Path(given).is_file():
            raise UserError(f"{given}: no such library of plants")
        return Path(given)
    found = [one for one in ROOT.glob(f"build/*/lib/{NAME}") if not _sanitized(one)]
    built = sorted(found, key=lambda one: one.stat().st_mtime)
    if not built:
        raise UserError(
            f"{NAME} is not built: cmake --preset release && cmake --build --preset release"
            f" --target dse_plants; or name one with --library or in ${VARIABLE}"
        )
    return built[-1]


def _sanitized(path: Path) -> bool:
    """Whether a library wants the address sanitizer loaded first, and ends the process if not."""
    return b"__asan_init" in path.read_bytes()


@cache
def _load(path: Path) -> ctypes.CDLL:
    library = ctypes.CDLL(str(path))
    text, count = ctypes.c_char_p, ctypes.c_int
    for name, answer, arguments in (
        ("at", text, (count,)),
        ("count", count, (text, text)),
        ("text", text, (text, text, count, text)),
        ("number", ctypes.c_double, (text, text, count, text)),
        ("set", count, (text, count, _Numbers, _Numbers)),
        ("members", count, (text, count, text, ctypes.POINTER(count))),
        ("expm", count, (count, _Numbers, _Numbers)),
        ("evaluate", count, (text, _Numbers, text, ctypes.c_double, _Numbers, _Numbers, _Numbers)),
        (
            "simulate",
            count,
            (text, _Numbers, count, ctypes.c_double, count, *[_Numbers] * 4),
        ),
    ):
        function = getattr(library, f"plants_{name}")
        function.restype, function.argtypes = answer, arguments
    return library


def _pointer(values: Floats) -> "ctypes._Pointer[ctypes.c_double]":
    return values.ctypes.data_as(_Numbers)


class Plant:
    """A shipped plant. Times are in its own unit; u may be empty where it has no inputs."""

    def __init__(self, name: str, library: str | Path | None = None) -> None:
        self.name = name
        self._key = name.encode()
        self._library = _load(find(library))
        names: list[str] = []
        while (text := self._library.plants_at(len(names))) is not None:
            names.append(text.decode())
        if name not in names:
            raise unknown("plant", name, names)
        self.states, self.inputs, self.outputs = (
            self._signals(kind) for kind in ("state", "input", "output")
        )
        self.parameters = [
            Parameter(
                self._text("parameter", i, "name"),
                self._text("parameter", i, "unit"),
                self._text("parameter", i, "title"),
                self._number("parameter", i, "min"),
                self._number("parameter", i, "max"),
            )
            for i in range(self._count("parameter"))
        ]
        self.sets = [self._set(i) for i in range(self._count("set"))]
        self.subsystems = [
            Subsystem(
                self._text("subsystem", i, "name"),
                self._members(i, "state", len(self.states)),
                self._members(i, "output", len(self.outputs)),
            )
            for i in range(self._count("subsystem"))
        ]
        self.time_unit = self._text("plant", 0, "time_unit")
        self.time_unit_s = self._number("plant", 0, "time_unit_s")

    def _count(self, kind: str) -> int:
        return int(self._library.plants_count(self._key, kind.encode()))

    def _text(self, kind: str, i: int, field: str) -> str:
        text: bytes = self._library.plants_text(self._key, kind.encode(), i, field.encode())
        return text.decode()

    def _number(self, kind: str, i: int, field: str) -> float:
        number: float = self._library.plants_number(self._key, kind.encode(), i, field.encode())
        return number

    def _signals(self, kind: str) -> list[Signal]:
        return [
            Signal(
                self._text(kind, i, "name"),
                self._text(kind, i, "unit"),
                self._text(kind, i, "title"),
                self._number(kind, i, "scale"),
            )
            for i in range(self._count(kind))
        ]

    def _members(self, subsystem: int, kind: str, room: int) -> list[int]:
        found = (ctypes.c_int * (room + 1))()
        count = self._library.plants_members(self._key, subsystem, kind.encode(), found)
        return list(found[:count])

    def _set(self, i: int) -> ParameterSet:
        values, x0 = np.empty(len(self.parameters)), np.empty(len(self.states))
        self._check(self._library.plants_set(self._key, i, _pointer(values), _pointer(x0)))
        return ParameterSet(self._text("set", i, "name"), self._text("set", i, "title"), values, x0)

    def _check(self, status: int) -> None:
        if status != 0:
            raise ModelError(f"{self.name}: {_STATUS.get(status, f'status {status}')}")

    def set(self, name: str | None = None) -> ParameterSet:
        """The parameter set of that name, None: the first; UserError with near names."""
        for one in self.sets:
            if name in (None, one.name):
                return one
        raise unknown("parameter set", str(name), [one.name for one in self.sets])

    def parameter(self, name: str) -> int:
        """Index of a parameter; UserError with near names."""
        names = [one.name for one in self.parameters]
        if name not in names:
            raise unknown("parameter", name, names)
        return names.index(name)

    @property
    def nominal_inputs(self) -> Floats:
        """(nu,), from the plant's source."""
        return np.array([self._number("input", i, "nominal") for i in range(len(self.inputs))])

    def evaluate(self, what: str, values: Floats, x: Floats, u: Floats, t: float = 0.0) -> Floats:
        """The value of f (nx,), h (ny,), dfdx (nx, nx) or dhdx (ny, nx) at a point; ModelError."""
        nx, ny = len(self.states), len(self.outputs)
        out = np.empty({"f": (nx,), "h": (ny,), "dfdx": (nx, nx), "dhdx": (ny, nx)}[what])
        held = [np.ascontiguousarray(v, dtype=float) for v in (values, x, u)]
        raw = [_pointer(v) for v in held]
        self._check(
            self._library.plants_evaluate(
                self._key, raw[0], what.encode(), t, raw[1], raw[2], _pointer(out)
            )
        )
        return out

    def expm(self, A: Floats) -> Floats:  # noqa: N803
        """exp(A), (n, n), by the library's own function; ModelError."""
        given = np.ascontiguousarray(A, dtype=float)
        out = np.empty_like(given)
        self._check(self._library.plants_expm(len(given), _pointer(given), _pointer(out)))
        return out

    def simulate(
        self, values: Floats, x0: Floats, u: Floats, period: float, steps: int = 0
    ) -> tuple[Floats, Floats]:
        """States (K, nx) and outputs (K, ny) at k period under inputs u (K, nu), held.

        `steps` Runge-Kutta steps per sample, 0: one explicit Euler step. ModelError.
        """
        samples = len(u)
        x, y = np.empty((samples, len(self.states))), np.empty((samples, len(self.outputs)))
        held = [np.ascontiguousarray(v, dtype=float) for v in (values, x0, u)]
        raw = [_pointer(v) for v in held]
        self._check(
            self._library.plants_simulate(
                self._key, raw[0], steps, period, samples, *raw[1:], _pointer(x), _pointer(y)
            )
        )
        return x, y
