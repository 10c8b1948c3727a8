"""Unknown-input observers: existence tests and matrices, reduced and full order.

Source: adaptive distributed observers spec, 4.4 to 4.6; names and numbers of equations are those of
the thesis (Theorem 3.1 for the reduced order, 3.2 for the full order).
"""

import numpy as np

from dse.design.algebra import (
    Floats,
    Infeasible,
    is_hurwitz,
    lyapunov,
    null_space,
    pinv,
    rank,
    solve,
    stabilise,
    undetectable,
)
from dse.design.descriptor_file import DescriptorPlant, Node
from dse.design.observer_section import ObserverNode

NODE_KEYS = ("Q", "Z", "P", "R", "S", "K")
CHECK = 1e-8
"""Largest residual of an identity, relative to the matrices in it."""


def exists(plant: DescriptorPlant, node: Node) -> None:
    """Existence tests (a) and (b); Infeasible names the rank that is missing."""
    E, A, F = plant.E, plant.A, plant.F
    C, G = node.C, node.G
    n, q, p, m = A.shape[1], F.shape[1], C.shape[0], A.shape[0]
    _need("rank [C G]", rank(np.hstack([C, G])), p, "measurements that repeat each other")
    _need("rank [F; G]", rank(np.vstack([F, G])), q, "unknown inputs that act alike")
    if q > p:
        raise Infeasible(f"{p} measurements for {q} unknown inputs: needed at least {q}")
    zero = np.zeros
    big = np.block(
        [
            [E, A, F, zero((m, q))],
            [zero((m, n)), E, zero((m, q)), F],
            [zero((p, n)), C, G, zero((p, q))],
            [zero((p, n)), zero((p, n)), zero((p, q)), G],
        ]
    )
    small = np.block([[E, F], [zero((p, n)), G]])
    _need(
        "rank [E A F 0; 0 E 0 F; 0 C G 0; 0 0 0 G] - rank [E F; 0 G]",
        rank(big) - rank(small),
        n + q,
        "the unknown inputs hide part of the state from the measurements",
    )


