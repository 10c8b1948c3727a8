"""Draw the fields of a flow: truth and estimates side by side, as pictures.

For runs whose plant is a reduced flow model (cavity_free, cavity_forced). A picture has a column
for the truth and one per network - its first node, or the one given -, and rows for the velocity
with streamlines, the contaminant and the temperature; circles are sensors, filled where the node
reads them itself. Colours are those of the truth; `off by` is the distance from the true field
relative to its size. Where the truth of the run is the simulated flow, the true fields are whole;
else they are what the modes make of the true coefficients. The modes are made anew, which needs
libdse_plants.
"""

import argparse
from pathlib import Path

from dse.commands import add_log, read_run
from dse.errors import unknown
from dse.run import Network, Node

NAME = "fields"
HELP = "true and estimated fields of a flow, as pictures"


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_log(parser)
    parser.add_argument(
        "--at", metavar="TIME", type=float, action="append", default=[], help="may be repeated"
    )
    parser.add_argument(
        "--network", metavar="NAME", action="append", default=[], help="this network only"
    )
    parser.add_argument("--node", metavar="NAME", help="this node of each network")
    parser.add_argument("--all-nodes", action="store_true", help="a column per node")
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, help="folder of the pictures")
    parser.add_argument("--library", metavar="FILE", type=Path, help="libdse_plants.so")


def run(options: argparse.Namespace) -> int:
    """Write the pictures and print their paths."""
    found = read_run(options)
    networks = [found.network(name) for name in options.network] or found.networks
    nodes = [pair for network in networks for pair in _nodes(network, options)]

    from dse import field_plots, fields, plots  # matplotlib takes a second to load

    flow_run = fields.open_run(found, options.library)
    times = options.at or fields.moments(found)
    where = options.output or Path()
    where.mkdir(parents=True, exist_ok=True)
    for sample in dict.fromkeys(flow_run.nearest(time) for time in times):
        path = where / f"{Path(options.log).stem}_fields_{sample}.png"
        plots.save(field_plots.figure(flow_run, sample, nodes), path)
        print(path)
    return 0


def _nodes(network: Network, options: argparse.Namespace) -> list[tuple[Network, Node]]:
    if options.all_nodes:
        return [(network, node) for node in network.nodes]
    if options.node is None:
        return [(network, node) for node in network.nodes[:1]]
    chosen = [node for node in network.nodes if options.node in (node.name, str(node.node))]
    if not chosen:
        raise unknown("node", options.node, [node.name for node in network.nodes])
    return [(network, chosen[0])]
