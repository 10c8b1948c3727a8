"""A shipped plant around a point, as the linear plant of a scenario.

    x' = f(x, u)   becomes   x(k+1) = o + A (x(k) - o),  A = exp(df/dx(o) T),  y = C x

with f and its Jacobian from the plant's own equations and the library's own matrix exponential. The
inputs stay what they are at the point. Without --period: x' = A (x - o) with A = df/dx(o).

For example

    dse design linearise sep3 --period 18 -o sep3.yaml
    dse design linearise cstr2 --set cdm --period 18

The section has the subsystems of the plant: `groups` counts their outputs, `blocks` their states.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dse.errors import UserError, unknown
from dse.plants import ModelError, Plant
from dse.run import Floats

NAME = "linearise"
HELP = "a shipped plant around its steady state, as a scenario's linear plant"

STEPS = 100
"""Of Newton's method at most."""
REST = 1e-13
"""At rest: Newton's step is below this part of each state's size."""
SHORTEST = 1e-6
"""Newton's step is not shortened below this part of itself."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("plant", metavar="PLANT", help="a shipped plant: sep3")
    parser.add_argument("--set", metavar="NAME", help="its parameter set, default the first")
    parser.add_argument(
        "--at",
        metavar="steady|initial|STATE=VALUE,..",
        default="steady",
        help="steady (default): where it rests, searched from the initial state; initial: the"
        " initial state itself; or the initial state with these changes",
    )
    parser.add_argument("--inputs", metavar="U1,U2,..", help="constant inputs, default the nominal")
    parser.add_argument("--period", metavar="SECONDS", type=float, help="sampling period")
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, help="default: the terminal")
    parser.add_argument(
        "--library", metavar="FILE", help="libdse_plants.so, default the newest below build/"
    )


@dataclass
class Linear:
    """The plant around a point."""

    origin: Floats
    """(n,)."""
    A: Floats
    """(n, n), of one period when there is one, else the Jacobian."""
    C: Floats
    """(q, n), rows in the order of the subsystems."""
    jacobian: Floats
    """(n, n), per unit of plant time."""


def steady_state(plant: Plant, values: Floats, u: Floats, start: Floats) -> Floats:
    """Where f(x, u) = 0, (n,): Newton's method from `start` with shortened steps; UserError."""
    scale = np.array([state.scale for state in plant.states])

    def size(x: Floats) -> float:
        try:
            return float(np.linalg.norm(plant.evaluate("f", values, x, u) / scale))
        except ModelError:
            return np.inf

    x = start.astype(float).copy()
    for _ in range(STEPS):
        try:
            step = -np.linalg.solve(
                plant.evaluate("dfdx", values, x, u), plant.evaluate("f", values, x, u)
            )
        except (ModelError, np.linalg.LinAlgError) as error:
            raise UserError(f"{plant.name}: no steady state from there ({error})") from None
        if (np.abs(step) <= REST * (np.abs(x) + scale)).all():
            return np.asarray(x + step)
        part, now = 1.0, size(x)
        # close to rest rounding decides, and the whole step is right
        while size(x + part * step) > (1 - part / 4) * now and now > 1e-9 and part > SHORTEST:
            part /= 2
        if part <= SHORTEST:
            break
        x = x + part * step
    raise UserError(
        f"{plant.name}: Newton's method finds no steady state from the initial state; name one"
        " near it with --at"
    )


def linearise(
    plant: Plant, values: Floats, u: Floats, origin: Floats, period: float | None = None
) -> Linear:
    """Around `origin`; period in the plant's time unit. UserError where outputs are not C x."""
    jacobian = plant.evaluate("dfdx", values, origin, u)
    rows = [j for one in plant.subsystems for j in one.outputs]
    C = plant.evaluate("dhdx", values, origin, u)[rows]  # noqa: N806
    y = plant.evaluate("h", values, origin, u)[rows]
    if np.abs(C @ origin - y).max(initial=0) > 1e-9 * np.abs(y).max(initial=1):
        raise UserError(f"{plant.name}: its outputs are not linear in the states")
    A = jacobian if period is None else plant.expm(jacobian * period)  # noqa: N806
    return Linear(origin, A, C, jacobian)


