"""Constant gains of observers for linear time-invariant plants: Kalman-Bucy, Kalman or Luenberger.

PLANT.yaml holds  x' = A x + B u (time: discrete: x(k+1) = A x + B u)  and y_i = C_i x,  with Q and
nodes[].R for the Riccati equation, or is the name of a shipped plant. Every node gets

    K   gain: of the Riccati equation, or such that A - K C has the eigenvalues of --poles
        (discrete: of the predicting form xh(k+1) = A xh + K (y - C xh))
    P   covariance of the Riccati equation; not with --poles
    Pi  A_i'Pi + Pi A_i = -I (discrete: A_i'Pi A_i - Pi = -I) with A_i = A - K C
    D   direction of the coupling: Pi^-1 C' (discrete: Pi^-1 A_i'^-1 C')

and the section `distributed_observer` of a scenario, in which estimates are compared in C. K and D
are also those of the adaptive distributed Kalman filter with given gains.
"""

import argparse
from pathlib import Path

import numpy as np

from dse.design import algebra, descriptor_file, observer_section
from dse.design.algebra import Floats, Infeasible, solve
from dse.design.descriptor_file import DescriptorPlant, Node
from dse.design.observer_section import Coupling, ObserverNode
from dse.design.uio import coupling_arguments
from dse.design.uio_matrices import residual
from dse.errors import UserError

NAME = "luenberger"
HELP = "constant Kalman or Luenberger gains for linear plants"
NODE_KEYS = ("R",)


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("plant", metavar="PLANT.yaml", help="matrices, or a shipped plant's name")
    parser.add_argument("-o", metavar="FILE", type=Path, dest="output", help="instead of stdout")
    parser.add_argument(
        "--poles",
        metavar="S1,S2,..",
        help="eigenvalues of A - K C, complex ones in pairs like -1+2j,-1-2j, instead of a Riccati"
        " equation (after an equals sign: --poles=-1,-2)",
    )
    coupling_arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Design every node and write the section."""
    plant = descriptor_file.load(options.plant, NODE_KEYS)
    n = plant.A.shape[0]
    if plant.E.shape != (n, n) or not np.array_equal(plant.E, np.eye(n)) or plant.F.size:
        raise UserError(f"{plant.path}: needs E = I and no unknown inputs; see dse design uio")
    poles = None if options.poles is None else _poles(options.poles)
    nodes: list[ObserverNode] = []
    for i, node in enumerate(plant.nodes):
        try:
            nodes.append(design(plant, node, poles))
        except Infeasible as error:
            raise UserError(f"{plant.path}: node {i}: no such observer: {error}") from None
    how = "Riccati gains" if poles is None else f"eigenvalues {options.poles}"
    head = f"observers of {plant.path.name}, {how}"
    if plant.discrete:
        head += (
            ", discrete: for nodes without neighbours, or gains of the distributed Kalman filter"
        )
    coupling = Coupling("own", options.gain, options.gamma, options.leak)
    observer_section.write(options.output, observer_section.text(head, coupling, nodes))
    return 0


def design(plant: DescriptorPlant, node: Node, poles: list[complex] | None) -> ObserverNode:
    """Gain, Lyapunov matrix and direction of one node."""
    A, C, n, p = plant.A, node.C, plant.A.shape[0], node.C.shape[0]
    matrices: dict[str, Floats] = {}
    checks: dict[str, float] = {}
    if poles is not None:
        K = algebra.place(A, C, poles)
    else:
        R = np.reshape(node.given["R"], (p, p)) if "R" in node.given else np.eye(p)
        K, P, checks = _riccati(plant, C, R)
        matrices["P"] = P
    Ai: Floats = A - K @ C
    U = np.eye(n)
    Pi = algebra.discrete_lyapunov(Ai, U) if plant.discrete else algebra.lyapunov(Ai, U)
    D = solve(Pi, _back(Ai, C) if plant.discrete else C.T)
    start = node.given.get("z0", node.given.get("guess", np.zeros(n)))
    if start.size != n:
        raise Infeasible(f"z0 has {start.size} values, the plant {n} states")
    return ObserverNode(
        Lambda=Ai,
        L=K,
        H=plant.B,
        M=np.eye(n),
        N=np.zeros((n, p)),
        J=np.zeros((n, plant.B.shape[1])),
        z0=start,
        Pi=Pi,
        C2=C,
        D=C,
        D_y=-np.eye(p),
        design=dict(K=K, **matrices, Pi=Pi, D=D),
        checks=checks,
    )


def _riccati(
    plant: DescriptorPlant, C: Floats, R: Floats
) -> tuple[Floats, Floats, dict[str, float]]:
    """K and P, and the residual of the equation."""
    A, Q = plant.A, plant.Q
    bad = algebra.undetectable(A, C, plant.discrete)
    if bad:
        listed = ", ".join(f"{s:.4g}" for s in bad)
        raise Infeasible(f"not detectable: the modes {listed} are not seen")
    if plant.discrete:  # P = A P A' - A P C'(R + C P C')^-1 C P A' + Q
        P = algebra.dare(A, C, Q, R)
        K = solve(R + C @ P @ C.T, C @ P @ A.T).T
        return K, P, {"Riccati": residual(A @ P @ A.T - K @ C @ P @ A.T + Q, P)}
    # A P + P A' + Q - P C'R^-1 C P = 0
    P = algebra.care(A, C, Q, R)
    K = solve(R, C @ P).T
    return K, P, {"Riccati": residual(A @ P + P @ A.T + Q, K @ C @ P)}


def _back(Ai: Floats, C: Floats) -> Floats:
    """A_i'^-1 C': no eigenvalue of A_i may be 0."""
    if algebra.rank(Ai) < Ai.shape[0]:
        raise Infeasible(
            f"A - K C has rank {algebra.rank(Ai)}, needed {Ai.shape[0]}: no eigenvalue may be 0"
        )
    return solve(Ai.T, C.T)


def _poles(given: str) -> list[complex]:
    try:
        return [complex(one) for one in given.replace(" ", "").split(",")]
    except ValueError:
        raise UserError(f"--poles {given}: must be numbers like -1,-2 or -1+2j,-1-2j") from None
