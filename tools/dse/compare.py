"""Whether two runs gave the same estimates, bit for bit."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dse.run import Estimates, Floats, Ints, Node, Run

NO_SAMPLES: Ints = np.zeros(0, dtype=np.int64)


@dataclass
class Difference:
    """Where two estimates of one node differ."""

    sample: int
    time: float
    what: str
    """Name of the first differing quantity at that sample."""
    first: float
    second: float
    largest: float
    """Largest absolute difference of any state at any sample; infinite if only one is finite."""
    largest_what: str
    largest_sample: int
    samples: int
    """How many samples differ."""


@dataclass
class NodeComparison:
    """One node in both logs."""

    network: str
    node: str
    hashes: tuple[int | None, int | None]
    """estimate_hash; None where a log lacks the node."""
    published: tuple[int | None, int | None]
    """The node's own hash over all that it published; None where the log does not tell."""
    samples: tuple[int, int]
    common: int
    """Samples that both logs have."""
    difference: Difference | None
    """None if the common samples are equal."""

    @property
    def equal(self) -> bool:
        """Same samples, same bits."""
        return (
            None not in self.hashes
            and self.samples[0] == self.samples[1] == self.common
            and self.difference is None
        )


def estimate_hash(estimates: Estimates) -> int:
    """FNV-1a, 64 bits, over the states and variances in sample order, little-endian doubles.

    The same number as in the agents' status messages and in what dse-run prints.
    """
    digest = 0xCBF29CE484222325
    both = np.concatenate([estimates.value, estimates.variance], axis=1).astype("<f8")
    for byte in both.tobytes():
        digest = ((digest ^ byte) * 0x100000001B3) & 0xFFFFFFFFFFFFFFFF
    return digest


def compare(a: Run, b: Run) -> list[NodeComparison]:
    """All nodes of both runs, matched by network name and node number."""
    first = {(network.name, node.node): node for network, node in a.nodes}
    second = {(network.name, node.node): node for network, node in b.nodes}
    return [
        _compare(a, key[0], first.get(key), second.get(key))
        for key in sorted(first.keys() | second.keys())
    ]


def _compare(run: Run, network: str, x: Node | None, y: Node | None) -> NodeComparison:
    names = [node.name for node in (x, y) if node]
    first, second = (node.estimates.sample if node else NO_SAMPLES for node in (x, y))
    return NodeComparison(
        network=network,
        node=names[0],
        hashes=(_hash(x), _hash(y)),
        published=(x.estimate_hash if x else None, y.estimate_hash if y else None),
        samples=(len(first), len(second)),
        common=len(np.intersect1d(first, second)),
        difference=_difference(run, x, y) if x and y else None,
    )


def _hash(node: Node | None) -> int | None:
    return estimate_hash(node.estimates) if node else None


def _columns(run: Run, node: Node) -> tuple[list[str], Floats]:
    """Everything that a node estimated as named columns (K, c), states first."""
    names = [run.states[i].name for i in node.states]
    columns = [node.estimates.value, node.estimates.variance, node.estimates.diagnostic]
    columns.append(node.estimates.health[:, None].astype(float))
    names += [f"variance of {name}" for name in names]
    names += [signal.name for signal in node.diagnostics] + ["health"]
    return names, np.concatenate(columns, axis=1)


def _bits(values: Floats) -> NDArray[np.uint64]:
    return np.ascontiguousarray(values).view(np.uint64)


def _difference(run: Run, x: Node, y: Node) -> Difference | None:
    common, i, j = np.intersect1d(
        x.estimates.sample, y.estimates.sample, assume_unique=True, return_indices=True
    )
    names, mine = _columns(run, x)
    others, theirs = _columns(run, y)
    if names != others:
        return Difference(-1, np.nan, "the list of quantities", np.nan, np.nan, np.inf, "", -1, 0)
    mine, theirs = mine[i], theirs[j]
    differs = _bits(mine) != _bits(theirs)
    rows = np.flatnonzero(differs.any(axis=1))
    if not len(rows):
        return None
    k = int(rows[0])
    c = int(np.flatnonzero(differs[k])[0])
    n = len(x.states)
    with np.errstate(invalid="ignore"):
        size = np.abs(mine[:, :n] - theirs[:, :n])
    size[differs[:, :n] & np.isnan(size)] = np.inf
    size[~differs[:, :n]] = 0
    worst, state = np.unravel_index(int(size.argmax()), size.shape) if n else (k, 0)
    return Difference(
        sample=int(common[k]),
        time=float(x.estimates.time[i[k]]),
        what=names[c],
        first=float(mine[k, c]),
        second=float(theirs[k, c]),
        largest=float(size.max(initial=0)),
        largest_what=names[int(state)],
        largest_sample=int(common[int(worst)]),
        samples=len(rows),
    )
