"""The laws of the adaptive distributed Kalman filters again, in numpy.

They run on the measurements of a log and are independent of the library. Equation numbers are those
of the adaptive distributed observers source. For one output per node and the plant of section 5.1.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from dse.run import Floats, Run

PERIOD = 0.01


def A(t: float) -> Floats:
    """The plant of section 5.1."""
    return np.array([[-0.15 + 0.4 * np.sin(t), -2.0], [2.0, 0.0]])


@dataclass
class Setting:
    """What a network's section says."""

    scheme: str
    hears: list[list[int]]
    """In-neighbours of each node, ascending."""
    C: Floats
    """(N, 2): the row of each node."""
    R: Floats
    """(N,)"""
    x0: Floats
    """(N, 2)"""
    gamma: float
    beta: float = 1.0
    sigma: float = 0.0


def measurements(run: Run) -> Floats:
    """(K, N)."""
    return np.hstack([series.value for _, series in run.measurements.values()])


def rk4(f: Callable[[float, Floats], Floats], state: Floats, t: float, h: float) -> Floats:
    """One classical Runge-Kutta step of state' = f(t, state)."""
    k1 = f(t, state)
    k2 = f(t + h / 2, state + h / 2 * k1)
    k3 = f(t + h / 2, state + h / 2 * k2)
    k4 = f(t + h, state + h * k3)
    found: Floats = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return found


class Continuous:
    """The network in agent mode: estimates of t_k, then one step with messages of t_k held."""

    def __init__(self, setting: Setting) -> None:
        self.of = setting
        self.x = setting.x0.copy()
        self.P = np.stack([np.eye(2)] * len(self.x))
        one_for_all = setting.scheme in ("node", "global")
        self.Gamma = [np.zeros(1 if one_for_all else len(js)) for js in setting.hears]

    def step(self, k: int, y: Floats) -> None:
        """From t_k to t_(k+1)."""
        said = self.x.copy()
        terms = [self._term(i, y[i], said) for i in range(len(said))]
        for i in range(len(said)):
            self._node(i, k * PERIOD, y[i], said)
        if self.of.scheme == "global":  # (2.12)
            for Gamma in self.Gamma:
                Gamma += PERIOD * self.of.beta * sum(terms)

    def _term(self, i: int, y: float, said: Floats) -> float:
        C = self.of.C[i]
        total: float = sum(C @ said[j] - C @ self.x[i] for j in self.of.hears[i])
        return float((y - C @ self.x[i]) * total)

    def _node(self, i: int, t: float, y: float, said: Floats) -> None:
        of, C, js = self.of, self.of.C[i], self.of.hears[i]

        def f(at: float, state: Floats) -> Floats:
            x, P, Gamma = state[:2], state[2:6].reshape(2, 2), state[6:]
            K, eps = P @ C / of.R[i], y - C @ x
            d = np.array([C @ said[j] - C @ x for j in js])
            dP = A(at) @ P + P @ A(at).T + np.eye(2) - np.outer(K, K) * of.R[i]
            dx = A(at) @ x + K * eps
            dGamma = np.zeros_like(Gamma)
            if of.scheme == "standard":
                dx = dx + of.gamma * P @ sum(said[j] - x for j in js)
            elif of.scheme == "edge":  # (2.3), (2.5)
                dx = dx + of.gamma * P @ C * (Gamma @ d)
                dGamma = of.beta * eps * d - of.sigma * Gamma
            elif of.scheme in ("node", "global"):  # (2.11)
                dx = dx + of.gamma * P @ C * Gamma[0] * d.sum()
                if of.scheme == "node":
                    dGamma = of.beta * eps * d.sum() - of.sigma * Gamma
            return np.concatenate([dx, dP.ravel(), dGamma])

        state = np.concatenate([self.x[i], self.P[i].ravel(), self.Gamma[i]])
        state = rk4(f, state, t, PERIOD)
        P = state[2:6].reshape(2, 2)
        self.x[i], self.P[i], self.Gamma[i] = state[:2], (P + P.T) / 2, state[6:]


class Discrete:
    """(6.1)-(6.3) with a gain per edge and D = P(k+1) A_i^-T C' or P(k) A(k-1)^-T C'."""

    def __init__(self, setting: Setting, direction: str, period: float) -> None:
        self.of, self.direction, self.h = setting, direction, period
        self.prior = setting.x0.copy()
        self.x = self.prior.copy()
        self.P = np.stack([np.eye(2)] * len(self.x))
        self.Gamma = [np.zeros(len(js)) for js in setting.hears]
        self.residual: list[float] | None = None
        self.last_A = expm(period * A(period / 2))

    def sample(self, k: int, y: Floats) -> None:
        """The estimate of t_k, in self.x; the next prior, in self.prior."""
        of, F, said = self.of, expm(self.h * A((k + 0.5) * self.h)), self.prior.copy()
        for i, js in enumerate(of.hears):
            d = np.array([of.C[i] @ said[j] - of.C[i] @ said[i] for j in js])
            if self.residual is not None:  # (6.3): the next step's messages are C A xh_j
                self.Gamma[i] += of.gamma * self.residual[i] * d
            D, K, M = self._gains(i, F)
            self.x[i] = said[i] + K * (y[i] - of.C[i] @ said[i])
            self.x[i] += of.gamma * D * (self.Gamma[i] @ d)
            self.P[i] = F @ M @ F.T + self.h * np.eye(2)
        self.residual = [float(y[i] - of.C[i] @ self.x[i]) for i in range(len(said))]
        self.prior = self.x @ F.T
        self.last_A = F

    def _gains(self, i: int, F: Floats) -> tuple[Floats, Floats, Floats]:
        C, P = self.of.C[i], self.P[i]
        K = P @ C / (self.of.R[i] / self.h + C @ P @ C)
        M = P - np.outer(K, C @ P)
        if self.direction == "filtered":
            return P @ np.linalg.solve(self.last_A.T, C), K, M
        following = F @ M @ F.T + self.h * np.eye(2)
        closed = F - np.outer(K, C @ F)
        return following @ np.linalg.solve(closed.T, C), K, M
