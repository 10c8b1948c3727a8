"""Nodes of a network that estimate the same states: how well they do together."""

from dataclasses import dataclass

import numpy as np

from dse.metrics import (
    LATE,
    NAN,
    disagreement,
    integral,
    l2_norm,
    late,
    node_average_error,
)
from dse.run import Floats, Network, Run


@dataclass
class Agreement:
    """Measures over the samples that all nodes have; errors in the states' units."""

    nodes: int
    samples: int
    error_integral: float
    late_error: float
    disagreement_integral: float
    late_disagreement: float
    final_disagreement: float
    l2_norm: float


def same_states(run: Run, network: Network) -> tuple[Floats, Floats, Floats] | None:
    """Time (K,), estimates and errors (N, K, n) over the samples that all N >= 2 nodes have.

    None where they do not estimate the same states.
    """
    nodes = network.nodes
    if len(nodes) < 2 or any(node.states != nodes[0].states or not node.states for node in nodes):
        return None
    common = run.truth.sample
    for node in nodes:
        common = np.intersect1d(common, node.estimates.sample, assume_unique=True)
    true = np.searchsorted(run.truth.sample, common)
    value = np.stack(
        [n.estimates.value[np.searchsorted(n.estimates.sample, common)] for n in nodes]
    )
    return run.truth.time[true], value, value - run.truth.value[true][:, nodes[0].states]


def agreement(run: Run, network: Network, part: float = LATE) -> Agreement | None:
    """How well nodes that estimate the same states do together."""
    found = same_states(run, network)
    if found is None:
        return None
    time, value, error = found
    if not len(time) or not np.isfinite(error).all():
        return Agreement(len(value), len(time), *[NAN] * 6)
    mean, apart, last = node_average_error(error), disagreement(value), late(time, part)
    return Agreement(
        nodes=len(value),
        samples=len(time),
        error_integral=integral(time, mean),
        late_error=float(mean[last].mean()),
        disagreement_integral=integral(time, apart),
        late_disagreement=float(apart[last].mean()),
        final_disagreement=float(apart[-1]),
        l2_norm=l2_norm(time, error),
    )
