"""The figure of nodes that estimate the same states: how wrong they are, how far apart."""

from collections.abc import Sequence

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dse.agreement import same_states
from dse.metrics import disagreement, node_average_error
from dse.plots import STYLE, Colours, legend
from dse.run import Network, Run


def figure(run: Run, networks: Sequence[Network], style: Colours) -> Figure | None:
    """Node-average error and disagreement over time; None where no network has them."""
    found = [(network, same) for network in networks if (same := same_states(run, network))]
    if not found:
        return None
    with mpl.rc_context(STYLE):
        made = Figure(figsize=(9.5, 3.4))
        wrong, apart = made.subplots(1, 2)
        for network, (time, value, error) in found:
            line = {"color": style[network.name], "linewidth": 1.2}
            wrong.plot(time, node_average_error(error), **line)
            apart.plot(time, disagreement(value), **line)
        wrong.set_title("Node-average error")
        apart.set_title("Disagreement")
        for axes in (wrong, apart):
            axes.set_xlabel(f"time [{run.time_unit}]" if run.time_unit else "time")
            axes.set_ylim(bottom=0)
            axes.margins(x=0.01)
        handles = [
            Line2D([], [], color=style[network.name], label=network.name) for network, _ in found
        ]
        legend(made, handles)
    return made
