"""Figures of a run, as functions of its data."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from dse.log import HEALTH, TRACKING, Network, Node, Run
from dse.metrics import errors

TRUTH = "#111111"
# Distinct in hue and in lightness, also for colour-blind readers (after Okabe and Ito).
PALETTE = (
    *("#d1495b", "#1f78b4", "#e69f00", "#00876c", "#8e5ea2", "#56b4e9", "#8c564b", "#7a7a7a"),
)
HEALTH_COLOURS = ("#9aa5b1", "#4c9f70", "#e9b949", "#e07b39", "#b3261e", "#7b5ea7")
STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["Inter", "Helvetica Neue", "Arial", "Liberation Sans", "DejaVu Sans"],
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelcolor": "#333333",
    "axes.edgecolor": "#888888",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "grid.color": "#e6e8eb",
    "grid.linewidth": 0.8,
    "xtick.color": "#555555",
    "ytick.color": "#555555",
    "legend.frameon": False,
    "lines.linewidth": 1.5,
    "figure.constrained_layout.use": True,
    "savefig.dpi": 150,
}

LineStyle = Literal["-"] | tuple[float, tuple[float, ...]]
Colours = dict[str, str]
"""Colour of each network by name."""


def colours(run: Run) -> Colours:
    """The same network has the same colour in all figures of a run."""
    return {network.name: PALETTE[i % len(PALETTE)] for i, network in enumerate(run.networks)}


def save(figure: Figure, path: Path) -> None:
    """Write a figure; the ending of the path decides on the format."""
    with mpl.rc_context(STYLE):
        FigureCanvasAgg(figure)
        figure.savefig(path)


def state(run: Run, index: int, networks: Sequence[Network], style: Colours) -> Figure:
    """One state: truth and estimates, their error, and its magnitude on a logarithmic axis."""
    signal = run.states[index]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.5, 6.2))
        grid = figure.add_gridspec(2, 2, height_ratios=(1.25, 1))
        top = figure.add_subplot(grid[0, :])
        linear = figure.add_subplot(grid[1, 0])
        logarithmic = figure.add_subplot(grid[1, 1])
        _estimates(top, run, index, networks, style)
        top.set_title(f"{signal.name}: {signal.title}" if signal.title else signal.name)
        _errors(linear, run, index, networks, style)
        linear.set_title("Estimate minus truth")
        _magnitudes(logarithmic, run, index, networks, style)
        logarithmic.set_title("Magnitude of the error")
        for axes in (top, linear, logarithmic):
            axes.set_xlabel(_time_label(run))
        top.set_ylabel(signal.label)
        linear.set_ylabel(f"error of {signal.label}")
        logarithmic.set_ylabel(f"|error| of {signal.label}")
        _legend(figure, networks, style, truth=len(run.truth.sample) > 0)
    return figure


def overview(
    run: Run,
    states: Sequence[int],
    networks: Sequence[Network],
    style: Colours,
    title: str | None = None,
) -> Figure:
    """Several states in a grid, truth and estimates."""
    columns = 1 if len(states) == 1 else 2 if len(states) <= 8 else 3
    rows = -(-len(states) // columns)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.9 * columns, 2.35 * rows + 0.6))
        grid = figure.subplots(rows, columns, squeeze=False, sharex=True)
        for axes, index in zip(grid.flat, states, strict=False):
            signal = run.states[index]
            _estimates(axes, run, index, networks, style)
            axes.set_title(signal.title or signal.name, fontsize=10)
            axes.set_ylabel(signal.label)
        for axes in grid.flat[len(states) :]:
            axes.set_visible(False)
        for column in range(columns):
            last = max(i for i in range(len(states)) if i % columns == column)
            grid.flat[last].set_xlabel(_time_label(run))
            grid.flat[last].tick_params(labelbottom=True)
        if title:
            figure.suptitle(title, x=0.01, ha="left", fontweight="bold", fontsize=12)
        _legend(figure, networks, style, truth=len(run.truth.sample) > 0)
    return figure


def diagnostics(
    run: Run, names: Sequence[str], networks: Sequence[Network], style: Colours
) -> Figure:
    """Methods' own quantities, one panel each, all nodes that have them."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.5, 2.9 * len(names) + 0.5))
        grid = figure.subplots(len(names), 1, squeeze=False, sharex=True)
        used: dict[str, Network] = {}
        for axes, name in zip(grid.flat, names, strict=True):
            unit = ""
            for network in networks:
                for node, nth, line in _styled(network):
                    column = [signal.name for signal in node.diagnostics]
                    if name not in column:
                        continue
                    i = column.index(name)
                    unit = node.diagnostics[i].unit
                    axes.plot(
                        node.estimates.time,
                        node.estimates.diagnostic[:, i],
                        color=style[network.name],
                        linestyle=line,
                        alpha=nth,
                    )
                    used[network.name] = network
            axes.set_title(name)
            axes.set_ylabel(f"{name} [{unit}]" if unit else name)
        grid[-1, 0].set_xlabel(_time_label(run))
        _legend(figure, list(used.values()), style, truth=False, nodes=True)
    return figure


