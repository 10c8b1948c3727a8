"""Functional observers: existence tests and matrices, descriptor plants and full order.

Source: adaptive distributed observers spec, 4.7 to 4.9; names and numbers of equations are those of
the thesis (Theorem 4.1 for descriptor plants, 4.2 for E = I).
"""

import numpy as np

from dse.design.algebra import (
    Floats,
    Infeasible,
    left_null_space,
    lyapunov,
    null_space,
    pinv,
    rank,
    stabilise,
    undetectable,
)
from dse.design.descriptor_file import DescriptorPlant, Node
from dse.design.observer_section import ObserverNode
from dse.design.uio_matrices import check, residual

NODE_KEYS = ("R", "Z", "Z1")


def descriptor(
    plant: DescriptorPlant, node: Node, pole: float = -1.0, consistent: bool = True
) -> ObserverNode:
    """Theorem 4.1. pole: eigenvalue of N where the functional is one number."""
    E, A, B, L, C = plant.E, plant.A, plant.B, plant.L, node.C
    n, r = E.shape[1], L.shape[0]
    _need("rank C", rank(C), C.shape[0], "measurements that repeat each other")
    Ep = left_null_space(E)
    Ct = np.vstack([Ep @ A, C])
    m, t = E.shape[0], Ct.shape[0]
    # 1. R with rank [R; Delta] = rank [L; Delta] = rank Delta, rank [L; Omega] = rank Omega
    R = np.reshape(node.given["R"], (-1, n)) if "R" in node.given else L
    q = R.shape[0]
    Delta, Omega = np.vstack([E, Ct]), np.vstack([R, Ct])
    _impulse_observable(plant, node)
    _same_rank("[L; Delta]", L, "Delta = [E; Ct]", Delta)
    _same_rank("[R; Delta]", R, "Delta = [E; Ct]", Delta)
    _same_rank("[L; Omega]", L, "Omega = [R; Ct]", Omega)
    # 2.
    half, rest = np.eye(m + t)[:, :m], np.eye(m + t)[:, m:]
    RD, free = R @ pinv(Delta), np.eye(m + t) - Delta @ pinv(Delta)
    alpha, alpha1, beta, beta1 = RD @ half, RD @ rest, free @ half, free @ rest
    Sigma, Theta = np.vstack([Omega, beta @ A]), alpha @ A
    _same_rank("[Sigma; Theta]", Theta, "Sigma", Sigma)  # (4.6)
    # 3.
    parts = (q, q + t)
    A1, A2, A3 = np.split(Theta @ pinv(Sigma), parts, axis=1)
    B1, B2, B3 = np.split(np.eye(q + t + m + t) - Sigma @ pinv(Sigma), parts, axis=1)
    # 4. N = A1 - Z B1 Hurwitz
    _detectable(A1, B1, "rank [sR - alpha A; Ct; beta A]", rank(Sigma))  # (4.7)
    Z = _gain(node, A1, B1, pole)
    # 5.
    N, K1, Y = A1 - Z @ B1, A2 - Z @ B2, A3 - Z @ B3
    T, K = alpha - Y @ beta, alpha1 - Y @ beta1
    J = K1 + N @ K
    # 6. [M K2] = L Omega^+ + Z1 (I - Omega Omega^+)
    Z1 = np.reshape(node.given["Z1"], (r, q + t)) if "Z1" in node.given else _z1(L, R, q + t)
    MK = L @ pinv(Omega) + Z1 @ (np.eye(q + t) - Omega @ pinv(Omega))
    M, K2 = MK[:, :q], MK[:, q:]
    Q, H = K2 + M @ K, T @ B
    # raw y instead of yt = [-Ep B u; y]
    made = _node(node, Matrices(N, J, H, M, Q, T @ E, Ep @ B), Ct, L, consistent)
    made.design = dict(
        Ep=Ep, Ct=Ct, Delta=Delta, Omega=Omega, alpha=alpha, alpha1=alpha1, beta=beta, beta1=beta1,
        Sigma=Sigma, Theta=Theta, A1=A1, A2=A2, A3=A3, B1=B1, B2=B2, B3=B3, R=R, Z=Z, Z1=Z1, N=N,
        K1=K1, Y=Y, T=T, K=K, J=J, M=M, K2=K2, Q=Q, H=H, **made.design,
    )  # fmt: skip
    made.checks = {
        "N T E - T A + J Ct = 0": residual(N @ T @ E + J @ Ct, T @ A),
        "[M Q] [T E; Ct] = L": residual(M @ T @ E + Q @ Ct, L),
    }
    check(made)
    return made