def reduced_order(plant: DescriptorPlant, node: Node) -> ObserverNode:
    """Theorem 3.1: an observer of order n + s - t for the descriptor plant."""
    exists(plant, node)
    n, q = plant.A.shape[1], plant.F.shape[1]
    r = rank(plant.E)
    # 1. P E = [E; 0]
    P = node.given.get("P", _compress(plant.E))
    E, A, B, F = (X[:r] for X in (P @ plant.E, P @ plant.A, P @ plant.B, P @ plant.F))
    A1, B1, F1 = (X[r:] for X in (P @ plant.A, P @ plant.B, P @ plant.F))
    # 2. y = [-B1 u; y*] = C x + G v
    C, G = np.vstack([A1, node.C]), np.vstack([F1, node.G])
    t = C.shape[0]
    # 3. R G S = diag(I_s, 0)
    R, S, s = _diagonalise(G, node)
    RC, FS = R @ C, F @ S
    C1, C2, F11, F12 = RC[:s], RC[s:], FS[:, :s], FS[:, s:]
    Phi = A - F11 @ C1
    # 4. [Q; C2] nonsingular
    d = n + s - t
    _need("rank C2", rank(C2), t - s, "measurements and constraints that repeat each other")
    if d < 0:
        raise Infeasible(f"{t - s} independent measurements and constraints of {n} states")
    Q = np.reshape(node.given["Q"], (d, n)) if "Q" in node.given else null_space(C2).T
    _need("rank [Q; C2]", rank(np.vstack([Q, C2])), n, "choose another Q")
    if d == 0:
        return _static(node, C2, R, B1, s)
    # 5.
    M = solve(np.vstack([Q, C2]), np.eye(n)[:, :d])
    Delta = solve(E.T @ E + C2.T @ C2, np.eye(n))
    phi = np.vstack([np.eye(r) - E @ Delta @ E.T, -C2 @ Delta @ E.T])
    alpha = np.eye(r) - F12 @ pinv(phi @ F12) @ phi
    Omega = Q @ Delta @ E.T @ alpha @ Phi @ M
    Theta = phi @ alpha @ Phi @ M
    # 6. Lambda = Omega + Z Theta Hurwitz
    Z = _gain(node, Omega, Theta)
    Lambda: Floats = Omega + Z @ Theta
    # 7.
    T = (Q @ Delta @ E.T + Z @ phi) @ alpha
    N = solve(np.vstack([T @ E, C2]), np.eye(n)[:, d:])
    H, L1, L2 = T @ B, T @ F11, T @ Phi @ N
    D: Floats = C2 @ pinv(T @ E)
    Pi = lyapunov(Lambda, np.eye(d))

    # raw y* and u instead of y1, y2: [y1; y2] = R [-B1 u; y*]
    k = t - node.C.shape[0]
    Ru, Ry = R[:, :k] @ B1, R[:, k:]
    made = ObserverNode(
        Lambda=Lambda,
        L=L1 @ Ry[:s] + L2 @ Ry[s:],
        H=H - L1 @ Ru[:s] - L2 @ Ru[s:],
        M=M,
        N=N @ Ry[s:],
        J=-N @ Ru[s:],
        z0=_start(node, T @ P[:r] @ plant.E, d),
        Pi=Pi,
        C2=C2,
        D=D,
        D_y=-Ry[s:],
        D_u=Ru[s:],
    )
    made.design = dict(
        P=P, E=E, A=A, B=B, F=F, A1=A1, B1=B1, C=C, G=G, R=R, S=S, C1=C1, C2=C2, F11=F11, F12=F12,
        Phi=Phi, Q=Q, Z=Z, M=M, Delta=Delta, phi=phi, alpha=alpha, Omega=Omega, Theta=Theta,
        Lambda=Lambda, T=T, TE=T @ E, N=N, H=H, L1=L1, L2=L2, D=D, Pi=Pi,
    )  # fmt: skip
    made.checks = {
        "[TE; C2] [M N] = I": residual(np.vstack([T @ E, C2]) @ np.hstack([M, N]), np.eye(n)),
        "T F12 = 0": residual(T @ F12, np.zeros((d, q - s))),
        "T Phi - Lambda T E = L2 C2": residual(T @ Phi - Lambda @ T @ E, L2 @ C2),
    }
    check(made)
    return made


def _static(node: Node, C2: Floats, R: Floats, B1: Floats, s: int) -> ObserverNode:
    """Measurements and constraints determine the whole state: xh = C2^-1 y2.

    An agent needs a state all the same: z' = -z, which nothing depends on.
    """
    k, n = B1.shape[0], C2.shape[1]
    N, Ru, Ry = solve(C2, np.eye(n)), R[s:, :k] @ B1, R[s:, k:]
    one = np.eye(1)
    return ObserverNode(
        Lambda=-one, L=np.zeros((1, Ry.shape[1])), H=np.zeros((1, B1.shape[1])),
        M=np.zeros((n, 1)), N=N @ Ry, J=-N @ Ru, z0=np.zeros(1), Pi=one / 2,
        C2=C2, D=np.zeros((n, 1)), D_y=-Ry, D_u=Ru,
        design=dict(C2=C2, R=R, N=N), checks={"C2 N = I": residual(C2 @ N, np.eye(n))},
    )  # fmt: skip