def _number(value: float) -> str:
    """All digits, as YAML takes them for a number."""
    text = repr(float(value))
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def _matrix(name: str, rows: Floats) -> str:
    lines = (",\n      ".join(", ".join(map(_number, row)) for row in rows)).strip()
    return f"    {name}: [\n      {lines}]\n"


def section(plant: Plant, found: Linear, period_s: float | None) -> str:
    """The YAML section `plant` of a scenario."""
    blocks = [len(one.states) for one in plant.subsystems]
    order = [i for one in plant.subsystems for i in one.states]
    names = ", ".join(one.name for one in plant.states)
    origin = ", ".join(map(_number, found.origin))
    kind = "continuous" if period_s is None else "discrete"
    text = f"plant:\n  name: linear\n  linear:\n    time: {kind}\n"
    text += f"    unit_s: {_number(plant.time_unit_s)}\n    nx: {len(found.A)}\n"
    text += _matrix("A", found.A) + _matrix("C", found.C)
    text += f"    origin: [{origin}]\n    states: [{names}]\n"
    text += f"    groups: [{', '.join(str(len(one.outputs)) for one in plant.subsystems)}]\n"
    if order == list(range(len(found.A))):
        text += f"    blocks: [{', '.join(map(str, blocks))}]\n"
    return text


def point(plant: Plant, values: Floats, x0: Floats, u: Floats, at: str) -> Floats:
    """The state that --at asks for, (n,); UserError."""
    if at == "steady":
        return steady_state(plant, values, u, x0)
    names = [state.name for state in plant.states]
    x = x0.astype(float).copy()
    for part in at.split(",") if at != "initial" else []:
        name, _, value = part.partition("=")
        if name not in names:
            raise unknown("state", name, [*names, "steady", "initial"])
        try:
            x[names.index(name)] = float(value)
        except ValueError:
            raise UserError(f"--at {at}: '{value}' is not a number") from None
    return x


def _inputs(plant: Plant, text: str | None) -> Floats:
    if text is None:
        return plant.nominal_inputs
    try:
        u = np.array([float(value) for value in text.split(",")])
    except ValueError:
        raise UserError(f"--inputs {text}: not numbers") from None
    if len(u) != len(plant.inputs):
        raise UserError(f"--inputs: {plant.name} has {len(plant.inputs)} inputs, not {len(u)}")
    return u


def _about(plant: Plant, options: argparse.Namespace, found: Linear) -> str:
    poles = np.linalg.eigvals(found.jacobian)
    shown = ", ".join(
        f"{pole.real:.4g}" + (f"{pole.imag:+.4g}i" if abs(pole.imag) > 1e-9 * abs(pole) else "")
        for pole in poles[np.argsort(poles.real)]
    )
    where = {"steady": "its steady state", "initial": "its initial state"}
    words = [plant.name, *(["--set", options.set] if options.set else [])]
    words += ["--at", options.at] if options.at != "steady" else []
    words += ["--inputs", options.inputs] if options.inputs else []
    words += ["--period", f"{options.period:.15g}"] if options.period else []
    return (
        f"# {plant.name} around {where.get(options.at, options.at)}, by"
        f" dse design linearise {' '.join(words)}\n"
        f"# eigenvalues of the Jacobian in 1/{plant.time_unit}: {shown}\n"
    )


def run(options: argparse.Namespace) -> int:
    """Print or write the section."""
    if options.period is not None and not options.period > 0:
        raise UserError(f"--period {options.period}: must be positive")
    plant = Plant(options.plant, options.library)
    chosen, u = plant.set(options.set), _inputs(plant, options.inputs)
    period = None if options.period is None else options.period / plant.time_unit_s
    try:
        origin = point(plant, chosen.values, chosen.x0, u, options.at)
        found = linearise(plant, chosen.values, u, origin, period)
    except ModelError as error:
        raise UserError(str(error)) from None
    text = _about(plant, options, found) + section(plant, found, options.period)
    if options.output is None:
        print(text, end="")
    else:
        options.output.write_text(text)
    return 0
