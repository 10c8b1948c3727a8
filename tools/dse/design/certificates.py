"""Does coordinated moving horizon estimation exist for a window, and do its iterations converge?

Prediction-driven, as the agents run it (`literal`: the price is made of the W that they returned):

    Omega X = c + Gb'Q^-1 h - Th'p,   W = Gb X - h;   then   h = -Th X,  p = Q^-1 W

converges if and only if the spectral radius rho_L of the map (h, p) -> (h+, p+) is below 1; it is
proportional to the coupling. The source writes the same recursion in X(s), X(s-1). The recursion
of its theorem (`consistent`: W = G_A X) has I - Omega^-1 Psi in its place and converges if and only
if Omega - Psi/2 is positive definite.

Where the shortest windows that exist have double eigenvalues, rho_L is good to about four digits.

With bounds that stay active, what counts is the same map with those rows held.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dse.design.window import Window
from dse.run import Floats

ROUNDING = 1e-13
"""A smallest eigenvalue below this part of the largest one is no proof of anything."""


@dataclass
class Certificate:
    """Of windows of H samples."""

    H: int
    min_eig_Omega: list[float]  # noqa: N815
    """By subsystem."""
    exists_local: list[bool]
    """By subsystem: is Omega_ii positive definite?"""
    min_eig_Psi: float  # noqa: N815
    exists: bool
    """Is Psi positive definite?"""
    min_eig_test: float
    """Of Omega - Psi/2."""
    rho_literal: float
    """NaN where a subsystem does not exist for itself."""
    rho_consistent: float
    rho_relaxed: float
    """rho_literal under the relaxation that the scheme is run with."""
    min_eig_M_x: float | None  # noqa: N815
    """Condition on D; None without D."""
    cond_Hd: float | None  # noqa: N815
    """Of the dual's Hessian."""
    dual_range: tuple[float, float] | None
    """Smallest and largest eigenvalue of the dual's Hessian (both negative)."""

    @property
    def admissible_coupling(self) -> float:
        """Interactions may be multiplied by less than this; infinite without any."""
        return float(np.divide(1.0, self.rho_literal)) if self.rho_literal > 0 else np.inf

    def iterations(self, first: float, eps: float) -> float:
        """Expected number until the change falls from `first` below eps; infinite: it diverges."""
        if not self.rho_relaxed < 1:
            return np.inf
        if self.rho_relaxed <= 0 or first <= eps:
            return 1.0
        return float(max(1.0, np.log(first / eps) / -np.log(self.rho_relaxed)))


def positive_definite(S: Floats) -> tuple[bool, float]:  # noqa: N803
    """By Cholesky and smallest eigenvalue, which is the second result."""
    values = np.linalg.eigvalsh(S)
    try:
        np.linalg.cholesky(S)
    except np.linalg.LinAlgError:
        return False, float(values[0])
    return bool(values[0] > ROUNDING * values[-1]), float(values[0])


def radius(T: Floats) -> float:  # noqa: N803
    """Spectral radius."""
    return float(np.abs(np.linalg.eigvals(T)).max())


def dual_hessian(w: Window) -> tuple[Floats, Floats]:
    """M_x and Hd = -(B'M_x^-1 B + Q (Q+D)^-1 D) of the price-driven scheme; needs D."""
    assert w.d is not None
    both = w.q + w.d
    M_x = w.M_C + w.Gb.T @ (w.Gb / both[:, None])  # noqa: N806
    B = w.Th.T + w.Gb.T * (w.d / both)  # noqa: N806
    Hd = -(B.T @ np.linalg.solve(M_x, B) + np.diag(w.q * w.d / both))  # noqa: N806
    return M_x, Hd


def certify(w: Window, beta: float = 1.0) -> Certificate:
    """All of it; beta: relaxation of new interactions and prices, 1 is none."""
    omega, psi = w.Omega, w.Psi
    local = [positive_definite(omega[w.part(i)[0], w.part(i)[0]]) for i in _parts(w)]
    exists, min_eig_psi = positive_definite(psi)
    rho = rho_consistent = relaxed = float("nan")
    if all(good for good, _ in local):
        poles = np.linalg.eigvals(iteration_map(w))
        rho = float(np.abs(poles).max())
        relaxed = float(np.abs(1 - beta + beta * poles).max())
        rho_consistent = radius(np.eye(len(psi)) - np.linalg.solve(omega, psi))
    found = Certificate(
        H=w.H,
        min_eig_Omega=[value for _, value in local],
        exists_local=[good for good, _ in local],
        min_eig_Psi=min_eig_psi,
        exists=exists,
        min_eig_test=float(np.linalg.eigvalsh(omega - psi / 2)[0]),
        rho_literal=rho,
        rho_consistent=rho_consistent,
        rho_relaxed=relaxed,
        min_eig_M_x=None,
        cond_Hd=None,
        dual_range=None,
    )
    if w.d is not None and all(found.exists_local):
        M_x, Hd = dual_hessian(w)  # noqa: N806
        values = np.linalg.eigvalsh(Hd)
        found.min_eig_M_x = float(np.linalg.eigvalsh(M_x)[0])
        found.cond_Hd = float(values[0] / values[-1])
        found.dual_range = float(values[0]), float(values[-1])
    return found


def _parts(w: Window) -> range:
    return range(len(w.model.states))


def iteration_map(w: Window, x_rows: Sequence[int] = (), w_rows: Sequence[int] = ()) -> Floats:
    """(h, p) -> (h+, p+) of a round, entries x_rows of X and w_rows of W held at their bounds.

    Of each local problem min 1/2 X_i'Omega_ii X_i - (G'Q^-1 h_i - Th_i'p)'X_i with its rows held;
    W_i = G X_i - h_i,  h+ = -Th X,  p_i+ = Q_i^-1 W_i + y_i with y_i the multipliers of W's rows.
    """
    n_x, n_p = w.x_of.size, w.w_of.size
    omega = w.Omega
    h = np.eye(n_p, 2 * n_p)
    linear = np.hstack([w.Gb.T / w.q, -w.Th.T])
    X, new_p = np.empty((n_x, 2 * n_p)), np.empty((n_p, 2 * n_p))  # noqa: N806
    for i in _parts(w):
        in_x, in_w = w.part(i)
        held_x = [row for row in x_rows if in_x.start <= row < in_x.stop]
        held_w = [row for row in w_rows if in_w.start <= row < in_w.stop]
        rows = np.vstack([np.eye(n_x)[held_x][:, in_x], w.Gb[held_w][:, in_x]])
        count = len(rows)
        kkt = np.block([[omega[in_x, in_x], rows.T], [rows, np.zeros((count, count))]])
        right = np.vstack([linear[in_x], np.zeros((len(held_x), 2 * n_p)), h[held_w]])
        solved = np.linalg.solve(kkt, right)
        size = in_x.stop - in_x.start
        X[in_x] = solved[:size]
        new_p[in_w] = (w.Gb[in_w, in_x] @ solved[:size] - h[in_w]) / w.q[in_w, None]
        new_p[held_w] += solved[size + len(held_x) :]
    return np.vstack([-w.Th @ X, new_p])