def full_order(plant: DescriptorPlant, node: Node) -> ObserverNode:
    """Theorem 3.2 with the consistent signs: x' = A x + B u + F v, y = C x."""
    A, B, F, C = plant.A, plant.B, plant.F, node.C
    n, q, p = A.shape[0], F.shape[1], C.shape[0]
    if plant.E.shape != (n, n) or not np.array_equal(plant.E, np.eye(n)) or node.G.any():
        raise Infeasible("the full-order observer is for E = I and G = 0")
    _need("rank F", rank(F), q, "unknown inputs that act alike")
    _need("rank C F", rank(C @ F), q, "an unknown input does not reach the measurements at once")
    J: Floats = F @ pinv(C @ F)
    P: Floats = np.eye(n) - J @ C
    K: Floats = np.reshape(node.given["K"], (n, p)) if "K" in node.given else stabilise(P @ A, C)
    Ao: Floats = P @ A - K @ C
    if not is_hurwitz(Ao):
        raise Infeasible("the given K does not make P A - K C Hurwitz")
    L = K @ (np.eye(p) - C @ J) + P @ A @ J
    H = P @ B
    made = ObserverNode(
        Lambda=Ao,
        L=L,
        H=H,
        M=np.eye(n),
        N=J,
        J=np.zeros((n, B.shape[1])),
        z0=_start(node, P, n),
        Pi=lyapunov(Ao, np.eye(n)),
        D=C,
        D_y=C @ J - np.eye(p),
    )
    made.design = dict(J=J, P=P, K=K, Ao=Ao, L=L, H=H, Pi=made.Pi)
    made.checks = {
        "P F = 0": residual(P @ F, np.zeros((n, q))),
        "Ao P + L C = P A": residual(Ao @ P + L @ C, P @ A),
    }
    check(made)
    return made


def residual(left: Floats, right: Floats) -> float:
    """Largest difference relative to the larger of the two sides, or 1."""
    size = max(1.0, float(np.abs(left).max(initial=0)), float(np.abs(right).max(initial=0)))
    return float(np.abs(left - right).max(initial=0)) / size


def check(made: ObserverNode) -> None:
    """Every identity of the design holds, or the design is not handed out."""
    for what, value in made.checks.items():
        if not value <= CHECK:
            raise Infeasible(f"{what} does not hold: residual {value:.2e}")
    if not is_hurwitz(made.Lambda):
        raise Infeasible("the observer's matrix is not Hurwitz")


def _need(what: str, got: int, needed: int, why: str) -> None:
    if got != needed:
        raise Infeasible(f"{what} is {got}, needed {needed}: {why}")


def _compress(E: Floats) -> Floats:
    """Nonsingular P with the rows of P E behind its rank zero; I where E has that form."""
    r = rank(E)
    if not E[r:].any():
        return np.eye(E.shape[0])
    return np.asarray(np.linalg.svd(E)[0].T, dtype=float)


def _diagonalise(G: Floats, node: Node) -> tuple[Floats, Floats, int]:
    """R and S with R G S = diag(I_s, 0), s = rank G; both I where G = 0."""
    s = rank(G)
    t, q = G.shape
    if "R" in node.given and "S" in node.given:
        R, S = node.given["R"], np.atleast_2d(node.given["S"])
    elif s == 0:
        R, S = np.eye(t), np.eye(q)
    else:
        U, sigma, Vt = np.linalg.svd(G)
        scale = np.concatenate([1 / sigma[:s], np.ones(t - s)])
        R, S = scale[:, None] * U.T, Vt.T
    wanted = np.zeros((t, q))
    wanted[:s, :s] = np.eye(s)
    if residual(R @ G @ S, wanted) > CHECK:
        raise Infeasible("the given R and S do not make R G S = diag(I, 0)")
    return R, S, s


def _gain(node: Node, Omega: Floats, Theta: Floats) -> Floats:
    """Z as given, or the Riccati gain -X Theta'."""
    if "Z" in node.given:
        Z = np.reshape(node.given["Z"], (Omega.shape[0], Theta.shape[0]))
        if not is_hurwitz(Omega + Z @ Theta):
            raise Infeasible("the given Z does not make Lambda = Omega + Z Theta Hurwitz")
        return Z
    bad = undetectable(Omega, Theta)
    if bad:
        listed = ", ".join(f"{s:.4g}" for s in bad)
        raise Infeasible(
            "rank [sE - A, -F; C, G] drops below n + q at the unstable zeros s = "
            f"{listed}: the unknown input can hide them"
        )
    return -stabilise(Omega, Theta)


def _start(node: Node, TE: Floats, d: int) -> Floats:
    """z0 as given, or T E x of the guess."""
    if "z0" in node.given:
        if node.given["z0"].size != d:
            raise Infeasible(f"z0 has {node.given['z0'].size} values, the observer {d} states")
        return node.given["z0"]
    guess = node.given.get("guess", np.zeros(TE.shape[1]))
    return np.asarray(TE @ guess, dtype=float)
