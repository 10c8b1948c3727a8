"""Figures of a tuning sweep."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dse.design.flowchart import Measured
from dse.design.sweep import Case
from dse.plots import PALETTE, STYLE

Results = Mapping[Case, list[list[Measured]]]


@dataclass(frozen=True)
class Axis:
    """Where the cases stand: along one key with numbers, the other keys making lines apart."""

    key: str
    places: dict[Case, float]
    labels: dict[float, str]
    lines: dict[Case, str]
    """What to add to a network's name."""
    logarithmic: bool = False

    @property
    def limits(self) -> tuple[float, float]:
        """The same for all panels, also where a panel has gaps."""
        low, high = min(self.places.values()), max(self.places.values())
        if self.logarithmic:
            margin = (high / low) ** 0.05
            return low / margin, high * margin
        margin = 0.05 * (high - low) or 0.5
        return low - margin, high + margin


def numbers(results: Results, wanted: Sequence[str], unit: str) -> Figure:
    """Speed and noise over the values: mean over the seeds, and their range."""
    axis = _axis(list(results))
    panels = (
        ("late", "Late error", "error / scale"),
        ("reached", "Time until a tenth of the first error", f"[{unit}]"),
        ("noise", "Noise: late error about its moving mean", "error / scale"),
        ("high", "Samples with a high gain", "fraction"),
    )
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.5, 6.2))
        axes = figure.subplots(2, 2)
        for ax, (what, title, label) in zip(axes.flat, panels, strict=True):
            lines = [(n, line) for n in wanted for line in dict.fromkeys(axis.lines.values())]
            for i, (name, line) in enumerate(lines):
                _line(ax, results, axis, name, line, what, PALETTE[i % len(PALETTE)])
            ax.set_title(title)
            ax.set_ylabel(label)
            if axis.logarithmic:
                ax.set_xscale("log")
            ax.set_xticks(list(axis.labels), list(axis.labels.values()))
            ax.minorticks_off()
            ax.set_xlabel(axis.key)
            ax.set_ylim(bottom=0)
            ax.set_xlim(*axis.limits)
        axes[0, 0].legend()
        return figure


def _line(
    ax: Axes, results: Results, axis: Axis, name: str, line: str, what: str, colour: str
) -> None:
    cases = [case for case in results if axis.lines[case] == line]
    values = np.array(
        [
            [
                getattr(one, what)
                for networks in results[case]
                for one in networks
                if one.network == name
            ]
            for case in cases
        ]
    )
    values = np.where(np.isfinite(values), values, np.nan)  # never reached: a gap
    middle = values.mean(axis=1)  # of all seeds, or none
    reach = np.abs(np.stack([values.min(axis=1), values.max(axis=1)]) - middle)
    places = [axis.places[case] for case in cases]
    ax.errorbar(
        places,
        middle,
        reach,
        fmt="o-",
        ms=4,
        capsize=3,
        color=colour,
        label=f"{name} {line}".strip(),
    )


def gains(results: Results, wanted: Sequence[str], unit: str) -> Figure | None:
    """J beside m and J_noise, and theta: one column per network that adapts, first seed."""
    adaptive = [
        name
        for name in wanted
        if any(_first(seeds, name).innovation is not None for seeds in results.values())
    ]
    if not adaptive:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(max(6.5, 4.8 * len(adaptive)), 6.2))
        axes = figure.subplots(2, len(adaptive), squeeze=False, sharex=True)
        for column, name in enumerate(adaptive):
            _gain(axes[0, column], axes[1, column], results, name, unit)
        return figure


def _first(seeds: list[list[Measured]], name: str) -> Measured:
    return next(one for one in seeds[0] if one.network == name)


def _gain(top: Axes, bottom: Axes, results: Results, name: str, unit: str) -> None:
    for k, (case, seeds) in enumerate(results.items()):
        one, colour = _first(seeds, name), PALETTE[k % len(PALETTE)]
        if one.innovation is None:
            continue
        label = ", ".join(f"{key} = {value}" for key, value in case)
        J = one.J.max(axis=1)
        top.plot(one.time[: len(J)], np.where(J > 0, J, np.nan), color=colour, lw=1, label=label)
        top.axhline(one.innovation.m, color=colour, ls="--", lw=1)
        if one.innovation.noise > 0:
            top.axhline(one.innovation.noise, color=colour, ls=":", lw=1)
        bottom.plot(one.time[: len(J)], one.theta.max(axis=1), color=colour, lw=1)
    top.set_yscale("log")
    top.set_title(f"{name}: J (dashed: m, dotted: J of noise alone)")
    bottom.set_title("theta")
    bottom.set_xlabel(f"time [{unit}]")
    top.legend(frameon=True, edgecolor="none", framealpha=0.85)


def _axis(cases: list[Case]) -> Axis:
    for k, (key, _) in enumerate(cases[0]):
        values = dict.fromkeys(case[k][1] for case in cases)
        try:
            places = {value: float(value) for value in values}
        except ValueError:
            continue
        low, high = min(places.values()), max(places.values())
        return Axis(
            key,
            {case: places[case[k][1]] for case in cases},
            {place: value for value, place in places.items()},
            {
                case: ", ".join(value for j, (_, value) in enumerate(case) if j != k)
                for case in cases
            },
            low > 0 and high / low > 5,
        )
    return Axis(
        ", ".join(key for key, _ in cases[0]),
        {case: float(k) for k, case in enumerate(cases)},
        {float(k): "\n".join(value for _, value in case) for k, case in enumerate(cases)},
        dict.fromkeys(cases, ""),
    )
