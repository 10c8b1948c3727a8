"""A plant written in CasADi: the format of the Python file that `dse design normal-form` reads.

The file begins with

    import casadi as ca
    from dse.design.plant_file import Parameter, ParameterSet, Signal, Subsystem

and defines, at its top level:

    name, title, source     "cstr2", "two stirred tanks with recycle", where it comes from
    time_unit, time_unit_s  "h", 3600: unit of all rates, and seconds in it
    states, outputs         lists of Signal(name, unit, nominal, scale, title); states subsystem by
                            subsystem, outputs too
    parameters              list of Parameter(name, unit, min, max, title), what a scenario may
                            change
    sets                    list of ParameterSet(name, title, {parameter: value}, {state: initial
                            value}); the first is the default
    subsystems              list of Subsystem(name, [states], [output]): who measures and estimates
                            what; with several outputs also chains=[..], how many coordinates each
                            of them gives
    f(t, x, u, p)           -> {state: its derivative}
    h(t, x, u, p)           -> {output: its value}

It may define:

    inputs                  list of Signal: known inputs
    rates                   {input: the input that is its time derivative}; other inputs are held
    inputs_in_map           True (default): coordinates are full time derivatives of the output,
                            z_i2 = y_i' at the present input. False: Lie derivatives along f at
                            u = 0, for inputs that enter f affinely; Phi then has no inputs
    domain(t, x, u, p)      -> list of expressions: there is a plant where all of them are positive
    points                  {name: {state or input: value}}: operating points at which to check,
                            over and above the initial states of the sets; what is left out is
                            nominal

x, u and p give their members as attributes or by name: x.T1, x["T1"]. The functions are called
once, with casadi.SX scalars; use casadi's functions (ca.exp, ca.if_else ..), not math's.
"""

import hashlib
import importlib.util
import math
import re
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

from dse.errors import UserError, unknown

Expression = Any
"""A scalar casadi.SX."""


@dataclass(frozen=True)
class Signal:
    """A state, input or output."""

    name: str
    unit: str
    nominal: float
    """Initial value of a state, constant value of an input."""
    scale: float
    """Size of an ordinary deviation, > 0."""
    title: str


@dataclass(frozen=True)
class Parameter:
    """A physical parameter that a scenario may change."""

    name: str
    unit: str
    min: float
    max: float
    title: str


@dataclass(frozen=True)
class ParameterSet:
    """An operating case: values of all parameters, and the true initial state, by name."""

    name: str
    title: str
    values: Mapping[str, float]
    x0: Mapping[str, float]


@dataclass(frozen=True)
class Subsystem:
    """Own states and own sensors, by name."""

    name: str
    states: Sequence[str]
    outputs: Sequence[str]
    chains: Sequence[int] = ()
    """Coordinates that each output gives, itself included; needed with several outputs only."""


class Values(Mapping[str, Expression]):
    """Symbols by name; an unknown name is the user's mistake."""

    def __init__(self, kind: str, members: Mapping[str, Expression]) -> None:
        self._kind, self._members = kind, dict(members)

    def __getitem__(self, name: str) -> Expression:
        """The symbol called name."""
        if name not in self._members:
            raise unknown(self._kind, name, self._members)
        return self._members[name]

    def __getattr__(self, name: str) -> Expression:
        """The same, as an attribute."""
        if name.startswith("_"):
            raise AttributeError(name)
        return self[name]

    def __iter__(self) -> Iterator[str]:
        """The names."""
        return iter(self._members)

    def __len__(self) -> int:
        """How many there are."""
        return len(self._members)


Function = Callable[[Expression, Values, Values, Values], Any]


