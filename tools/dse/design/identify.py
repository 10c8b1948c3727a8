"""Identify parameters of a shipped plant from the inputs and outputs in a log.

The first part of the record trains, the rest validates. Parameters are found by
Levenberg-Marquardt on the simulated minus the measured outputs, each in units of its scale (output
error); the model is advanced by one Euler step per sample, or by --steps Runge-Kutta steps. It
starts from the state that --x0 says, by default that of the parameter set, and runs freely over
the whole record, so the inputs may well come from a closed loop.

    fit = 100 (1 - |y - yhat| / |y - mean y|)   of each output, in percent

Intervals are 95 % and believe in white noise and in the model. The list that -o writes goes under
`parameters:` of a scenario's plant or network.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dse.commands import add_log, read_run
from dse.errors import UserError
from dse.plants import Plant
from dse.run import Floats, Run
from dse.tables import console, number, table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dse.design import output_error

NAME = "identify"
HELP = "parameters of a plant from a log"


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_log(parser)
    parser.add_argument(
        "--fit", metavar="NAMES", required=True, help="parameters to find, as ap1,ap2"
    )
    parser.add_argument("--set", metavar="NAME", help="parameter set to start from")
    parser.add_argument(
        "--start",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="start value of a parameter, or value of one that is not sought; may be repeated",
    )
    parser.add_argument("--x0", metavar="VALUES", help="state at the first sample, as 51,35,16")
    parser.add_argument(
        "--train",
        metavar="PART",
        type=float,
        default=0.75,
        help="part of the record that trains, default 0.75",
    )
    parser.add_argument(
        "--steps", type=int, default=0, help="Runge-Kutta steps per sample, default 0: Euler"
    )
    parser.add_argument(
        "--library", metavar="FILE", help="libdse_plants.so, default the newest below build/"
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="folder for parameters.yaml and identify.png",
    )


def run(options: argparse.Namespace) -> int:
    """Fit, judge, write."""
    from dse.design import output_error

    found_run = read_run(options)
    plant = Plant(str((found_run.info.get("plant") or {}).get("name") or ""), options.library)
    problem = _problem(options, found_run, plant)
    found = output_error.identify(problem)
    out = console()
    made = table("Parameters", "name", "unit", "start", "value", "+- 95 %", "relative", left=2)
    for i, name in enumerate(problem.names):
        value, half = float(found.value[i]), float(found.half_width[i])
        unit = plant.parameters[plant.parameter(name)].unit
        relative = f"{100 * half / abs(value):.2g} %" if value else "-"
        made.add_row(
            name, unit, number(float(found.start[i])), f"{value:.6g}", number(half), relative
        )
    out.print(made)
    made = table("Fit in percent", "output", "training", "validation")
    for j, output in enumerate(plant.outputs):
        made.add_row(output.name, f"{found.fit_train[j]:.1f}", f"{found.fit_validation[j]:.1f}")
    out.print(made)
    _warn(out.print, plant, problem.names, found)
    print(f"{found.evaluations} simulations of {problem.train} samples")
    if options.output:
        _write(options.output, found_run, problem, found)
    return 0


def _problem(options: argparse.Namespace, found: Run, plant: Plant) -> "output_error.Problem":
    from dse.design import output_error

    chosen = plant.set(options.set)
    values = chosen.values.copy()
    for text in options.start:
        name, _, value = text.partition("=")
        values[plant.parameter(name)] = _number(f"--start {text}", value)
    names = [name.strip() for name in options.fit.split(",") if name.strip()]
    for name in names:
        plant.parameter(name)
    x0 = chosen.x0
    if options.x0:
        x0 = np.array([_number(f"--x0 {options.x0}", part) for part in options.x0.split(",")])
        if len(x0) != len(plant.states):
            raise UserError(
                f"--x0 has {len(x0)} values; {plant.name} has {len(plant.states)} states:"
                f" {', '.join(state.name for state in plant.states)}"
            )
    if not 0 < options.train < 1:
        raise UserError(f"--train {options.train}: a part is between 0 and 1")
    data = _data(found, plant)
    train = round(options.train * len(data.y))
    if train < len(names) or train == len(data.y):
        raise UserError(f"{len(data.y)} samples are too few")
    if options.steps < 0:
        raise UserError(f"--steps {options.steps}: must be 0 or more")
    return output_error.Problem(plant, data, train, names, values, x0, options.steps)


def _number(where: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise UserError(f"{where}: '{text}' is not a number") from None


def _data(found: Run, plant: Plant) -> "output_error.Data":
    """Inputs and outputs of all samples from the first to the last input."""
    from dse.design import output_error

    sample = found.input.sample
    period = float((found.info.get("time") or {}).get("period") or 0)
    if len(sample) < 2 or not period > 0:
        raise UserError("the log has no inputs to simulate the model with")
    count = int(sample[-1]) + 1
    if sample[0] != 0 or len(sample) != count:
        raise UserError(
            f"the log has inputs of {len(sample)} of {count} samples: the model cannot be simulated"
        )
    y: Floats = np.full((count, len(plant.outputs)), np.nan)
    names = [output.name for output in plant.outputs]
    for signals, series in found.measurements.values():
        inside = series.sample < count
        for column, signal in enumerate(signals):
            y[series.sample[inside], names.index(signal.name)] = series.value[inside, column]
    return output_error.Data(period, found.input.value, y)


def _warn(
    say: Callable[[str], object], plant: Plant, names: list[str], found: "output_error.Found"
) -> None:
    for one, other, correlation in found.coupled(names):
        say(f"{one} and {other} are hard to tell apart: correlation {correlation:.3f}")
    for i, name in enumerate(names):
        parameter = plant.parameters[plant.parameter(name)]
        if not parameter.low <= found.value[i] <= parameter.high:
            say(f"{name} is outside its range {parameter.low:g} .. {parameter.high:g}")
    poor = [
        output.name
        for output, value in zip(plant.outputs, found.fit_validation, strict=True)
        if not value > 50
    ]
    if poor:
        say(
            f"{', '.join(poor)}: less than half of the variation is explained; it is small beside"
            " the noise, or the model misses something there"
        )


def _write(
    where: Path, found_run: Run, problem: "output_error.Problem", found: "output_error.Found"
) -> None:
    from dse.plots import save

    where.mkdir(parents=True, exist_ok=True)
    scenario = found_run.scenario.get("name") or "a log"
    lines = [f"# {problem.plant.name}: dse design identify, from {scenario}"]
    for name, value, half in zip(problem.names, found.value, found.half_width, strict=True):
        # repr gives a C program the same double back
        lines.append(f"- {{name: {name}, value: {float(value)!r}}} # +- {half:.2g}")
    parameters = where / "parameters.yaml"
    parameters.write_text("\n".join(lines) + "\n")
    picture = where / "identify.png"
    save(_figure(problem, found), picture)
    print(parameters, picture, sep="\n")


def _figure(problem: "output_error.Problem", found: "output_error.Found") -> "Figure":
    """Measured and simulated outputs, with the border between training and validation."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    from dse.plots import PALETTE, STYLE

    plant, data = problem.plant, problem.data
    time = np.arange(len(data.y)) * data.period
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.5, 2.3 * len(plant.outputs) + 0.6))
        axes = figure.subplots(len(plant.outputs), 1, sharex=True, squeeze=False)[:, 0]
        for j, (axis, output) in enumerate(zip(axes, plant.outputs, strict=True)):
            axis.plot(time, data.y[:, j], color="#b8bec6", linewidth=0.8, label="measured")
            axis.plot(time, found.simulated[:, j], color=PALETTE[0], label="model")
            axis.axvline(time[problem.train], color="#555555", linestyle=":")
            axis.set_ylabel(output.label)
            axis.set_title(
                f"{output.title}: fit {found.fit_train[j]:.0f} % training,"
                f" {found.fit_validation[j]:.0f} % validation"
            )
        axes[0].legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, borderaxespad=0)
        axes[-1].set_xlabel(f"time [{plant.time_unit}]")
    return figure