def full_order(
    plant: DescriptorPlant, node: Node, pole: float = -1.0, consistent: bool = True
) -> ObserverNode:
    """Theorem 4.2: x' = A x + B u, y = C x, z = L x."""
    A, B, L, C = plant.A, plant.B, plant.L, node.C
    n, r, p = A.shape[0], L.shape[0], C.shape[0]
    if plant.E.shape != (n, n) or not np.array_equal(plant.E, np.eye(n)):
        raise Infeasible("this observer is for E = I")
    below = np.vstack([C @ A, C, L])
    _same_rank("[L A; C A; C; L]", L @ A, "[C A; C; L]", below)  # (4.13)
    outside = np.eye(n) - pinv(L) @ L
    Ab, Cb = A @ outside, C @ outside
    Sigma = np.vstack([C @ Ab, Cb])
    V = np.vstack([C @ A @ pinv(L), C @ pinv(L)])
    F = L @ A @ pinv(L) - L @ Ab @ pinv(Sigma) @ V
    free = np.eye(2 * p) - Sigma @ pinv(Sigma)
    G = free @ V
    G = np.where(np.abs(G) < 1e-12 * max(1.0, float(np.abs(V).max(initial=0))), 0.0, G)
    _detectable(F, G, "rank [sL - L A; C A; C]", rank(below))  # (4.14)
    Z = _gain(node, F, G, pole)
    N = F - Z @ G
    Q, K = np.split(L @ Ab @ pinv(Sigma) + Z @ free, 2, axis=1)
    T = L - Q @ C
    J, H = K + N @ Q, T @ B
    made = _node(node, Matrices(N, J, H, np.eye(r), Q, T, np.zeros((0, B.shape[1]))), C, L,
                 consistent)  # fmt: skip
    made.design = dict(F=F, G=G, Z=Z, N=N, Q=Q, K=K, T=T, J=J, H=H, **made.design)
    made.checks = {"N T + J C - T A = 0": residual(N @ T + J @ C, T @ A)}
    check(made)
    return made


class Matrices:
    """zeta' = N zeta + J yt + H u, zh = M zeta + Q yt with yt = [-ByU u; y]."""

    def __init__(
        self, N: Floats, J: Floats, H: Floats, M: Floats, Q: Floats, TE: Floats, ByU: Floats
    ) -> None:
        self.N, self.J, self.H, self.M, self.Q, self.TE, self.ByU = N, J, H, M, Q, TE, ByU


def _node(node: Node, of: Matrices, Ct: Floats, L: Floats, consistent: bool) -> ObserverNode:
    """The section's matrices, with the residual of the chosen law."""
    e, p = of.ByU.shape[0], node.C.shape[0]
    Db, W = common_rows(L, Ct)
    if consistent:  # Db' zh - W yt, FO8
        S, V = Db.T, W
    else:  # D' zh - y with D' = C L^+, FO1
        S, V = node.C @ pinv(L), np.hstack([np.zeros((p, e)), np.eye(p)])
    N_raw, J_raw = of.Q[:, e:], -of.Q[:, :e] @ of.ByU
    Pi = lyapunov(of.N, np.eye(of.N.shape[0]))
    design = {"D": (node.C @ pinv(L)).T, "Db": Db, "W": W, "Pi": Pi}
    return ObserverNode(
        Lambda=of.N,
        L=of.J[:, e:],
        H=of.H - of.J[:, :e] @ of.ByU,
        M=of.M,
        N=N_raw,
        J=J_raw,
        z0=_start(node, of.TE),
        Pi=Pi,
        C2=S,
        D=S @ of.M,
        D_y=S @ N_raw - V[:, e:],
        D_u=S @ J_raw + V[:, :e] @ of.ByU,
        design=design,
    )


