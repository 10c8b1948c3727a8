"""Linear algebra of offline design: ranks, subspaces, Riccati and Lyapunov equations, poles.

Ranks and pseudo-inverses drop singular values below TOLERANCE times the largest one. Every solution
of an equation is checked by its residual before it is returned.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

TOLERANCE = 1e-10


class Infeasible(ValueError):
    """There is no such matrix; the text says why."""


def rank(A: NDArray[Any]) -> int:
    """Rank of a matrix, 0 of an empty one."""
    if A.size == 0:
        return 0
    s = np.linalg.svd(A, compute_uv=False)
    return int(np.sum(s > TOLERANCE * s[0])) if s[0] > 0 else 0


def pinv(A: Floats) -> Floats:
    """Moore-Penrose inverse."""
    if A.size == 0:
        return np.zeros((A.shape[1], A.shape[0]))
    return np.asarray(np.linalg.pinv(A, rcond=TOLERANCE), dtype=float)


def null_space(A: Floats) -> Floats:
    """Orthonormal columns x with A x = 0."""
    n = A.shape[1]
    if A.size == 0:
        return np.eye(n)
    return np.asarray(np.linalg.svd(A)[2][rank(A) :].T, dtype=float)


def left_null_space(A: Floats) -> Floats:
    """Orthonormal rows x with x A = 0. Rows of the identity where they serve."""
    zero = [i for i in range(A.shape[0]) if not A[i].any()]
    if len(zero) == A.shape[0] - rank(A):
        return np.eye(A.shape[0])[zero]
    return null_space(A.T).T


def is_hurwitz(A: Floats) -> bool:
    """All eigenvalues in the open left half plane."""
    return bool(np.all(np.linalg.eigvals(A).real < 0))


def is_schur(A: Floats) -> bool:
    """All eigenvalues inside the unit circle."""
    return bool(np.all(np.abs(np.linalg.eigvals(A)) < 1))


def undetectable(A: Floats, C: Floats, discrete: bool = False) -> list[complex]:
    """Eigenvalues of A that are neither stable nor seen through C (Popov, Belevitch, Hautus)."""
    n = A.shape[0]
    values = np.linalg.eigvals(A) if n else np.zeros(0)
    # rounding errors where zeros should be count by the size of what they come from
    size = max(float(np.abs(A).max(initial=0)), float(np.abs(C).max(initial=0)))
    edge = 1e-12 * max(1.0, size)
    unstable = [s for s in values if (abs(s) >= 1 - edge if discrete else s.real >= -edge)]
    unseen = []
    for s in unstable:
        seen = np.linalg.svd(np.vstack([s * np.eye(n) - A, C.astype(complex)]), compute_uv=False)
        if np.sum(seen > TOLERANCE * size) < n:
            unseen.append(complex(s))
    return unseen


def care(A: Floats, C: Floats, Q: Floats, R: Floats) -> Floats:
    """Stabilising X of A X + X A' - X C'R^-1 C X + Q = 0."""
    from scipy.linalg import solve_continuous_are

    if not C.any():
        return lyapunov(A.T, Q)
    try:
        X = np.asarray(solve_continuous_are(A.T, C.T, Q, R), dtype=float)
    except np.linalg.LinAlgError as error:
        raise Infeasible(f"the Riccati equation has no stabilising solution ({error})") from None
    X = _symmetric(X)
    _small(A @ X + X @ A.T - X @ C.T @ np.linalg.solve(R, C @ X) + Q, X, "Riccati equation")
    return X


def dare(A: Floats, C: Floats, Q: Floats, R: Floats) -> Floats:
    """Stabilising prior covariance P of P = A P A' - A P C'(R + C P C')^-1 C P A' + Q."""
    from scipy.linalg import solve_discrete_are

    try:
        P = np.asarray(solve_discrete_are(A.T, C.T, Q, R), dtype=float)
    except np.linalg.LinAlgError as error:
        raise Infeasible(f"the Riccati equation has no stabilising solution ({error})") from None
    P = _symmetric(P)
    K = A @ P @ C.T @ np.linalg.inv(R + C @ P @ C.T)
    _small(A @ P @ A.T - K @ C @ P @ A.T + Q - P, P, "discrete Riccati equation")
    return P


def lyapunov(A: Floats, U: Floats) -> Floats:
    """Positive definite Pi of A'Pi + Pi A = -U; A must be Hurwitz."""
    from scipy.linalg import solve_continuous_lyapunov

    if not is_hurwitz(A):
        raise Infeasible(f"eigenvalues {_list(A)} are not all in the open left half plane")
    Pi = np.asarray(solve_continuous_lyapunov(A.T, -U), dtype=float)
    Pi = _symmetric(Pi)
    _small(A.T @ Pi + Pi @ A + U, Pi, "Lyapunov equation")
    return Pi


def discrete_lyapunov(A: Floats, U: Floats) -> Floats:
    """Positive definite Pi of A'Pi A - Pi = -U; A must have its eigenvalues in the unit circle."""
    from scipy.linalg import solve_discrete_lyapunov

    if not is_schur(A):
        raise Infeasible(f"eigenvalues {_list(A)} are not all inside the unit circle")
    Pi = np.asarray(solve_discrete_lyapunov(A.T, U), dtype=float)
    Pi = _symmetric(Pi)
    _small(A.T @ Pi @ A - Pi + U, Pi, "discrete Lyapunov equation")
    return Pi


def place(A: Floats, C: Floats, poles: Sequence[complex]) -> Floats:
    """L (n x p) such that A - L C has these eigenvalues."""
    from scipy.signal import place_poles

    n = A.shape[0]
    if len(poles) != n:
        raise Infeasible(f"{n} eigenvalues are to be placed, {len(poles)} are given")
    seen = rank(np.vstack([C @ np.linalg.matrix_power(A, i) for i in range(n)]))
    if seen < n:
        raise Infeasible(f"not observable, eigenvalues cannot be placed: rank {seen}, needed {n}")
    L = ackermann(A, C, poles) if C.shape[0] == 1 else place_poles(A.T, C.T, poles).gain_matrix.T
    found = np.sort_complex(np.linalg.eigvals(A - L @ C))
    if np.abs(found - np.sort_complex(np.asarray(poles, dtype=complex))).max() > 1e-6:
        raise Infeasible(f"eigenvalues could not be placed, got {_list(A - L @ C)}")
    return np.asarray(L, dtype=float)


def ackermann(A: Floats, C: Floats, poles: Sequence[complex]) -> Floats:
    """The same with one output, also for eigenvalues that occur several times."""
    n = A.shape[0]
    observability = np.vstack([C @ np.linalg.matrix_power(A, i) for i in range(n)])
    p = np.real(np.poly(np.asarray(poles)))
    p_of_A = sum(c * np.linalg.matrix_power(A, n - i) for i, c in enumerate(p))
    return np.asarray(p_of_A @ np.linalg.solve(observability, np.eye(n)[:, -1:]), dtype=float)


def stabilise(A: Floats, C: Floats) -> Floats:
    """X C' with X from A X + X A' - X C'C X + I = 0, so that A - X C' C is Hurwitz."""
    bad = undetectable(A, C)
    if bad:
        listed = ", ".join(f"{s:.4g}" for s in bad)
        raise Infeasible(f"not detectable: the modes s = {listed} are not seen")
    return care(A, C, np.eye(A.shape[0]), np.eye(C.shape[0])) @ C.T


def solve(A: Floats, B: Floats) -> Floats:
    """X with A X = B."""
    return np.asarray(np.linalg.solve(A, B), dtype=float)


def _symmetric(X: Floats) -> Floats:
    return np.asarray((X + X.T) / 2, dtype=float)


def _small(residual: Floats, X: Floats, what: str) -> None:
    size = max(1.0, float(np.abs(X).max(initial=0)) ** 2)
    worst = float(np.abs(residual).max(initial=0))
    if not worst <= 1e-8 * size:
        raise Infeasible(f"the {what} was not solved: residual {worst:.2e}")


def _list(A: Floats) -> str:
    return ", ".join(f"{s:.4g}" for s in np.linalg.eigvals(A))
