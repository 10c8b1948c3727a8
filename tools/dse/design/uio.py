"""Unknown-input observers for a network of sensors, ready for a scenario.

PLANT.yaml holds  E x' = A x + B u + F v,  y_i = C_i x + G_i v  with v unknown, or is the name of a
shipped plant. For every node the existence tests are made - a failing one says which rank, at which
node, and what it should be - and the observer's matrices are written as the section
`distributed_observer` of a scenario.

Default: reduced order (as many observer states as measurements and constraints leave open), gain Z
from a Riccati equation, consistent law. A node may give Q, Z, P, R, S (reduced) or K (full order).
"""

import argparse
from pathlib import Path

from dse.design import descriptor_file, observer_section, uio_matrices
from dse.design.algebra import Infeasible
from dse.design.observer_section import Coupling, ObserverNode
from dse.errors import UserError

NAME = "uio"
HELP = "unknown-input observers for descriptor plants"


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("plant", metavar="PLANT.yaml", help="matrices, or a shipped plant's name")
    parser.add_argument("-o", metavar="FILE", type=Path, dest="output", help="instead of stdout")
    parser.add_argument("--full-order", action="store_true", help="Theorem 3.2, for E = I, G = 0")
    parser.add_argument(
        "--law",
        choices=("consistent", "printed", "projected"),
        default="consistent",
        help="adaptation: of the error's own residual (default), Theorem 3.3, or Remark 3.1",
    )
    coupling_arguments(parser)


def coupling_arguments(parser: argparse.ArgumentParser) -> None:
    """Those that every distributed observer has."""
    parser.add_argument(
        "--gain", choices=("edge", "node"), default="edge", help="one gain per edge or per node"
    )
    parser.add_argument("--gamma", type=float, default=0.01, help="adaptation rate (default 0.01)")
    parser.add_argument("--leak", type=float, default=0.0, help="leakage of the gains, 1/time")
    parser.epilog = descriptor_file.__doc__


def run(options: argparse.Namespace) -> int:
    """Design every node and write the section."""
    plant = descriptor_file.load(options.plant, uio_matrices.NODE_KEYS)
    make = uio_matrices.full_order if options.full_order else uio_matrices.reduced_order
    nodes: list[ObserverNode] = []
    for i, node in enumerate(plant.nodes):
        try:
            nodes.append(make(plant, node))
        except Infeasible as error:
            raise UserError(f"{plant.path}: node {i}: no such observer: {error}") from None
    residual = choose(nodes, options)
    coupling = Coupling(residual, options.gain, options.gamma, options.leak)
    kind = "full" if options.full_order else "reduced"
    head = f"{kind}-order unknown-input observers of {plant.path.name}, {options.law} law"
    observer_section.write(options.output, observer_section.text(head, coupling, nodes))
    return 0


def choose(nodes: list[ObserverNode], options: argparse.Namespace) -> str:
    """Whose residual teaches the gains; leaves only the matrices that this law needs."""
    if options.full_order:  # its own residual C xh - y = C e is consistent
        if options.law == "projected":
            raise UserError("--law projected: the full-order law has no projected form")
        return "own"
    if options.law == "consistent":
        if options.gain == "node":
            raise UserError("--gain node: the consistent law has one gain per edge")
        for node in nodes:
            node.D = node.D_y = node.D_u = None
        return "neighbours"
    if options.law == "printed":
        for node in nodes:
            node.C2 = None
    return "own"