def health(run: Run, networks: Sequence[Network]) -> Figure:
    """Which health every node reported when."""
    nodes = [(network, node) for network in networks for node in network.nodes]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.5, 0.9 + 0.34 * len(nodes) + 0.5))
        axes = figure.subplots()
        seen: set[int] = set()
        for row, (_, node) in enumerate(nodes):
            seen |= _timeline(axes, row, run, node)
        axes.set_yticks(
            range(len(nodes)), [f"{network.name} / {node.name}" for network, node in nodes]
        )
        axes.set_ylim(len(nodes) - 0.4, -0.6)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel(_time_label(run))
        axes.autoscale_view(scaley=False)
        axes.margins(x=0.01)
        patches = [Patch(color=HEALTH_COLOURS[i], label=HEALTH[i]) for i in sorted(seen)]
        figure.legend(handles=patches, loc="outside upper left", ncols=len(HEALTH))
    return figure


def always_tracking(networks: Iterable[Network]) -> bool:
    """True when no node ever reported anything else."""
    return all(
        bool((node.estimates.health == TRACKING).all())
        for network in networks
        for node in network.nodes
    )


def _timeline(axes: Axes, row: int, run: Run, node: Node) -> set[int]:
    """Bars of equal health; returns what there was."""
    estimates = node.estimates
    if not len(estimates.sample):
        return set()
    starts = np.flatnonzero(np.diff(estimates.health, prepend=np.int8(-1)) != 0)
    period = float((run.info.get("time") or {}).get("period") or 0)
    edges = np.append(estimates.time[starts], estimates.time[-1] + period)
    codes = estimates.health[starts].clip(0, len(HEALTH) - 1)
    bars = [
        [(a, row - 0.33), (b, row - 0.33), (b, row + 0.33), (a, row + 0.33)]
        for a, b in zip(edges[:-1], edges[1:], strict=True)
    ]
    # The edge gives a single sample a visible width.
    tints = [HEALTH_COLOURS[code] for code in codes]
    axes.add_collection(PolyCollection(bars, facecolors=tints, edgecolors=tints, linewidths=0.6))
    return set(codes.tolist())


def _time_label(run: Run) -> str:
    return f"time [{run.time_unit}]" if run.time_unit else "time"


def _styled(network: Network) -> list[tuple[Node, float, LineStyle]]:
    """Nodes of one network share its colour: with opacity and line style that tell them apart."""
    if len(network.nodes) > 4:
        return [(node, max(0.15, 2 / len(network.nodes)), "-") for node in network.nodes]
    lines: tuple[LineStyle, ...] = ("-", (0, (5, 1.5)), (0, (2, 1.2)), (0, (6, 1.5, 1, 1.5)))
    return [(node, 1.0, lines[i]) for i, node in enumerate(network.nodes)]


