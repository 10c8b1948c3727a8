"""Pictures of flows: true and estimated fields side by side."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dse.fields import Fields, FlowRun, relative
from dse.flow import SENSORS, Flow
from dse.plots import STYLE
from dse.run import Floats, Network, Node
from dse.tables import percent

ROWS = ("velocity and streamlines", "contaminant", "temperature")
COLOURS = ("Blues", "YlGn", "inferno")
ARROWS = 2
"""An arrow in every so manieth cell."""
LEVELS = 9
"""Streamlines."""


def figure(flow_run: FlowRun, sample: int, nodes: Sequence[tuple[Network, Node]]) -> Figure:
    """A column for the truth and one per node; rows are velocity, contaminant, temperature."""
    flow = flow_run.model.flow
    truth = flow_run.truth(sample)
    columns: list[tuple[str, Fields | None, list[int]]] = [(_truth_title(flow_run), truth, [])]
    for network, node in nodes:
        title = f"{network.name}, {node.name}"
        columns.append((title, flow_run.estimate(node, sample), flow_run.sensors(node)))
    with mpl.rc_context({**STYLE, "axes.grid": False}):
        made = Figure(figsize=(0.9 + 2.6 * len(columns), 8.2))
        grid = made.subplots(3, len(columns), squeeze=False)
        for row in range(3):
            limits = _limits(flow, row, truth)
            for column, (title, fields, own) in enumerate(columns):
                axes = grid[row, column]
                _frame(axes, title if row == 0 else "", ROWS[row] if column == 0 else "")
                if fields is None:
                    axes.text(0.5, 0.5, "no estimate", ha="center", va="center")
                    continue
                picture = _draw(axes, flow, row, fields, limits)
                _sensors(axes, flow, own)
                if column > 0:
                    off = percent(min(relative(fields[row], truth[row]), 99.0))
                    axes.set_xlabel(f"off by {off}", fontsize=9)
                else:
                    made.colorbar(picture, ax=list(grid[row]), shrink=0.9, pad=0.015)
        unit = flow_run.run.time_unit
        made.suptitle(f"t = {flow_run.time(sample):.4g} {unit}", x=0.02, ha="left", weight="bold")
    return made


def _truth_title(flow_run: FlowRun) -> str:
    return "truth: the simulated flow" if flow_run.simulated else "truth: the reduced model"


def _frame(axes: Axes, title: str, label: str) -> None:
    axes.set(xlim=(0, 1), ylim=(0, 1), aspect="equal", xticks=(), yticks=(), ylabel=label)
    axes.set_title(title, fontsize=9.5)
    for spine in axes.spines.values():
        spine.set_visible(True)


def _limits(flow: Flow, row: int, truth: Fields) -> tuple[float, float]:
    """Of the colours: those of the truth, so that columns can be compared."""
    values = _speed(flow, truth[0]) if row == 0 else truth[row]
    low, high = min(0.0, float(values.min())), float(values.max())
    return low, high if high > low else low + 1.0


def _speed(flow: Flow, w: Floats) -> Floats:
    speed: Floats = np.hypot(*flow.at_centres(w))
    return speed


def _draw(
    axes: Axes, flow: Flow, row: int, fields: Fields, limits: tuple[float, float]
) -> mpl.cm.ScalarMappable:
    n = flow.n
    values = _speed(flow, fields[0]) if row == 0 else fields[row].reshape(n, n)
    edges = np.linspace(0, 1, n + 1)
    picture = axes.pcolormesh(
        edges, edges, values.T, cmap=COLOURS[row], vmin=limits[0], vmax=limits[1], rasterized=True
    )
    if row == 0:
        _arrows(axes, flow, fields[0], limits[1])
    return picture


def _sensors(axes: Axes, flow: Flow, own: list[int]) -> None:
    """All of them as circles, those that a node reads itself as larger, filled ones."""
    for i, cell in enumerate(SENSORS):
        x, y = ((k + 0.5) / flow.n for k in cell)
        size, face = (34, "#d1495b") if i in own else (16, "white")
        axes.scatter([x], [y], size, facecolor=face, edgecolor="#222222", linewidth=0.8, zorder=4)


def _arrows(axes: Axes, flow: Flow, w: Floats, fastest: float) -> None:
    n = flow.n
    u, v = flow.at_centres(w)
    some = slice(ARROWS // 2, None, ARROWS)
    at = (np.arange(n) + 0.5)[some] / n
    axes.quiver(
        at,
        at,
        u[some, some].T,
        v[some, some].T,
        color="#222222",
        width=0.004,
        scale=fastest * n / ARROWS / 1.6,
        scale_units="width",
        zorder=3,
    )
    psi = stream_function(flow, w)
    if np.ptp(psi) > 0:
        corners = np.linspace(0, 1, n + 1)
        levels = np.linspace(psi.min(), psi.max(), LEVELS + 2)[1:-1]
        axes.contour(corners, corners, psi.T, levels, colors="#5b6b7a", linewidths=0.5, zorder=2)


def stream_function(flow: Flow, w: Floats) -> Floats:
    """Psi (n + 1, n + 1) at the corners of a velocity without divergence: u = d psi / d y."""
    psi = np.zeros((flow.n + 1, flow.n + 1))
    psi[:, 1:] = np.cumsum(flow.components(w)[0], axis=1) / flow.n
    return psi
