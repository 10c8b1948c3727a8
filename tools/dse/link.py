"""The link of a network: delays and losses as the agents put them in, through libdse_plants."""

import ctypes
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dse import plants
from dse.errors import UserError

Delays = NDArray[np.int16]
LOST = -1
HEAD = "to,from,stamp,delay"
_FOREVER = 2**63 - 1
_Short = ctypes.POINTER(ctypes.c_int16)
_Long = ctypes.POINTER(ctypes.c_int64)
_int = ctypes.c_int


@dataclass(frozen=True)
class Link:
    """What a plant's run_info says of a network's link (lcmtypes/README.md)."""

    max_delay: int
    """D, in communication instants."""
    max_losses: int
    """T_m."""
    loss: float
    seed: int
    outages: list[list[int]]
    """Each from, to, first, end; the last two in samples."""
    table: Delays | None
    """(nodes, nodes, stamps) of a recorded network: [to, from, stamp]; None: random."""

    @classmethod
    def of(cls, network: dict[str, Any], parts: list[dict[str, str]]) -> "Link | None":
        """From a member of run_info's networks and the scenario's parts; None: it has no link."""
        told = network.get("link")
        if not told:
            return None
        text = next((one["text"] for one in parts if one["name"] == told["file"]), None)
        table = None if text is None else table_of(text, int(network["nodes"]))
        if told["file"] and table is None:
            raise UserError(f"the recorded network {told['file']} is not in the log")
        return cls(
            max_delay=int(told["D"]),
            max_losses=int(told["T_m"]),
            loss=float(told["loss"]),
            seed=int(told["seed"]),
            outages=told["outages"],
            table=table,
        )

    def fates(
        self, to: int, sender: int, every: int, stamps: int, library: str | Path | None = None
    ) -> Delays:
        """Delays (stamps,) of what `sender` tells `to` every so many samples; LOST where lost."""
        function = ctypes.CDLL(str(plants.find(library))).link_fates
        function.argtypes = [
            *(_int, _int, ctypes.c_double, ctypes.c_uint64, _Short, _int, _int),
            *(_Long, _int, _int, _int, _int, _Short),
        ]
        nodes, _, recorded = self.table.shape if self.table is not None else (0, 0, 0)
        outages = np.empty((len(self.outages), 4), dtype=np.int64)
        for row, (*pair, first, end) in zip(outages, self.outages, strict=True):
            row[:] = *pair, _instant(first, every), _instant(end, every)
        delay = np.empty(stamps, dtype=np.int16)
        status = function(
            *(self.max_delay, self.max_losses, self.loss, self.seed),
            None if self.table is None else self.table.ctypes.data_as(_Short),
            *(nodes, recorded, outages.ctypes.data_as(_Long), len(outages)),
            *(to, sender, stamps, delay.ctypes.data_as(_Short)),
        )
        if status != 0:
            raise UserError(f"a link that cannot be (status {status}): {self}")
        return delay


def _instant(sample: int, every: int) -> int:
    """The first communication instant that is not before a sample."""
    return sample if sample == _FOREVER else -(-sample // every)


def table_of(text: str, nodes: int) -> Delays:
    """(nodes, nodes, stamps) of a recorded network's text; what it does not list is lost."""
    lines = (line.strip() for line in text.split("\n"))
    rows = [
        [int(field) for field in line.split(",")]
        for line in lines
        if line and line != HEAD and not line.startswith("#")
    ]
    table = np.full((nodes, nodes, 1 + max(row[2] for row in rows)), LOST, dtype=np.int16)
    for to, sender, stamp, delay in rows:
        table[to, sender, stamp] = delay
    return table
