"""Figures of a run, as functions of its data."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from dse.metrics import errors
from dse.run import HEALTH, TRACKING, Floats, Network, Node, Run

TRUTH = "#111111"
# Distinct in hue and in lightness, also for colour-blind readers (after Okabe and Ito); beyond
# eight networks in lightness more than in hue.
PALETTE = (
    *("#d1495b", "#1f78b4", "#e69f00", "#00876c", "#8e5ea2", "#56b4e9", "#8c564b", "#7a7a7a"),
    *("#7f0f2e", "#0b2f6b", "#c2b200", "#7ccba2", "#4a1486", "#f4a6b7", "#3d2314", "#b9b4a0"),
)
HEALTH_COLOURS = ("#9aa5b1", "#4c9f70", "#e9b949", "#e07b39", "#b3261e", "#7b5ea7", "#3b6ea5")
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

ROW = 0.21
"""Height of a legend's row in inches."""

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
        top.set_title(_heading(signal.title, signal.name))
        _errors(linear, run, index, networks, style)
        deviation = any(np.isfinite(node.estimates.variance).any() for _, node in run.nodes)
        linear.set_title("Estimate minus truth" + (" (shaded: 2 std. dev.)" if deviation else ""))
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
    run: Run, states: Sequence[int], networks: Sequence[Network], style: Colours
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
            axes.set_title(_heading(signal.title, signal.name))
            axes.set_ylabel(signal.label)
        _finish_grid(grid, len(states), _time_label(run))
        _legend(figure, networks, style, truth=len(run.truth.sample) > 0)
    return figure


def diagnostic(run: Run, name: str, networks: Sequence[Network], style: Colours) -> Figure:
    """A method's own quantity: a panel for each node, or one for all where there are many."""
    having = [
        (network, node, column)
        for network in networks
        for node in network.nodes
        for column, signal in enumerate(node.diagnostics)
        if signal.name == name
    ]
    numbers = sorted({node.node for _, node, _ in having})
    apart = len(numbers) <= 6
    panels = numbers if apart else [-1]
    columns = min(2, len(panels))
    rows = -(-len(panels) // columns)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.5, 2.6 * rows + 0.6))
        grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        for axes, number in zip(grid.flat, panels, strict=False):
            for network, node, column in having:
                if apart and node.node != number:
                    continue
                axes.plot(
                    node.estimates.time,
                    node.estimates.diagnostic[:, column],
                    color=style[network.name],
                    alpha=0.9 if apart else _opacity(len(numbers)),
                    linewidth=1.2,
                )
            names = {node.name for _, node, _ in having if node.node == number}
            axes.set_title(" / ".join(sorted(names)) if apart else "all nodes")
            axes.margins(x=0.01)
        _finish_grid(grid, len(panels), _time_label(run))
        unit = next((node.diagnostics[column].unit for _, node, column in having), "")
        for axes in grid[:, 0]:
            axes.set_ylabel(f"{name} [{unit}]" if unit else name)
        _legend(figure, [n for n in networks if any(n is h for h, _, _ in having)], style, False)
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
        legend(figure, patches)
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


def _finish_grid(grid: NDArray[Any], used: int, time_label: str) -> None:
    """Hide the panels that are left over and label the time axis of the lowest ones."""
    columns = grid.shape[1]
    for axes in grid.flat[used:]:
        axes.set_visible(False)
    for column in range(min(columns, used)):
        lowest = max(i for i in range(used) if i % columns == column)
        grid.flat[lowest].set_xlabel(time_label)
        grid.flat[lowest].tick_params(labelbottom=True)


def _opacity(lines: int) -> float:
    """Of one of several lines of the same colour."""
    return 0.95 if lines <= 2 else max(0.15, 2 / lines)


def _heading(title: str, name: str) -> str:
    """The title with a capital (run_info has it in lower case); the name, as it is, without one."""
    return title[:1].upper() + title[1:] if title not in ("", name) else name


def _of_state(network: Network, index: int) -> list[tuple[Node, int, float]]:
    """The nodes that estimate a plant state, its column in their estimates, and an opacity."""
    nodes = [node for node in network.nodes if index in node.states]
    return [(node, node.states.index(index), _opacity(len(nodes))) for node in nodes]


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
    sizes = []
    for network in networks:
        for node, column, opacity in _of_state(network, index):
            time, error, _ = _error(run, node, column)
            size = np.where(np.isfinite(error) & (error != 0), np.abs(error), np.nan)
            axes.plot(time, size, color=style[network.name], alpha=0.85 * opacity, linewidth=0.8)
            sizes.append(size[np.isfinite(size)])
    if sizes and len(every := np.concatenate(sizes)):
        axes.set_yscale("log")
        # Where an error changes its sign its logarithm dives: such spikes tell nothing.
        axes.set_ylim(np.quantile(every, 0.005) / 2, every.max() * 2)
    axes.margins(x=0.01)


def _error(run: Run, node: Node, column: int) -> tuple[Floats, Floats, Floats]:
    """Time, error and standard deviation of one column of a node's estimates, each (K,)."""
    samples, error = errors(run.truth, node.estimates, node.states)
    mine = np.isin(node.estimates.sample, samples)
    variance = node.estimates.variance[mine, column]
    deviation = np.sqrt(np.where(variance >= 0, variance, np.nan))
    return node.estimates.time[mine], error[:, column], deviation


def legend(figure: Figure, handles: Sequence[Line2D | Patch]) -> None:
    """Above the panels, in as many columns as are not cut off; the figure grows with the rows."""
    for columns in range(min(len(handles), 8), 0, -1):
        made = figure.legend(handles=handles, loc="outside upper left", ncols=columns)
        if columns == 1 or made.get_window_extent().width < figure.bbox.width:
            rows = -(-len(handles) // columns)
            figure.set_figheight(figure.get_figheight() + ROW * (rows - 1))
            return
        made.remove()


def _legend(figure: Figure, networks: Sequence[Network], style: Colours, truth: bool) -> None:
    """Above the panels: truth and networks."""
    handles = [Line2D([], [], color=TRUTH, linestyle=(0, (4, 1.6)), label="truth")] if truth else []
    titles = [network.title for network in networks]
    for network, title in zip(networks, titles, strict=True):
        # Variants of one method differ in their names only.
        told = title and title != network.name and titles.count(title) == 1
        label = f"{network.name}: {title}" if told else network.name
        handles.append(Line2D([], [], color=style[network.name], label=label))
    legend(figure, handles)
