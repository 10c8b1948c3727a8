"""Networks for distributed estimators: makes one, or says what a stored one is like.

WHAT is a kind of network - ring, ladder, moebius-ladder (a ring with links between opposite nodes),
complete, small-world, geometric (points at random in the unit square, the nearest linked) - or a
file with a graph, also a scenario. Printed are degrees, connectivity and the spectrum of the
Laplacian D - A with in-degrees: its second eigenvalue is how fast nodes that average agree. With -o
the section `graph: {nodes, edges, undirected}` of a scenario's network is written; node `to` hears
node `from`.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from dse.errors import UserError, unknown
from dse.tables import console, number, table

if TYPE_CHECKING:
    from dse.design import networks

NAME = "graph"
HELP = "networks: random and regular ones, spectrum, connectivity"
KINDS = ("ring", "ladder", "moebius-ladder", "complete", "small-world", "geometric")


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("what", metavar="WHAT", help=f"{', '.join(KINDS)}, or a file")
    parser.add_argument("-n", "--nodes", type=int, help="number of nodes")
    parser.add_argument("-o", metavar="FILE", type=Path, dest="output", help="write the section")
    parser.add_argument("--seed", type=int, default=1, help="of a random network (default 1)")
    parser.add_argument("--links", type=int, help="geometric: this many shortest pairs")
    parser.add_argument("--radius", type=float, help="geometric: pairs nearer than this")
    parser.add_argument("--neighbours", type=int, default=4, help="small-world: links per node")
    parser.add_argument("--rewired", type=float, default=0.1, help="small-world: share of links")
    parser.add_argument("--directed", action="store_true", help="ring: one way only")


def run(options: argparse.Namespace) -> int:
    """Make or read, write, describe."""
    from dse.design import networks

    if options.what in KINDS:
        made = _make(options)
        if options.output is not None:
            head = f"{options.what}, {options.nodes} nodes"
            if options.what in ("small-world", "geometric"):
                head += f", seed {options.seed}"
            options.output.write_text(networks.text(made, head))
        found = {options.what: made}
    elif Path(options.what).is_file():
        found = networks.load(Path(options.what))
    else:
        raise UserError(f"{options.what}: no such file; {unknown('kind', options.what, KINDS)}")
    for name, network in found.items():
        describe(name, network)
    return 0


def _make(options: argparse.Namespace) -> "networks.Network":
    from dse.design import networks

    n = options.nodes
    if n is None or n < 2:
        raise UserError(f"{options.what}: say how many nodes with -n, at least 2")
    if options.directed and options.what != "ring":
        raise UserError("--directed: only a ring goes one way")
    if options.what == "geometric" and (options.links is None) == (options.radius is None):
        raise UserError("geometric: give either --links or --radius")
    return {
        "ring": lambda: networks.ring(n, options.directed),
        "ladder": lambda: networks.ladder(n),
        "moebius-ladder": lambda: networks.moebius_ladder(n),
        "complete": lambda: networks.complete(n),
        "small-world": lambda: networks.small_world(
            n, options.neighbours, options.rewired, options.seed
        ),
        "geometric": lambda: networks.geometric(n, options.links, options.radius, options.seed),
    }[options.what]()


def describe(name: str, network: "networks.Network") -> None:
    """A table of what the network is like."""
    degrees, roots = network.in_degrees(), network.roots()
    spectrum, diameter = network.spectrum(), network.diameter()
    strong, weak = network.strongly_connected(), network.weakly_connected()
    made = table(f"{name}: {network.nodes} nodes", "property", "value", left=2)
    links = len(network.edges)
    made.add_row("links" if network.undirected else "directed edges", str(links))
    made.add_row("messages per round", str(2 * links if network.undirected else links))
    made.add_row("nodes heard by a node", f"{min(degrees)}..{max(degrees)}")
    made.add_row("connected", "strongly" if strong else "weakly" if weak else "no")
    if not strong:
        made.add_row("roots of a spanning tree", ", ".join(map(str, roots)) or "none")
    made.add_row("balanced", "yes" if network.balanced() else "no")
    made.add_row("diameter", "-" if diameter is None else str(diameter))
    if network.nodes > 1:
        made.add_row("algebraic connectivity, second eigenvalue", _eigenvalue(spectrum[1]))
        made.add_row("largest eigenvalue", _eigenvalue(spectrum[-1]))
    made.add_row("spectrum of the Laplacian", ", ".join(_eigenvalue(v) for v in spectrum))
    console().print(made)


def _eigenvalue(value: complex) -> str:
    if abs(value) < 1e-9:
        return "0"
    if abs(value.imag) < 1e-9:
        return number(value.real)
    return f"{number(value.real)}{'+' if value.imag > 0 else '-'}{number(abs(value.imag))}j"
