"""What a sweep compares: one number per network and run.

K samples, n states. Errors are estimate minus truth, in the states' units.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from dse.agreement import agreement
from dse.design.flowchart import roughness
from dse.design.sweep import Case, settings
from dse.errors import UserError, unknown
from dse.evaluate import pooled_errors
from dse.metrics import LATE, error_norm, late, settling_band, settling_time
from dse.run import Floats, Network, Run

Results = Mapping[Case, Sequence[Mapping[str, Sequence[float]]]]
"""By case and seed: the metrics of each network."""


def short(keys: Sequence[str]) -> list[str]:
    """Last parts of keys, or the keys where these are not unique."""
    last = [key.rpartition(".")[2] for key in keys]
    return last if len(set(last)) == len(last) else list(keys)


KINDS = {
    "rmse": "root mean square of the error over the run",
    "late": "the same over the late part of the run (--late)",
    "max": "largest absolute error",
    "settling": "time from which the error stays in the band of dse report; inf: never",
    "noise": "standard deviation of the late error about its moving mean over 1/30 of the run",
    "first": "first time at which the absolute error is below BAND, as in first:T1=2; inf: never",
    "U": "sum over states and exchange instants of G error^2, G from --weight, 1 where none fits",
    "sent": "states that the network's filters have sent to their neighbours",
    "IE": "integral of the node-average error (dse report), where all nodes estimate the same",
    "ID": "integral of the disagreement of such nodes",
    "L2": "L2 norm of all errors of such nodes",
    "steady": "mean of their node-average error over the late part of the run",
    "high": "part of the samples with theta above half of its largest value in the run",
}
TOGETHER = {
    "IE": "error_integral",
    "ID": "disagreement_integral",
    "L2": "l2_norm",
    "steady": "late_error",
}
"""Kinds that belong to nodes with the same states: members of Agreement."""
PER_STATE = ("rmse", "late", "max", "settling", "noise", "first", "U")
"""Kinds that may be asked for one state: NAME:STATE."""


@dataclass(frozen=True)
class Metric:
    """One column of a sweep."""

    kind: str
    state: str | None = None
    """None: all states, errors over the states' scales (U: in the states' units)."""
    band: float = 0.0
    """Of `first`, in the state's unit."""

    @classmethod
    def parse(cls, text: str) -> "Metric":
        """KIND, KIND:STATE or first:STATE=BAND."""
        kind, _, rest = text.partition(":")
        state, _, band = rest.partition("=")
        if kind not in KINDS:
            raise unknown("metric", kind, list(KINDS))
        if state and kind not in PER_STATE:
            raise UserError(f"--metric {text}: {kind} is of a network, not of a state")
        if (kind == "first") != bool(band) or (kind == "first" and not state):
            raise UserError(f"--metric {text}: a band belongs to first, as in first:T1=2")
        try:
            return cls(kind, state or None, float(band or 0))
        except ValueError:
            raise UserError(f"--metric {text}: '{band}' is not a number") from None

    def name(self, run: Run) -> str:
        """For heads and axes, with the unit."""
        if self.kind in ("sent", "high"):
            return {"sent": "states sent", "high": "theta high"}[self.kind]
        if self.kind in TOGETHER:
            return self.kind
        if self.kind in ("settling", "first"):
            unit = run.time_unit
        elif self.state is None:
            unit = "" if self.kind == "U" else "of scale"
        else:
            unit = run.states[run.state(self.state)].unit
            unit = f"({unit})^2" if self.kind == "U" else unit
        what = " ".join(filter(None, (self.kind, self.state)))
        if self.kind == "first":
            what = f"|error of {self.state}| first below {self.band:g}"
        return f"{what} [{unit}]" if unit else what


def measure(
    run: Run, metrics: Sequence[Metric], weights: Mapping[str, float], part: float = LATE
) -> dict[str, list[float]]:
    """The metrics of each network. weights: pattern of state names -> entry of G."""
    return {
        network.name: [_one(run, network, metric, weights, part) for metric in metrics]
        for network in run.networks
    }


