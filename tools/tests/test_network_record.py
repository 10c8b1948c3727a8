"""`dse network record` on a log whose arrival times are known."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import lcm
import pytest
from conftest import Command
from synthetic import Plan, Writer, node_info, plant_info, put_info

from dse import lcmtypes
from dse.link import LOST, table_of

SAMPLES, EVERY, TICK_US = 24, 3, 10_000
INSTANTS = SAMPLES // EVERY
START_US = 1_700_000_000_000_000

LATE: dict[int, int | None] = {
    0: 0,
    1: TICK_US - 10,
    2: TICK_US + 10,
    3: 3 * TICK_US + 10,
    4: 4 * TICK_US + 10,
    5: None,
}
"""By instant: how long after its tick the packet of node 1 was in the log; None: never."""
DELAYS = [0, 0, 1, 1, 2, LOST, 0, 0]
"""One that comes while its own sample lasts is not late; later it has to wait for an instant."""


class Events:
    """Writes messages at given times, in the order of time."""

    def __init__(self) -> None:
        self.events: list[tuple[int, str, bytes]] = []

    def at(self, us: int) -> None:
        """The time of what is written next."""
        self.us = us

    def write_event(self, _: int, channel: str, data: bytes) -> None:
        """As lcm.EventLog does, but the time is that of `at`."""
        self.events.append((START_US + self.us, channel, data))

    def write(self, path: Path) -> None:
        """All of them into a log."""
        log = lcm.EventLog(str(path), "w", overwrite=True)
        for us, channel, data in sorted(self.events, key=lambda event: event[0]):
            log.write_event(us, channel, data)
        log.close()


def put_tick(writer: Writer, k: int) -> None:
    message = lcmtypes.input_t()
    message.header = writer.header("input", lcmtypes.header_t.ROLE_PLANT, -1, 0, k)
    message.parts, message.count = 1, 1
    writer.put("DSE_INPUT", message)


def put_word(writer: Writer, node: int, k: int, part: int = 0, parts: int = 1) -> None:
    message = lcmtypes.exchange_t()
    message.header = writer.header("exchange", lcmtypes.header_t.ROLE_ESTIMATOR, 0, node, k)
    message.part, message.parts, message.count = part, parts, 2
    writer.put(f"DSE_EXCHANGE_0_{node}", message)


def put_question(writer: Writer, node: int, k: int) -> None:
    message = lcmtypes.exchange_t()
    message.header = writer.header("exchange", lcmtypes.header_t.ROLE_ESTIMATOR, 0, node, k)
    message.parts, message.intent = 1, lcmtypes.exchange_t.INTENT_ASK
    writer.put(f"DSE_EXCHANGE_0_{node}", message)


def write_log(path: Path, change: Callable[[dict[str, Any]], None] = lambda info: None) -> Path:
    """Two nodes: 0 is always in time, 1 as LATE says; change: of the plant's run_info."""
    plan, events = Plan(samples=SAMPLES), Events()
    writer = Writer(events, plan)  # type: ignore[arg-type]
    info = plant_info(plan) | {"pace": "realtime"}
    info["networks"] = info["networks"][:1]
    change(info)
    events.at(0)
    put_info(writer, lcmtypes.header_t.ROLE_PLANT, -1, 0, info)
    for node in (0, 1):
        told = node_info(plan, 0, node) | {"every": EVERY}
        put_info(writer, lcmtypes.header_t.ROLE_ESTIMATOR, 0, node, told)
    for k in range(SAMPLES):
        events.at(k * TICK_US)
        if k != 7:  # one tick is not in the log
            put_tick(writer, k)
        events.at(k * TICK_US + 5)
        put_word(writer, 0, k)
        if (late := LATE.get(k // EVERY, 0)) is not None and k % EVERY == 0:
            events.at(k * TICK_US + late)
            put_word(writer, 1, k, 1, 2)
            events.at(k * TICK_US + late // 2)
            put_word(writer, 1, k, 0, 2)  # it is there when both parts are
            events.at((k + 2 * EVERY) * TICK_US)
            put_word(writer, 1, k, 0, 2)  # said again: no news
        events.at(k * TICK_US + 1)
        put_question(writer, 1, k)
        estimate = lcmtypes.estimate_t()
        estimate.header = writer.header("estimate", lcmtypes.header_t.ROLE_ESTIMATOR, 0, 0, k)
        estimate.parts, estimate.count = 1, 2
        writer.put("DSE_ESTIMATE_0_0", estimate)
    events.write(path)
    return path


def test_arrival_times_become_delays_in_instants(dse: Command, tmp_path: Path) -> None:
    log, out = write_log(tmp_path / "real.lcm"), tmp_path / "net.csv"
    said = dse("network", "record", log, "-o", out)
    assert said.code == 0, said.err
    table = table_of(out.read_text(), 2)
    assert table[0, 1].tolist() == DELAYS
    assert table[1, 0].tolist() == [0] * INSTANTS
    assert "node 0 from node 1: 8 packets, 12.5 % lost" in said.out
    assert "link: {D: 2, file: net.csv}" in said.out
    assert "as the logger heard it" in out.read_text()


def test_one_receiver_is_recorded_on_its_own_machine(dse: Command, tmp_path: Path) -> None:
    log, out = write_log(tmp_path / "real.lcm"), tmp_path / "net.csv"
    assert dse("network", "record", log, "--to", 0, "-o", out).code == 0
    rows = [line for line in out.read_text().splitlines() if line[0].isdigit()]
    assert [row.split(",")[:2] for row in rows] == [["0", "1"]] * INSTANTS
    other = tmp_path / "other.csv"
    assert dse("network", "record", log, "--to", 1, "-o", other).code == 0
    joined = out.read_text() + other.read_text()
    assert table_of(joined, 2)[0, 1].tolist() == DELAYS


@pytest.mark.parametrize(
    ("arguments", "change", "wanted"),
    [
        (["--to", 5], {}, "network ahg has no node 5 in the log"),
        (["--network", "agh"], {}, "ahg"),
        ([], {"pace": "lockstep"}, "at pace lockstep everybody waits for every message"),
    ],
)
def test_what_cannot_be_recorded_is_explained(
    dse: Command, tmp_path: Path, arguments: list[object], change: dict[str, str], wanted: str
) -> None:
    log = write_log(tmp_path / "real.lcm", lambda info: info.update(change))
    said = dse("network", "record", log, *arguments, "-o", tmp_path / "net.csv")
    assert said.code == 2
    assert wanted in said.err


def test_a_replayed_network_that_the_log_lacks_is_named(dse: Command, tmp_path: Path) -> None:
    link = {"D": 3, "T_m": 0, "loss": 0.0, "seed": "1", "file": "gone.csv", "outages": []}
    log = write_log(tmp_path / "real.lcm", lambda info: info["networks"][0].update(link=link))
    said = dse("network", "record", log, "-o", tmp_path / "net.csv")
    assert said.code == 2
    assert "the recorded network gone.csv is not in the log" in said.err
