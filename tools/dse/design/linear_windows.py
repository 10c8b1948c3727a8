"""What distributed filters assume of a scenario's linear plant, also a time-varying one.

    Phi' = A(t) Phi,  Phi(0) = I,  A(t) = A + A_sin sin(omega t)      discrete: Phi(k+1) = A Phi(k)
    M = int Phi' C' C Phi dt        every sensor group alone: M > 0
    W' = A W + W A' + Q,  W(0) = 0  process noise reaches every state: W > 0

over a window: a period of A(t), or a few time constants.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dse.run import Floats

STEPS = 400
"""Runge-Kutta steps of a window."""
SINGULAR = 1e-9
"""A Gramian's eigenvalue below this part of the largest counts as zero."""


@dataclass
class Window:
    """A plant over a window."""

    names: list[str]
    """States."""
    length: float
    """Time, or samples of a discrete plant."""
    moves: Floats
    """(steps, n, n): from one step to the next."""
    transition: Floats
    """(steps + 1, n, n): Phi."""
    groups: list[Floats]
    """Rows of C of every sensor group."""
    discrete: bool

    def gramian(self, rows: Floats) -> Floats:
        """M of the outputs rows x, (n, n)."""
        seen = rows @ self.transition
        return self._sum(np.swapaxes(seen, 1, 2) @ seen)

    def excited(self, intensity: Floats) -> Floats:
        """W of a process noise with this diagonal of Q, (n, n)."""
        Q = np.diag(intensity)  # noqa: N806
        before, after = (0 * Q, Q) if self.discrete else (Q * self.length / STEPS / 2,) * 2
        W = 0 * Q  # noqa: N806
        for move in self.moves:
            W = move @ (W + before) @ move.T + after  # noqa: N806
        return np.asarray(W)

    @property
    def multipliers(self) -> Floats:
        """Magnitudes of the eigenvalues of Phi over the window, descending."""
        return np.sort(np.abs(np.linalg.eigvals(self.transition[-1])))[::-1]

    def _sum(self, values: Floats) -> Floats:
        if self.discrete:
            return np.asarray(values[:-1].sum(axis=0))
        return np.asarray(np.trapezoid(values, dx=self.length / STEPS, axis=0))


def window(linear: dict[str, Any]) -> Window:
    """From `plant.linear` of a scenario. KeyError, ValueError: it is not one."""
    n = int(linear["nx"])
    A, swing = (_matrix(linear.get(key), n) for key in ("A", "A_sin"))  # noqa: N806
    C = np.reshape(np.array(linear["C"], dtype=float), (-1, n))  # noqa: N806
    ends = np.cumsum(linear.get("groups") or [len(C)])
    groups = [
        C[end - count : end] for end, count in zip(ends, np.diff(ends, prepend=0), strict=True)
    ]
    names = [str(one) for one in linear.get("states") or [f"x{i + 1}" for i in range(n)]]
    discrete = linear.get("time") == "discrete"
    omega = float(linear.get("omega") or 0)
    fastest = float(np.abs(np.linalg.eigvals(A)).max())
    length = 2 * np.pi / omega if omega > 0 else 5 / fastest if fastest > 0 else 1.0
    if discrete:
        length, moves = 4.0 * n, np.array([A] * (4 * n))
    else:
        moves = np.array([_move(A, swing, omega, length / STEPS, k) for k in range(STEPS)])
    transition = [np.eye(n)]
    for move in moves:
        transition.append(move @ transition[-1])
    return Window(names, length, moves, np.array(transition), groups, discrete)


def _move(A: Floats, swing: Floats, omega: float, h: float, k: int) -> Floats:  # noqa: N803
    """Phi over step k, of one classical Runge-Kutta step."""
    first, middle, last = (A + swing * np.sin(omega * h * (k + at)) for at in (0.0, 0.5, 1.0))
    one = np.eye(len(A))
    k1 = first
    k2 = middle @ (one + h / 2 * k1)
    k3 = middle @ (one + h / 2 * k2)
    k4 = last @ (one + h * k3)
    return np.asarray(one + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))


def _matrix(values: Any, n: int) -> Floats:  # noqa: ANN401
    return np.zeros((n, n)) if values is None else np.reshape(np.array(values, dtype=float), (n, n))


def judge(gramian: Floats, names: list[str]) -> tuple[int, float, str]:
    """Rank, smallest to largest eigenvalue, and the states along the smallest one's direction."""
    values, vectors = np.linalg.eigh(gramian)
    largest = values[-1]
    if largest <= 0:
        return 0, 0.0, ", ".join(names)
    part = np.abs(vectors[:, 0])
    weakest = [names[k] for k in np.argsort(-part) if part[k] >= part.max() / 2]
    rank = int((values > SINGULAR * largest).sum())
    return rank, max(float(values[0] / largest), 0.0), ", ".join(weakest)
