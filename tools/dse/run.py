"""A run of a scenario as arrays: what was estimated, by whom, from what, and how it really was.

Names and units come from the log's own run_info (lcmtypes/README.md describes it). K is the number
of samples of a series; all arrays are indexed [sample, channel].
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dse.errors import unknown
from dse.events import EventLog

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

HEALTH = (
    "initialising",
    "tracking",
    "coasting",
    "rejecting",
    "diverged",
    "unobservable",
    "alone",
)
"""Names of estimate_t.health, as in lib/include/dse/health.h."""
TRACKING = HEALTH.index("tracking")


@dataclass(frozen=True)
class Signal:
    """A state, input, output or diagnostic."""

    name: str
    unit: str = ""
    title: str = ""
    scale: float = float("nan")
    """Size of an ordinary deviation; NaN where the log tells none."""

    @property
    def label(self) -> str:
        """Name and unit, for axes and table heads."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass
class Series:
    """A vector over samples."""

    sample: Ints
    """(K,), ascending, without repetitions."""
    time: Floats
    """(K,) in the plant's time unit."""
    value: Floats
    """(K, n)."""


@dataclass
class Estimates(Series):
    """A node's estimates; value in physical units."""

    variance: Floats
    """(K, n), NaN where the method has none."""
    health: NDArray[np.int8]
    """(K,), index into HEALTH."""
    diagnostic: Floats
    """(K, m)."""


@dataclass
class Done:
    """What each sample cost a node; all (K,)."""

    sample: Ints
    rounds: Ints
    sent: Ints
    sent_bytes: Ints
    step_s: Floats


@dataclass
class Exchanges:
    """The exchange messages of a node as they stand in the log."""

    told: int = 0
    """Messages with values, each counted once."""
    payload_bytes: int = 0
    """Of those, 8 bytes a value."""
    withheld: int = 0
    """Said only that a trigger kept the node silent."""
    repeats: int = 0
    """Said again: asked for by itself or a neighbour."""
    wire_bytes: int = 0
    """All of them as encoded, repeats included."""


@dataclass
class Node:
    """One estimator."""

    network: int
    node: int
    name: str
    method: str
    method_title: str
    states: list[int]
    """Indices of the plant's states that it estimates, in the order of the estimates' columns."""
    diagnostics: list[Signal]
    storage_bytes: int | None
    neighbours: list[int]
    groups: list[int]
    every: int
    """Samples between its communication instants."""
    frames: list[tuple[int, int]]
    """Of an ordinary sample: from whom, and how many values; empty where the log does not tell."""
    estimates: Estimates
    done: Done
    exchanges: Exchanges
    status: dict[str, int] = field(default_factory=dict)
    """Counters of its last status message."""
    estimate_hash: int | None = None
    """Of its last status message: the node's own hash over all that it published."""


@dataclass
class Network:
    """Estimators that talk to each other."""

    index: int
    name: str
    title: str
    """For legends: the scenario's words for it, or the title of its method; may be empty."""
    method: str
    nodes: list[Node]


@dataclass
class Run:
    """One run of a scenario."""

    log: EventLog
    run_id: int
    info: dict[str, Any]
    """The plant's run_info."""
    states: list[Signal]
    inputs: list[Signal]
    outputs: list[Signal]
    truth: Series
    """All plant states; K = 0 when the log has none."""
    input: Series
    """As the plant had them, also those that estimators were not told."""
    measurements: dict[str, tuple[list[Signal], Series]]
    """By sensor group; NaN where a channel was missing."""
    networks: list[Network]
    other_runs: dict[int, int]
    """Run id and number of estimates of the other runs in the log."""
    lost: dict[str, int]
    """Messages missing in the log, by sender and type."""
    repeated: int
    """Messages in the log more than once, used once."""
    ended: str
    """How the run ended, in words."""
    warnings: list[str]

    @property
    def scenario(self) -> dict[str, Any]:
        """The member `scenario` of run_info."""
        return dict(self.info.get("scenario") or {})

    @property
    def time_unit(self) -> str:
        """Unit of plant time."""
        return str((self.info.get("time") or {}).get("unit") or "")

    @property
    def nodes(self) -> Iterator[tuple[Network, Node]]:
        """All nodes with their networks."""
        return ((network, node) for network in self.networks for node in network.nodes)

    def state(self, name: str) -> int:
        """Index of the plant state called `name`; UserError with near names."""
        names = [state.name for state in self.states]
        if name not in names:
            raise unknown("state", name, names)
        return names.index(name)

    def network(self, name: str) -> Network:
        """The network called `name`, or with that index; UserError with near names."""
        for network in self.networks:
            if name in (network.name, str(network.index)):
                return network
        raise unknown("network", name, [network.name for network in self.networks])
