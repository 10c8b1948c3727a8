"""All metrics of a run, for tables, reports and machines."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dse.agreement import Agreement, agreement
from dse.communication import Communication, communication
from dse.metrics import (
    LATE,
    NAN,
    error_norm,
    errors,
    late,
    max_error,
    nees,
    rmse,
    settling_band,
    settling_time,
)
from dse.run import HEALTH, Floats, Network, Node, Run, Signal

DEFINITIONS = {
    "rmse": "root mean square of the error over the run",
    "late_rmse": "the same over the last 40 % of the run (--late)",
    "max_error": "largest absolute error",
    "settling_time": "first time from which the error stays in a band to the end, null if never; "
    "the band is 5 % of the initial error, at least 2 % of the state's scale, and 'stays' is said "
    "of the root mean square over windows of 2 % of the run, so that single spikes do not count",
    "nees": "mean of error^2 / variance, 1 if the variance is honest; null without variance",
    "error_norm": "(1/n sum (error/scale)^2)^(1/2) over all states, with run_info's scales: "
    "root mean square over the run, over its late part, maximum, and last value",
    "relative_norm": "(sum (error/M)^2)^(1/2) with M the largest error of that state in any "
    "network: mean and maximum over the run; it compares the networks of one log only",
    "error_sum": "sum over the samples of the error's Euclidean norm, states in their own units",
    "messages, bytes": "exchange payloads as the node counted them (done_t), 8 bytes a value",
    "exchange": "the same counted from the log, with repeats, withheld and encoded bytes",
    "step_s": "time in the method's own code per sample, in seconds",
    "agreement": "where all N nodes estimate the same states, in the states' units: node-average "
    "error (1/N) (sum |e_i|^2)^(1/2) and disagreement (sum |x_i - mean x|^2)^(1/2), integrals over "
    "the run and means over its late part, and the L2 norm (integral of sum |e_i|^2)^(1/2)",
    "communication": "per sample: frames of a model of one frame per link, 7 bytes and 4 per "
    "value, beside messages, payload and encoded bytes as the log has them",
}
"""What the numbers mean: printed by `dse report --help` and in the report."""


@dataclass
class Spread:
    """Distribution of a positive number over the samples."""

    median: float
    p99: float
    max: float

    @classmethod
    def of(cls, values: NDArray[Any]) -> "Spread":
        """The spread of values (K,); NaN when there are none."""
        if not len(values):
            return cls(NAN, NAN, NAN)
        median, p99 = np.quantile(values, [0.5, 0.99])
        return cls(float(median), float(p99), float(values.max()))


@dataclass
class StateMetrics:
    """One state, estimated by a node or by a network (its nodes' errors pooled)."""

    unit: str
    rmse: float
    late_rmse: float
    max_error: float
    settling_time: float | None
    initial_error: float
    final_error: float
    nees: float
    band: float
    """Half width of the settling band."""


@dataclass
class NormMetrics:
    """Error norm over the scaled states."""

    rms: float
    late: float
    max: float
    final: float


@dataclass
class NodeMetrics:
    """One estimator."""

    node: int
    name: str
    method: str
    estimates: int
    missing: int
    """Samples of the truth without an estimate."""
    nonfinite: int
    """Estimates with NaN or infinity."""
    health: dict[str, float]
    """Fraction of the estimates by health."""
    states: dict[str, StateMetrics]
    error_norm: NormMetrics
    messages: int
    bytes: int
    rounds: Spread
    step_s: Spread
    exchange: dict[str, int]
    diagnostics: dict[str, dict[str, float | str]]
    """unit, min, mean, max, final by name."""
    storage_bytes: int | None
    status: dict[str, int]


@dataclass
class NetworkMetrics:
    """All estimators of one network."""

    index: int
    method: str
    states: dict[str, StateMetrics]
    error_norm: NormMetrics
    error_sum: float
    """Sum over the samples of the error's Euclidean norm, states in their own units."""
    relative_norm: dict[str, float]
    messages: int
    bytes: int
    agreement: Agreement | None
    """None where the nodes estimate different states, or there is only one."""
    communication: Communication
    nodes: list[NodeMetrics]


@dataclass
class Metrics:
    """Everything that `dse report --json` prints."""

    schema: int
    log: dict[str, Any]
    run: dict[str, Any]
    late_fraction: float
    networks: dict[str, NetworkMetrics]


def evaluate(run: Run, late_fraction: float = LATE) -> Metrics:
    """All metrics of a run."""
    pooled = {network.name: pooled_errors(run, network) for network in run.networks}
    largest = np.zeros(len(run.states))
    for error in pooled.values():
        largest = np.fmax(largest, np.abs(error).max(axis=0, initial=0, where=np.isfinite(error)))
    return Metrics(
        schema=1,
        log=_about_log(run),
        run=_about_run(run),
        late_fraction=late_fraction,
        networks={
            network.name: _network(run, network, pooled[network.name], largest, late_fraction)
            for network in run.networks
        },
    )


def pooled_errors(run: Run, network: Network) -> Floats:
    """The network's error of every plant state at every sample of the truth, (K, nx).

    Where several nodes estimate a state: the root mean square of their errors; where exactly one
    does: its error with its sign; where none does: NaN.
    """
    shape = run.truth.value.shape
    power, signed, count = np.zeros(shape), np.zeros(shape), np.zeros(shape, dtype=int)
    for node in network.nodes:
        samples, error = errors(run.truth, node.estimates, node.states)
        place = np.ix_(np.searchsorted(run.truth.sample, samples), np.array(node.states, int))
        power[place] += error**2
        signed[place] = error
        count[place] += 1
    mean = np.sqrt(power / np.maximum(count, 1))
    return np.where(count == 0, np.nan, np.where(count == 1, signed, mean))


def to_json(metrics: Metrics) -> dict[str, Any]:
    """Metrics as plain dictionaries; NaN and infinity become None."""
    plain: dict[str, Any] = _plain(metrics)
    return plain


def _plain(value: Any) -> Any:  # noqa: ANN401 - JSON
    if is_dataclass(value):
        return {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, dict):
        return {str(key): _plain(member) for key, member in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(member) for member in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def _about_log(run: Run) -> dict[str, Any]:
    return {
        "file": str(run.log.path),
        "bytes": run.log.size,
        "events": run.log.events,
        "cut_at": run.log.cut_at,
        "repeated": run.repeated,
        "lost": run.lost,
        "refused": {channel: dict(reasons) for channel, reasons in run.log.refused.items()},
        "warnings": run.warnings,
    }


def _about_run(run: Run) -> dict[str, Any]:
    time, plant = run.info.get("time") or {}, run.info.get("plant") or {}
    return {
        "run_id": run.run_id,
        "scenario": run.scenario.get("name"),
        "title": run.scenario.get("title"),
        "source": run.scenario.get("source"),
        "overrides": run.scenario.get("overrides") or [],
        "seed": run.info.get("seed"),
        "version": run.info.get("dse_version"),
        "pace": run.info.get("pace"),
        "plant": plant.get("name"),
        "time_unit": run.time_unit,
        "period": time.get("period"),
        "samples": time.get("samples"),
        "samples_in_log": len(run.truth.sample),
        "ended": run.ended,
    }


def _state(
    time: Floats, error: Floats, state: Signal, state_nees: float, part: float
) -> StateMetrics:
    """Metrics of one state's error; time, error: (K,)."""
    column = error[:, None]
    band = settling_band(error, state.scale)
    return StateMetrics(
        unit=state.unit,
        rmse=float(rmse(column)[0]),
        late_rmse=float(rmse(column[late(time, part)])[0]),
        max_error=float(max_error(column)[0]),
        settling_time=settling_time(time, error, band),
        initial_error=float(error[0]) if len(error) else NAN,
        final_error=float(error[-1]) if len(error) else NAN,
        nees=state_nees,
        band=band,
    )


def _norm(time: Floats, norm: Floats, part: float) -> NormMetrics:
    """Summary of a norm over time; both (K,)."""
    if not len(norm):
        return NormMetrics(NAN, NAN, NAN, NAN)
    column = norm[:, None]
    return NormMetrics(
        rms=float(rmse(column)[0]),
        late=float(rmse(column[late(time, part)])[0]),
        max=float(norm.max()),
        final=float(norm[-1]),
    )


def _node(run: Run, node: Node, part: float) -> NodeMetrics:
    estimates = node.estimates
    samples, error = errors(run.truth, estimates, node.states)
    time = run.truth.time[np.searchsorted(run.truth.sample, samples)]
    variance = estimates.variance[np.isin(estimates.sample, samples)]
    consistency = nees(error, variance)
    signals = [run.states[i] for i in node.states]
    counts = np.bincount(estimates.health.clip(0, len(HEALTH)), minlength=len(HEALTH))
    return NodeMetrics(
        node=node.node,
        name=node.name,
        method=node.method,
        estimates=len(estimates.sample),
        missing=len(run.truth.sample) - len(samples),
        nonfinite=int((~np.isfinite(estimates.value)).any(axis=1).sum()),
        health={
            name: float(count) / max(1, len(estimates.sample))
            for name, count in zip((*HEALTH, "unknown"), counts, strict=False)
        },
        states={
            signal.name: _state(time, error[:, i], signal, float(consistency[i]), part)
            for i, signal in enumerate(signals)
        },
        error_norm=_norm(time, error_norm(error, _scales(signals)), part),
        messages=int(node.done.sent.sum()),
        bytes=int(node.done.sent_bytes.sum()),
        rounds=Spread.of(node.done.rounds),
        step_s=Spread.of(node.done.step_s),
        exchange=vars(node.exchanges).copy(),
        diagnostics={
            signal.name: _diagnostic(signal, estimates.diagnostic[:, i])
            for i, signal in enumerate(node.diagnostics)
        },
        storage_bytes=node.storage_bytes,
        status=node.status,
    )


def _diagnostic(signal: Signal, value: Floats) -> dict[str, float | str]:
    finite = value[np.isfinite(value)]
    if not len(finite):
        return {"unit": signal.unit, "min": NAN, "mean": NAN, "max": NAN, "final": NAN}
    return {
        "unit": signal.unit,
        "min": float(finite.min()),
        "mean": float(finite.mean()),
        "max": float(finite.max()),
        "final": float(value[-1]),
    }


def _scales(signals: Sequence[Signal]) -> Floats:
    return np.array([signal.scale for signal in signals], dtype=float)


def _network(
    run: Run, network: Network, pooled: Floats, largest: Floats, part: float
) -> NetworkMetrics:
    """Metrics of a network from its pooled errors (K, nx) and the largest of any network (nx,)."""
    nodes = [_node(run, node, part) for node in network.nodes]
    whole = ~np.isnan(pooled)
    states = [i for i in range(len(run.states)) if whole[:, i].any()]
    complete = whole[:, states].all(axis=1) if states else np.zeros(len(pooled), dtype=bool)
    time, error = run.truth.time[complete], pooled[complete][:, states]
    comparable = error[:, largest[states] > 0]
    relative = np.sqrt(np.sum((comparable / largest[states][largest[states] > 0]) ** 2, axis=1))
    return NetworkMetrics(
        index=network.index,
        method=network.method,
        states={
            run.states[i].name: _state(
                run.truth.time[whole[:, i]],
                pooled[whole[:, i], i],
                run.states[i],
                _mean([n.states[s].nees for n in nodes if (s := run.states[i].name) in n.states]),
                part,
            )
            for i in states
        },
        error_norm=_norm(time, error_norm(error, _scales([run.states[i] for i in states])), part),
        error_sum=float(np.sqrt(np.sum(error**2, axis=1)).sum()),
        relative_norm={
            "mean": float(relative.mean()) if len(relative) else NAN,
            "max": float(relative.max()) if len(relative) else NAN,
        },
        messages=sum(node.messages for node in nodes),
        bytes=sum(node.bytes for node in nodes),
        agreement=agreement(run, network, part),
        communication=communication(network),
        nodes=nodes,
    )


def _mean(values: Sequence[float]) -> float:
    finite = [value for value in values if math.isfinite(value)]
    return sum(finite) / len(finite) if finite else NAN