@dataclass
class Plant:
    """A plant file, read and checked."""

    path: Path
    digest: str
    """SHA-256 of the file."""
    name: str
    title: str
    source: str
    time_unit: str
    time_unit_s: float
    states: list[Signal]
    inputs: list[Signal]
    outputs: list[Signal]
    parameters: list[Parameter]
    sets: list[ParameterSet]
    subsystems: list[Subsystem]
    f: Function
    h: Function
    domain: Function | None = None
    rates: dict[str, str] = field(default_factory=dict)
    inputs_in_map: bool = True
    points: dict[str, dict[str, float]] = field(default_factory=dict)

    @property
    def blocks(self) -> list[range]:
        """The states of each subsystem."""
        starts = list(accumulate((len(one.states) for one in self.subsystems), initial=0))
        return [range(a, b) for a, b in pairwise(starts)]

    @property
    def chains(self) -> list[range]:
        """The coordinates of each output."""
        lengths = [n for one in self.subsystems for n in (one.chains or [len(one.states)])]
        starts = list(accumulate(lengths, initial=0))
        return [range(a, b) for a, b in pairwise(starts)]

    @property
    def rate_index(self) -> list[int]:
        """Per input the index of the input that is its derivative, or -1."""
        names = [signal.name for signal in self.inputs]
        return [names.index(self.rates[n]) if n in self.rates else -1 for n in names]


