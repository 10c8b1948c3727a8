"""The figure of a sweep."""

import math
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dse.design.sweep import Case
from dse.plots import PALETTE, STYLE
from dse.run import Floats
from dse.tradeoff import Results, short


def figure(results: Results, networks: Sequence[str], labels: Sequence[str]) -> Figure:
    """Each metric over the values, mean and range of the seeds; of two metrics also their trade."""
    trade = len(labels) == 2 and len(results) > 2
    places, ticks = _axis(list(results))
    keys = ", ".join(short([key for key, _ in next(iter(results))]))
    with mpl.rc_context(STYLE):
        panels = len(labels) + trade
        made = Figure(figsize=(4.4 * min(panels, 3), 3.6 * math.ceil(panels / 3)))
        axes = made.subplots(math.ceil(panels / 3), min(panels, 3), squeeze=False).flatten()
        for unused in axes[panels:]:
            unused.set_axis_off()
        for k, label in enumerate(labels):
            for i, name in enumerate(networks):
                values = _values(results, name, k)
                _line(axes[k], places, values, PALETTE[i % len(PALETTE)], name)
            axes[k].set_title(label)
            axes[k].set_xticks(places, ticks)
            axes[k].set_xlabel(keys)
            _from_zero(axes[k])
        if trade:
            _trade(axes[2], results, networks, labels)
        if len(networks) > 1:
            axes[0].legend()
        return made


def _values(results: Results, network: str, k: int) -> Floats:
    """Metric k by case and seed; what never happened is left out of the figure."""
    values = np.array([[seed[network][k] for seed in seeds] for seeds in results.values()])
    return np.where(np.isfinite(values), values, np.nan)


def _line(ax: Axes, places: Sequence[float], values: Floats, colour: str, name: str) -> None:
    middle = values.mean(axis=1)
    reach = np.stack([middle - values.min(axis=1), values.max(axis=1) - middle])
    bars = reach if values.shape[1] > 1 else None
    ax.errorbar(places, middle, bars, fmt="o-", ms=4, capsize=3, color=colour, label=name)
    for place, value in zip(places, middle, strict=True):
        if not np.isfinite(value):
            ax.annotate("inf", (place, 0.02), xycoords=ax.get_xaxis_transform(), ha="center")


def _trade(ax: Axes, results: Results, networks: Sequence[str], labels: Sequence[str]) -> None:
    for i, name in enumerate(networks):
        x, y = (_values(results, name, k).mean(axis=1) for k in range(2))
        ax.plot(x, y, "o-", ms=4, color=PALETTE[i % len(PALETTE)])
        for case, a, b in zip(results, x, y, strict=True):
            if math.isfinite(a) and math.isfinite(b):
                text = ", ".join(value for _, value in case)
                ax.annotate(text, (a, b), (4, 4), textcoords="offset points", fontsize="x-small")
    ax.set_title("One against the other")
    ax.set_xlabel(labels[0])
    ax.set_ylabel(labels[1])
    _from_zero(ax)


def _from_zero(ax: Axes) -> None:
    """Zero belongs to the axis, unless the values span decades."""
    drawn = np.array([y for line in ax.lines for y in np.asarray(line.get_ydata(), float)])
    drawn = drawn[np.isfinite(drawn)]
    if len(drawn) and drawn.min() > 0 and drawn.max() > 30 * drawn.min():
        ax.set_yscale("log")
    else:
        ax.set_ylim(0, 1.08 * drawn.max() if len(drawn) and drawn.max() > 0 else 1)


def _axis(cases: Sequence[Case]) -> tuple[list[float], list[str]]:
    """Where the cases stand, and what they are called."""
    ticks = ["\n".join(value for _, value in case) for case in cases]
    try:
        places = [float(case[0][1]) for case in cases] if len(cases[0]) == 1 else []
    except ValueError:
        places = []
    if len(set(places)) == len(cases):
        return places, ticks
    return [float(k) for k in range(len(cases))], ticks