def _one(
    run: Run, network: Network, metric: Metric, weights: Mapping[str, float], part: float
) -> float:
    if metric.kind == "sent":
        return sent(network)
    if metric.kind in TOGETHER:
        if (together := agreement(run, network, part)) is None:
            raise UserError(
                f"--metric {metric.kind}: the nodes of {network.name} are not several "
                "that estimate the same states"
            )
        return float(getattr(together, TOGETHER[metric.kind]))
    if metric.kind == "high":
        theta = _diagnostic(network, "theta")
        return float(np.mean(theta > 0.5 * theta.max()))
    error = pooled_errors(run, network)
    chosen = range(len(run.states)) if metric.state is None else [run.state(metric.state)]
    if metric.kind == "U":
        G = np.array([_weight(run.states[i].name, weights) for i in chosen])
        return index(error[exchange_instants(run, network)][:, list(chosen)], G)
    if metric.state is not None:
        i = run.state(metric.state)
        return _of_error(run, error[:, i], run.states[i].scale, metric, part)
    scale = np.array([state.scale for state in run.states])
    if metric.kind == "noise":
        return float(np.sqrt(np.nanmean((roughness(run, error) / scale) ** 2)))
    if metric.kind == "settling":
        found = [_settling(run, error[:, i], scale[i]) for i in range(len(scale))]
        return max(found)
    return _of_error(run, error_norm(error, scale), 1.0, metric, part)


def _of_error(run: Run, error: Floats, scale: float, metric: Metric, part: float) -> float:
    """A metric of one signal. error: (K,)."""
    match metric.kind:
        case "rmse":
            return float(np.sqrt(np.mean(error**2)))
        case "late":
            return float(np.sqrt(np.mean(error[late(run.truth.time, part)] ** 2)))
        case "max":
            return float(np.abs(error).max())
        case "noise":
            return float(roughness(run, error[:, None])[0])
        case "settling":
            return _settling(run, error, scale)
    return first_within(run.truth.time, error, metric.band)


def _settling(run: Run, error: Floats, scale: float) -> float:
    found = settling_time(run.truth.time, error, settling_band(error, scale))
    return math.inf if found is None else found


def first_within(time: Floats, error: Floats, band: float) -> float:
    """Time since the start at which |error| is first below the band. time, error: (K,)."""
    inside = np.flatnonzero(np.abs(error) < band)
    return float(time[inside[0]] - time[0]) if len(inside) else math.inf


def index(error: Floats, G: Floats) -> float:
    """U = sum_k sum_s G_s e_s(k)^2. error: (K, n); G: (n,)."""
    return float(np.sum(error**2 @ G))


def exchange_instants(run: Run, network: Network) -> slice:
    """Samples at which the network's filters may exchange their states."""
    tree = settings(run)
    named: list[dict[str, Any]] = tree.get("networks") or []
    own = [one for one in named if one["name"] == network.name]
    for section in own[0].values() if own else ():
        if isinstance(section, dict) and isinstance(section.get("communication"), dict):
            return slice(None, None, int(section["communication"].get("every", 1)))
    return slice(None)


def sent(network: Network) -> float:
    """States that the filters have sent, as they counted them."""
    return float(_diagnostic(network, "states sent")[-1].sum())


def _diagnostic(network: Network, name: str) -> Floats:
    """A diagnostic of all nodes, (K, nodes)."""
    for node in network.nodes:
        names = [signal.name for signal in node.diagnostics]
        if name not in names:
            raise UserError(f"network {network.name} does not tell '{name}'")
    columns = [
        node.estimates.diagnostic[:, [d.name for d in node.diagnostics].index(name)]
        for node in network.nodes
    ]
    length = min(len(column) for column in columns)
    return np.stack([column[:length] for column in columns], axis=1)


def _weight(state: str, weights: Mapping[str, float]) -> float:
    return next((G for pattern, G in weights.items() if fnmatchcase(state, pattern)), 1.0)