def load(path: Path) -> Plant:
    """Read a plant file; UserError says what is wrong and where."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from None
    module = _execute(path)
    given = {name: value for name, value in vars(module).items() if not name.startswith("_")}
    needed = [n for n, f in Plant.__dataclass_fields__.items() if n not in ("path", "digest")]
    optional = ("inputs", "domain", "rates", "inputs_in_map", "points")
    missing = [name for name in needed if name not in given and name not in optional]
    if missing:
        raise UserError(f"{path}: does not define {', '.join(missing)}")
    known = {name: given[name] for name in needed if name in given}
    known.setdefault("inputs", [])
    plant = Plant(path=path, digest=hashlib.sha256(content).hexdigest(), **known)
    _check(plant)
    return plant


def call(plant: Plant, what: str, *arguments: Any) -> Any:  # noqa: ANN401 - a user's function
    """Call f, h or domain of the file; errors in it become UserErrors with the line."""
    try:
        return getattr(plant, what)(*arguments)
    except UserError as error:
        raise UserError(f"{plant.path}: {what}: {error}") from None
    except Exception as error:  # noqa: BLE001 - whatever the user's code raises
        raise _failed(plant.path, error) from None


def _execute(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"_dse_plant_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise UserError(f"{path}: not a Python file; its name must end in .py")
    module = importlib.util.module_from_spec(spec)
    keep, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        spec.loader.exec_module(module)
    except UserError as error:
        raise UserError(f"{path}: {error}") from None
    except Exception as error:  # noqa: BLE001 - whatever the user's code raises
        raise _failed(path, error) from None
    finally:
        sys.dont_write_bytecode = keep
    return module


def _failed(path: Path, error: Exception) -> UserError:
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
    line = error.lineno if isinstance(error, SyntaxError) else frames[-1].lineno if frames else None
    where = f"{path}:{line}" if line else str(path)
    return UserError(f"{where}: {type(error).__name__}: {error}")


def _check(plant: Plant) -> None:
    problem = next(_problems(plant), None)
    if problem:
        raise UserError(f"{plant.path}: {problem}")


KINDS = {
    "states": Signal,
    "inputs": Signal,
    "outputs": Signal,
    "parameters": Parameter,
    "sets": ParameterSet,
    "subsystems": Subsystem,
}


def _type_problems(plant: Plant) -> Iterator[str]:
    for name in ("name", "title", "source", "time_unit"):
        if not isinstance(getattr(plant, name), str):
            yield f"{name}: must be a text"
    if not _finite(plant.time_unit_s) or plant.time_unit_s <= 0:
        yield f"time_unit_s {plant.time_unit_s}: must be a positive number"
    for name, kind in KINDS.items():
        members = getattr(plant, name)
        if not isinstance(members, list) or not all(isinstance(one, kind) for one in members):
            yield f"{name}: must be a list of {kind.__name__}"
    for name in ("f", "h", *(["domain"] if plant.domain is not None else [])):
        if not callable(getattr(plant, name)):
            yield f"{name}: must be a function"
    for name in ("rates", "points"):
        if not isinstance(getattr(plant, name), dict):
            yield f"{name}: must be a dictionary"


def _number_problems(plant: Plant) -> Iterator[str]:
    for signal in [*plant.states, *plant.inputs, *plant.outputs]:
        if not _finite(signal.nominal) or not _finite(signal.scale) or signal.scale <= 0:
            yield f"{signal.name}: nominal and scale must be numbers, scale positive"
    for parameter in plant.parameters:
        if not _finite(parameter.min) or not _finite(parameter.max):
            yield f"parameter {parameter.name}: min and max must be numbers"
    given = [(f"set {one.name}", {**one.values, **one.x0}) for one in plant.sets]
    for where, values in [*given, *((f"points: {n}", v) for n, v in plant.points.items())]:
        yield from (f"{where}: {n} is not a number" for n, v in values.items() if not _finite(v))


def _finite(value: object) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def _problems(plant: Plant) -> Iterator[str]:
    """What is wrong with a plant file, most basic first."""
    yield from _type_problems(plant)
    yield from _number_problems(plant)
    if not re.fullmatch(r"[a-z][a-z0-9_]*", plant.name):
        yield f"name '{plant.name}': small letters, digits and _ only, it becomes a C name"
    for kind in ("states", "outputs", "sets", "subsystems"):
        if not getattr(plant, kind):
            yield f"{kind}: there must be at least one"
    for kind in ("states", "inputs", "outputs", "parameters", "sets", "subsystems"):
        names = [item.name for item in getattr(plant, kind)]
        yield from (f"{kind}: '{n}' twice" for n in _twice(names))
    yield from _set_problems(plant)
    yield from _subsystem_problems(plant)
    inputs = [signal.name for signal in plant.inputs]
    for name in [*plant.rates, *plant.rates.values()]:
        if name not in inputs:
            yield f"rates: {unknown('input', name, inputs)}"
    known = [signal.name for signal in [*plant.states, *plant.inputs]]
    for point, values in plant.points.items():
        yield from (
            f"points: {point}: {unknown('state or input', n, known)}"
            for n in values
            if n not in known
        )


def _set_problems(plant: Plant) -> Iterator[str]:
    states = [state.name for state in plant.states]
    names = [parameter.name for parameter in plant.parameters]
    for one in plant.sets:
        for what, given, wanted in (("values", one.values, names), ("x0", one.x0, states)):
            for name in given:
                if name not in wanted:
                    yield f"set {one.name}: {what}: {unknown('one', name, wanted)}"
            for name in wanted:
                if name not in given:
                    yield f"set {one.name}: {what} has no {name}"
        for p in plant.parameters:
            value = one.values.get(p.name, p.min)
            if not p.min <= value <= p.max:
                yield f"set {one.name}: {p.name} = {value} is not within {p.min}..{p.max}"


def _subsystem_problems(plant: Plant) -> Iterator[str]:
    own = [name for subsystem in plant.subsystems for name in subsystem.states]
    if own != [state.name for state in plant.states]:
        yield (
            "states must be listed subsystem by subsystem, each state in one of them: the"
            f" subsystems have {', '.join(own)}"
        )
    measured = [name for subsystem in plant.subsystems for name in subsystem.outputs]
    if measured != [output.name for output in plant.outputs]:
        yield (
            "outputs must be listed subsystem by subsystem, each output in one of them: the"
            f" subsystems have {', '.join(measured)}"
        )
    for one in plant.subsystems:
        n, outputs, chains = len(one.states), len(one.outputs), list(one.chains)
        if not outputs:
            yield f"subsystem {one.name}: has no output to be seen through"
        elif outputs > 1 and not chains:
            yield (
                f"subsystem {one.name}: has {outputs} outputs: chains must say how many coordinates"
                " each of them gives"
            )
        elif chains and (len(chains) != outputs or sum(chains) != n or min(chains) < 1):
            yield (
                f"subsystem {one.name}: chains {chains} must be {outputs} positive numbers with the"
                f" sum {n}"
            )


def _twice(names: Iterable[str]) -> list[str]:
    seen: set[str] = set()
    return [name for name in names if name in seen or seen.add(name)]  # type: ignore[func-returns-value]