def common_rows(L: Floats, Ct: Floats) -> tuple[Floats, Floats]:
    """Db (r x k) and W (k x rows of Ct) with W Ct = Db' L and k as large as possible."""
    r = L.shape[0]
    if rank(np.vstack([Ct, L])) == rank(Ct):
        return np.eye(r), L @ pinv(Ct)
    both = null_space(np.hstack([L.T, -Ct.T]))  # L'a = Ct'b
    a = both[:r]
    k = rank(a)
    Db = np.linalg.svd(a)[0][:, :k] if k > 0 else np.zeros((r, 0))
    return Db, Db.T @ L @ pinv(Ct)


def _need(what: str, got: int, needed: int, why: str) -> None:
    if got != needed:
        raise Infeasible(f"{what} is {got}, needed {needed}: {why}")


def _same_rank(what: str, more: Floats, name: str, A: Floats) -> None:
    """The rows of `more` lie in the row space of A."""
    got, needed = rank(np.vstack([more, A])), rank(A)
    if got != needed:
        raise Infeasible(
            f"rank {what} is {got}, needed {needed} = rank {name}: the functional needs what the"
            " measurements do not tell"
        )


def _impulse_observable(plant: DescriptorPlant, node: Node) -> None:
    """Partial impulse observability: rank [E A; 0 E; 0 C; 0 L] = rank [E A; 0 E; 0 C]."""
    E, A, L, C = plant.E, plant.A, plant.L, node.C
    without = np.block([[E, A], [np.zeros_like(E), E], [np.zeros_like(C), C]])
    _same_rank(
        "[E A; 0 E; 0 C; 0 L]",
        np.hstack([np.zeros_like(L), L]),
        "[E A; 0 E; 0 C]",
        without,
    )


def _detectable(A1: Floats, B1: Floats, what: str, needed: int) -> None:
    bad = undetectable(A1, B1)
    if bad:
        listed = ", ".join(f"{s:.4g}" for s in bad)
        raise Infeasible(f"{what} drops below {needed} at s = {listed}: not detectable")


def _gain(node: Node, A1: Floats, B1: Floats, pole: float) -> Floats:
    """Z as given; else N = pole for one functional, the Riccati gain for several."""
    if "Z" in node.given:
        Z = np.reshape(node.given["Z"], (A1.shape[0], B1.shape[0]))
    elif not B1.any():
        Z = np.zeros((A1.shape[0], B1.shape[0]))
    elif A1.shape[0] == 1:
        Z = (A1 - pole) @ pinv(B1)
    else:
        Z = stabilise(A1, B1)
    return Z


def _z1(L: Floats, R: Floats, columns: int) -> Floats:
    """[I 0] with R = L: M = I, K2 = 0; without it M may be 0 and the observer static."""
    Z1 = np.zeros((L.shape[0], columns))
    if np.array_equal(L, R):
        Z1[:, : L.shape[0]] = np.eye(L.shape[0])
    return Z1


def _start(node: Node, TE: Floats) -> Floats:
    """z0 as given, or T E x of the guess."""
    if "z0" in node.given:
        if node.given["z0"].size != TE.shape[0]:
            raise Infeasible(
                f"z0 has {node.given['z0'].size} values, the observer {TE.shape[0]} states"
            )
        return node.given["z0"]
    return np.asarray(TE @ node.given.get("guess", np.zeros(TE.shape[1])), dtype=float)
