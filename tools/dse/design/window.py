"""The stacked window of coordinated moving horizon estimation: its matrices for offline checks.

    x(k+1) = A x(k) + w(k),  y(k) = C x(k) + v(k)     in subsystems, each with its own outputs

Windows of H samples are stacked subsystem after subsystem, in each the oldest sample first: X has
H n entries, W and the prices (H-1) n. The names are those of the source: G_A X - W = 0 is the model
with its local part Gb (block diagonal) and its interactions Th = G_A - Gb,

    M_C = C'R^-1 C,   Psi = M_C + G_A'Q^-1 G_A,   Omega = M_C + Gb'Q^-1 Gb
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dse.errors import UserError
from dse.run import Floats


@dataclass
class Model:
    """A linear plant in subsystems, with the weights of its estimators."""

    A: Floats
    """(n, n), of one sample, in deviations."""
    C: Floats
    """(q, n), rows in the order of the subsystems."""
    states: list[int]
    """Number of states of each subsystem, consecutive."""
    outputs: list[int]
    """Number of rows of C of each subsystem, consecutive."""
    Q: Floats
    """(n,), variances of w: the diagonal."""
    R: Floats
    """(q,), variances of v."""
    D: Floats | None = None
    """(n,), how far the price-driven scheme lets interactions move; None: not used."""
    arrival: Floats | None = None
    """(n,), inverse variances of the oldest state; None: no arrival cost."""
    names: Sequence[str] = ()
    """Of the states; empty: x1, x2, .."""

    def check(self) -> None:
        """UserError when the parts do not fit."""
        n, q = len(self.A), len(self.C)
        wanted = {"A": (n, n), "C": (q, n), "Q": (n,), "R": (q,), "D": (n,), "arrival": (n,)}
        for name, shape in wanted.items():
            value = getattr(self, name)
            if value is not None and value.shape != shape:
                raise UserError(f"{name} is {value.shape}, must be {shape}")
            if value is not None and not np.isfinite(value).all():
                raise UserError(f"{name} has numbers that are not finite")
        if sum(self.states) != n or sum(self.outputs) != q or min(self.states, default=0) < 1:
            raise UserError(
                f"subsystems of {self.states} states and {self.outputs} outputs do not make up"
                f" {n} states and {q} outputs"
            )
        for name in ("Q", "R", "D"):
            value = getattr(self, name)
            if value is not None and not (value > 0).all():
                raise UserError(f"{name}: variances must be positive")
        if (self.C * ~self._own()).any():
            raise UserError("C: an output sees states of another subsystem; no scheme allows that")

    def _own(self) -> np.ndarray:
        """(q, n): which states are in the subsystem of which output."""
        of_state = np.repeat(np.arange(len(self.states)), self.states)
        of_output = np.repeat(np.arange(len(self.outputs)), self.outputs)
        return np.asarray(of_output[:, None] == of_state)

    @property
    def local(self) -> Floats:
        """(n, n), A without what couples the subsystems."""
        of_state = np.repeat(np.arange(len(self.states)), self.states)
        return np.asarray(self.A * (of_state[:, None] == of_state))

    def coupled(self, gamma: float) -> "Model":
        """The same with all interactions multiplied by gamma."""
        A = self.local + gamma * (self.A - self.local)  # noqa: N806
        return Model(
            A,
            self.C,
            self.states,
            self.outputs,
            self.Q,
            self.R,
            self.D,
            self.arrival,
            self.names,
        )

    def name(self, state: int) -> str:
        """Of a state."""
        return self.names[state] if len(self.names) else f"x{state + 1}"


@dataclass
class Window:
    """Matrices of a window of H samples."""

    model: Model
    H: int
    G_A: Floats
    """((H-1) n, H n)."""
    Gb: Floats
    """The same without interactions."""
    Th: Floats
    """The interactions alone."""
    M_C: Floats
    """(H n, H n), outputs and arrival cost."""
    q: Floats
    """((H-1) n,), diagonal of Q."""
    d: Floats | None
    """((H-1) n,), diagonal of D."""
    x_of: np.ndarray
    """(H, n): place in X of a state at a position in the window, 0 the oldest."""
    w_of: np.ndarray
    """(H-1, n), likewise in W."""

    @property
    def Psi(self) -> Floats:  # noqa: N802
        """Hessian of the centralised estimator in X."""
        return self.M_C + self.G_A.T @ (self.G_A / self.q[:, None])

    @property
    def Omega(self) -> Floats:  # noqa: N802
        """Hessian of the estimators for themselves, block diagonal."""
        return self.M_C + self.Gb.T @ (self.Gb / self.q[:, None])

    def part(self, i: int) -> tuple[slice, slice]:
        """Where subsystem i stands in X and in W."""
        first, last = sum(self.model.states[:i]), sum(self.model.states[: i + 1])
        return (
            slice(self.H * first, self.H * last),
            slice((self.H - 1) * first, (self.H - 1) * last),
        )


def _places(states: Sequence[int], length: int) -> np.ndarray:
    """(length, n): place of a state at a time in a vector stacked by subsystem, then by time."""
    columns = []
    for i, count in enumerate(states):
        first = length * sum(states[:i])
        columns.append(first + np.arange(length * count).reshape(length, count))
    return np.concatenate(columns, axis=1)


def _model_rows(A: Floats, x_of: np.ndarray, w_of: np.ndarray, ahead: bool) -> Floats:  # noqa: N803
    """Row of w(t): -A x(t), and x(t+1) where `ahead`."""
    G = np.zeros((w_of.size, x_of.size))  # noqa: N806
    for t, rows in enumerate(w_of):
        G[np.ix_(rows, x_of[t])] = -A
        if ahead:
            G[rows, x_of[t + 1]] = 1
    return G


def window(model: Model, H: int) -> Window:  # noqa: N803
    """The matrices for windows of H >= 2 samples."""
    x_of, w_of = _places(model.states, H), _places(model.states, H - 1)
    Gb = _model_rows(model.local, x_of, w_of, True)  # noqa: N806
    Th = _model_rows(model.A - model.local, x_of, w_of, False)  # noqa: N806
    M_C = np.zeros((x_of.size, x_of.size))  # noqa: N806
    for places in x_of:
        M_C[np.ix_(places, places)] = model.C.T @ (model.C / model.R[:, None])
    if model.arrival is not None:
        M_C[x_of[0], x_of[0]] += model.arrival

    def stacked(diagonal: Floats) -> Floats:
        out = np.empty(w_of.size)
        out[w_of] = diagonal
        return out

    d = None if model.D is None else stacked(model.D)
    return Window(model, H, Gb + Th, Gb, Th, M_C, stacked(model.Q), d, x_of, w_of)