def _of_state(network: Network, index: int) -> list[tuple[Node, int, float]]:
    """The nodes that estimate a plant state, its column in their estimates, and an opacity."""
    nodes = [node for node in network.nodes if index in node.states]
    opacity = 0.95 if len(nodes) <= 2 else max(0.15, 2 / len(nodes))
    return [(node, node.states.index(index), opacity) for node in nodes]


def _estimates(
    axes: Axes, run: Run, index: int, networks: Sequence[Network], style: Colours
) -> None:
    for network in networks:
        for node, column, opacity in _of_state(network, index):
            axes.plot(
                node.estimates.time,
                node.estimates.value[:, column],
                color=style[network.name],
                alpha=opacity,
                linewidth=1.4,
            )
    if len(run.truth.sample):
        axes.plot(
            run.truth.time,
            run.truth.value[:, index],
            color=TRUTH,
            linewidth=1.5,
            linestyle=(0, (4, 1.6)),
            zorder=3,
        )
    axes.margins(x=0.01)


def _errors(axes: Axes, run: Run, index: int, networks: Sequence[Network], style: Colours) -> None:
    """Signed errors, with two standard deviations shaded where the method has a variance."""
    limits = [0.0, 0.0]
    for network in networks:
        for node, column, opacity in _of_state(network, index):
            time, error, deviation = _error(run, node, column)
            axes.plot(time, error, color=style[network.name], alpha=opacity, linewidth=1.2)
            if np.isfinite(deviation).any():
                axes.fill_between(
                    time,
                    -2 * deviation,
                    2 * deviation,
                    color=style[network.name],
                    alpha=0.13 * opacity,
                    linewidth=0,
                )
            if np.isfinite(error).any():
                finite = error[np.isfinite(error)]
                limits = [min(limits[0], finite.min()), max(limits[1], finite.max())]
    axes.axhline(0, color=TRUTH, linewidth=0.8)
    # The errors decide on the range: an initial variance can be huge.
    room = 0.08 * (limits[1] - limits[0]) or 1.0
    axes.set_ylim(limits[0] - room, limits[1] + room)
    axes.margins(x=0.01)


def _magnitudes(
    axes: Axes, run: Run, index: int, networks: Sequence[Network], style: Colours
) -> None:
    positive = False
    for network in networks:
        for node, column, opacity in _of_state(network, index):
            time, error, _ = _error(run, node, column)
            size = np.where(np.isfinite(error) & (error != 0), np.abs(error), np.nan)
            axes.plot(time, size, color=style[network.name], alpha=opacity, linewidth=1.0)
            positive = positive or bool(np.isfinite(size).any())
    if positive:
        axes.set_yscale("log")
    axes.margins(x=0.01)


def _error(run: Run, node: Node, column: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, error and standard deviation of one column of a node's estimates, each (K,)."""
    samples, error = errors(run.truth, node.estimates, node.states)
    mine = np.isin(node.estimates.sample, samples)
    variance = node.estimates.variance[mine, column]
    deviation = np.sqrt(np.where(variance >= 0, variance, np.nan))
    return node.estimates.time[mine], error[:, column], deviation


def _legend(
    figure: Figure, networks: Sequence[Network], style: Colours, truth: bool, nodes: bool = False
) -> None:
    """Above the panels: truth and networks; with `nodes` also the line styles of nodes."""
    handles = [Line2D([], [], color=TRUTH, linestyle=(0, (4, 1.6)), label="truth")] if truth else []
    for network in networks:
        few = nodes and 1 < len(network.nodes) <= 4
        for node, opacity, line in _styled(network) if few else ():
            label = f"{network.name} / {node.name}"
            handles.append(
                Line2D(
                    [], [], color=style[network.name], alpha=opacity, linestyle=line, label=label
                )
            )
        if not few:
            method = network.nodes[0].method_title if network.nodes else ""
            label = f"{network.name} ({method})" if method else network.name
            handles.append(Line2D([], [], color=style[network.name], label=label))
    if handles:
        figure.legend(handles=handles, loc="outside upper left", ncols=min(len(handles), 4))
