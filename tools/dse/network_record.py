"""The network that a run had: how late each packet came, and which ones never did.

Time is counted in communication instants 0, 1, 2, .. as a scenario's networks[].link counts it: a
packet with stamp s and delay d was there at instant s + d.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from dse.errors import UserError
from dse.events import Messages
from dse.link import HEAD, LOST, Delays, Link
from dse.run import Ints, Network, Run

LONGEST_DELAY = 100
"""SCENARIO_MAX_DELAY of agents/runtime/scenario.h: what comes later counts as lost."""


@dataclass(frozen=True)
class Record:
    """What became of the packets of a network."""

    network: str
    every: int
    """Samples between communication instants."""
    instants: int
    source: str
    """Where the delays come from, in words."""
    delays: dict[tuple[int, int], Delays]
    """(instants,) for each receiver and sender."""

    @property
    def largest(self) -> int:
        """The smallest D with which nothing that came is dropped."""
        return max((int(one.max(initial=0)) for one in self.delays.values()), default=0)

    def write(self, file: TextIO, title: str) -> None:
        """As CSV for networks[].link.file."""
        file.write(f"# {title}\n# {self.source}; {self.instants} instants, {self.every} samples\n")
        file.write(f"# apart. The delay is in instants, {LOST}: lost.\n{HEAD}\n")
        for stamp in range(self.instants):
            for (to, sender), delay in sorted(self.delays.items()):
                file.write(f"{to},{sender},{stamp},{delay[stamp]}\n")


def record(
    run: Run, network: Network, receivers: list[int] | None, library: str | Path | None = None
) -> Record:
    """Of some receivers (None: all nodes).

    From the scenario's link if it has one, else from when the logger heard the messages.
    """
    nodes = [node for node in network.nodes if receivers is None or node.node in receivers]
    known = {node.node for node in network.nodes}
    if receivers and (strange := sorted(set(receivers) - known)):
        raise UserError(f"network {network.name} has no node {strange[0]} in the log")
    pairs = [(node.node, sender) for node in nodes for sender in node.neighbours]
    every = max((node.every for node in network.nodes), default=1)
    if not pairs:
        raise UserError(f"nobody hears anybody in network {network.name}")
    instants = -(-_samples(run) // every)
    link = Link.of(_told(run, network), run.scenario.get("parts") or [])
    if link is not None:
        delays = {pair: link.fates(*pair, every, instants, library) for pair in pairs}
        return Record(network.name, every, instants, "as the scenario's link had it", delays)
    if run.info.get("pace") != "realtime":
        raise UserError(
            f"network {network.name} lost nothing: its scenario has no link, and at pace"
            f" {run.info.get('pace')} everybody waits for every message. Record a run with"
            " --pace realtime"
        )
    heard = _Heard(run, network.index, every, instants)
    of_sender = {sender: heard.delays(sender) for sender in {pair[1] for pair in pairs}}
    delays = {pair: of_sender[pair[1]] for pair in pairs}
    return Record(network.name, every, instants, "as the logger heard it", delays)


def _samples(run: Run) -> int:
    """How many samples the run had: those that the plant published."""
    return int(run.input.sample.max(initial=-1)) + 1


def _told(run: Run, network: Network) -> dict[str, Any]:
    members: list[dict[str, Any]] = run.info.get("networks") or []
    return members[network.index] if network.index < len(members) else {}


class _Heard:
    """When the messages of a network reached the logger."""

    def __init__(self, run: Run, network: int, every: int, instants: int) -> None:
        self.every, self.instants = every, instants
        messages, times = _of_run(run, "input_t")
        sample = messages["header"]["sample"].astype(np.int64)
        first = messages["part"] == 0
        known, tick = _earliest(sample[first], times[first])
        # a tick that the logger missed lies between its neighbours
        samples = np.arange(known.max() + 1)
        self.ticks = np.interp(samples, known, tick.astype(float))
        self.messages, self.times = _of_run(run, "exchange_t")
        is_word = self.messages["intent"] != 1  # not a question: told, or told again
        mine = (self.messages["header"]["network"] == network) & is_word
        mine &= self.messages["header"]["round"] == 0
        self.messages, self.times = self.messages[mine], self.times[mine]

    def delays(self, sender: int) -> Delays:
        """Of a sender's packets.

        A packet is there when its last part has come for the first time, and is taken at the first
        instant whose sample is not over by then.
        """
        mine = self.messages["header"]["node"] == sender
        messages, times = self.messages[mine], self.times[mine]
        sample = messages["header"]["sample"].astype(np.int64)
        delays: Delays = np.full(self.instants, LOST, dtype=np.int16)
        for stamp in range(self.instants):
            this = sample == stamp * self.every
            if not this.any():
                continue
            part, came = _earliest(messages["part"][this].astype(np.int64), times[this])
            if len(part) < int(messages["parts"][this][0]):
                continue
            during = int(np.searchsorted(self.ticks, came.max(), side="right")) - 1
            delay = -(-max(during - stamp * self.every, 0) // self.every)
            if delay <= LONGEST_DELAY:
                delays[stamp] = delay
        return delays


def _of_run(run: Run, type_name: str) -> tuple[Messages, Ints]:
    messages, times = run.log.messages.get(type_name), run.log.times.get(type_name)
    if messages is None or times is None:
        raise UserError(f"{run.log.path}: no {type_name} in the log")
    mine = messages["header"]["run_id"] == run.run_id
    return messages[mine], times[mine].astype(np.int64)


def _earliest(key: Ints, times: Ints) -> tuple[Ints, Ints]:
    """Each key once, and the earliest of its times."""
    order = np.lexsort((times, key))
    known, first = np.unique(key[order], return_index=True)
    return known, times[order][first]
