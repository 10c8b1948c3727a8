"""Functional observers for a network of sensors: z = L x without estimating all of x.

PLANT.yaml holds  E x' = A x + B u,  y_i = C_i x,  z = L x,  or is the name of a shipped plant. For
every node the existence tests are made - a failing one says which rank, at which node, and what it
should be - and the observer's matrices are written as the section `distributed_observer` of a
scenario.

Default: descriptor form with R = L, eigenvalue -1 (several functionals: Riccati gain), consistent
law. A node may give R, Z and Z1.
"""

import argparse
import sys
from pathlib import Path

from dse.design import descriptor_file, functional_matrices, observer_section
from dse.design.algebra import Floats, Infeasible
from dse.design.observer_section import Coupling, ObserverNode
from dse.design.uio import coupling_arguments
from dse.errors import UserError

NAME = "functional"
HELP = "functional observers for descriptor plants"


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("plant", metavar="PLANT.yaml", help="matrices, or a shipped plant's name")
    parser.add_argument("-o", metavar="FILE", type=Path, dest="output", help="instead of stdout")
    parser.add_argument("--full-order", action="store_true", help="Theorem 4.2, for E = I")
    parser.add_argument(
        "--law",
        choices=("consistent", "printed"),
        default="consistent",
        help="adaptation: of the error's own residual (default), or Theorem 4.3",
    )
    parser.add_argument(
        "--pole", type=float, default=-1.0, help="eigenvalue for one functional (default -1)"
    )
    coupling_arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Design every node and write the section."""
    plant = descriptor_file.load(options.plant, functional_matrices.NODE_KEYS)
    if plant.L.shape[0] == 0:
        raise UserError(f"{plant.path}: has no L: say which functional is to be estimated")
    if not options.pole < 0:
        raise UserError(f"--pole {options.pole}: must be negative")
    form = functional_matrices.full_order if options.full_order else functional_matrices.descriptor
    nodes: list[ObserverNode] = []
    for i, node in enumerate(plant.nodes):
        try:
            nodes.append(form(plant, node, options.pole, options.law == "consistent"))
        except Infeasible as error:
            raise UserError(f"{plant.path}: node {i}: no such observer: {error}") from None
    states = picked(plant.L)
    if states is None:
        print("functionals are no plant states: a scenario cannot show them", file=sys.stderr)
    coupling = Coupling("own", options.gain, options.gamma, options.leak, states)
    head = f"functional observers of {plant.path.name}, {options.law} law"
    observer_section.write(options.output, observer_section.text(head, coupling, nodes))
    return 0


def picked(L: Floats) -> list[int] | None:
    """The states that L = [unit rows] picks; None when a functional is not a plant state."""
    states = [int(row.argmax()) for row in L]
    unit = all(row[k] == 1 and abs(row).sum() == 1 for row, k in zip(L, states, strict=True))
    return states if unit else None
