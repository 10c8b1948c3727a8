"""Messages that nobody should send, while a run is going on: counted, refused, without effect."""

import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import lcm
import pytest
from harness import (
    NODES_OF_AHG_43,
    Conductor,
    Ear,
    Stage,
    dse,
    eventually,
    hashes,
    inproc,
    listening,
    own_hash,
)

from dse import lcmtypes

SAMPLES = 400
HELD_AT = 150
LENGTH = ("--set", f"time.duration_s={SAMPLES}", "--set", "timeouts.give_up_s=100")
RUN = 4711
TIMES = 3
"""How often each message is sent."""
COUNTERS = (
    "refused_hash",
    "refused_length",
    "refused_count",
    "refused_nonfinite",
    "foreign_run",
    "duplicates",
)
CHANNELS = {
    "DSE_CLOCK": lcmtypes.clock_t,
    "DSE_STATUS": lcmtypes.status_t,
    "DSE_INPUT": lcmtypes.input_t,
    "DSE_MEASUREMENT_0": lcmtypes.measurement_t,
    "DSE_EXCHANGE_0_1": lcmtypes.exchange_t,
}
"""All channels that node 0 of network 0 listens to, and one that it shares with the others."""
ALL = "all nodes"


@dataclass
class Attack:
    """Messages and what they must add, together, to a counter of node 0 of network 0."""

    counter: str | None
    messages: list[tuple[str, bytes]]


def message(channel: str) -> Any:  # noqa: ANN401 - any of the generated types
    """A message of this run that would be believed, but for its sample, which is over."""
    made = CHANNELS[channel]()
    made.header.run_id = RUN
    made.header.sample = HELD_AT
    if channel.startswith("DSE_EXCHANGE"):
        made.header.role = lcmtypes.header_t.ROLE_ESTIMATOR
        made.header.node = 1
    if hasattr(made, "parts"):
        made.parts, made.count = 1, 1
    if hasattr(made, "reason"):
        made.reason = bytes(200)
    return made


def with_fields(channel: str, **fields: Any) -> tuple[str, bytes]:  # noqa: ANN401
    """The encoded message with some members changed; header__x is a member of the header."""
    made = message(channel)
    for name, value in fields.items():
        where, _, member = name.rpartition("__")
        setattr(made.header if where else made, member, value)
    return channel, made.encode()


def wrong_types() -> Iterable[tuple[str, bytes]]:
    """Right size, wrong fingerprint: another version, another type."""
    for channel in CHANNELS:
        encoded = message(channel).encode()
        yield channel, bytes(byte ^ 0x55 for byte in encoded[:8]) + encoded[8:]
        yield channel, (8 * b"\0") + encoded[8:]
    yield "DSE_INPUT", message("DSE_MEASUREMENT_0").encode()


def wrong_lengths() -> Iterable[tuple[str, bytes]]:
    """Cut off, too long, hardly anything."""
    for channel in CHANNELS:
        encoded = message(channel).encode()
        for end in (1, 7, 8, 20, len(encoded) // 2, len(encoded) - 1):
            yield channel, encoded[:end]
        yield channel, encoded + b"\0"
        yield channel, 2 * encoded


def wrong_counts() -> Iterable[tuple[str, bytes]]:
    """Counts, parts and ids that cannot be."""
    for channel in ("DSE_INPUT", "DSE_MEASUREMENT_0", "DSE_EXCHANGE_0_1"):
        for count in (-1, -32768, 33, 32767):
            yield with_fields(channel, count=count)
        for part, parts in ((-1, 1), (1, 1), (5, 2), (0, 0), (0, -1), (0, 65), (32767, 32767)):
            yield with_fields(channel, part=part, parts=parts)
        yield with_fields(channel, part=0, parts=2, count=3)  # only the last part may be short
    for channel in CHANNELS:
        yield with_fields(channel, header__sample=-2)
        yield with_fields(channel, header__sample=-(2**63))
        yield with_fields(channel, header__round=-1)
        yield with_fields(channel, header__node=-1)
        yield with_fields(channel, header__network=-2)
        yield with_fields(channel, header__role=5)
        yield with_fields(channel, header__role=-128)
    for length in (-1, 201, 32767):
        yield with_fields("DSE_STATUS", reason_length=length)
    # Another length than the plant's own vectors have: 2 inputs, 1 output.
    for count in (0, 1, 3, 32):
        yield with_fields("DSE_INPUT", header__sample=HELD_AT + 1, count=count)
    for count in (0, 2, 32):
        yield with_fields("DSE_MEASUREMENT_0", header__sample=HELD_AT + 1, count=count)


def not_finite() -> Iterable[tuple[str, bytes]]:
    """NaN and infinity where a number must be."""
    for value in (float("nan"), float("inf"), -float("inf")):
        for channel in CHANNELS:
            yield with_fields(channel, header__plant_time=value)
        for channel in ("DSE_INPUT", "DSE_EXCHANGE_0_1"):
            yield with_fields(
                channel, header__sample=HELD_AT + 1, count=2, value=[0.0, value] + 30 * [0.0]
            )


def of_another_run() -> Iterable[tuple[str, bytes]]:
    """Well formed, from somebody else's experiment."""
    for channel in ("DSE_CLOCK", "DSE_INPUT", "DSE_MEASUREMENT_0", "DSE_EXCHANGE_0_1"):
        for run_id in (RUN + 1, 1, -1, 2**62):
            yield with_fields(channel, header__run_id=run_id, header__sample=HELD_AT + 1)
    yield with_fields("DSE_CLOCK", header__run_id=9, event=lcmtypes.clock_t.EVENT_STOP)


def anything() -> Iterable[tuple[str, bytes]]:
    """Bytes that are no message at all, on every channel and on channels that nobody knows."""
    for channel in (*CHANNELS, "DSE_DONE", "DSE_TRUTH", "DSE_ESTIMATE_0_0", "DSE_RUN_INFO",
                    "DSE_MEASUREMENT_99", "DSE_EXCHANGE_9_9", "SOMETHING", "x"):  # fmt: skip
        for data in (b"", b"\0", b"?", 1300 * b"\xff", struct.pack(">q", -1), b"LC02" * 10):
            yield channel, data


def expected_of_anything() -> int:
    """Of `anything`, what node 0 hears and finds shorter than a fingerprint."""
    return sum(1 for channel, data in anything() if channel in CHANNELS and len(data) < 8)


ATTACKS: dict[str, tuple[str, Callable[[], Iterable[tuple[str, bytes]]]]] = {
    "wrong type": ("refused_hash", wrong_types),
    "wrong length": ("refused_length", wrong_lengths),
    "wrong counts": ("refused_count", wrong_counts),
    "not finite": ("refused_nonfinite", not_finite),
    "another run": ("foreign_run", of_another_run),
}


@pytest.fixture(scope="module")
def answer(shared: Stage) -> dict[tuple[int, int], tuple[int, int]]:
    """The estimates of the undisturbed run."""
    return hashes(inproc(shared, shared.folder / "inproc.lcm", *LENGTH))


class Held:
    """A run that stands at a sample while a test disturbs it."""

    def __init__(self, stage: Stage, url: str, ear: Ear) -> None:
        self.ear = ear
        self.bus = lcm.LCM(url)
        self.conductor = Conductor(url, RUN)
        self.conductor.start()
        self.conductor.let_run_until(HELD_AT)
        common = ("ahg-43", *LENGTH, "--lcm-url", url, "--run-id", RUN)
        self.agents = [
            stage.start(dse("dse-estimator"), *common, "--node", node) for node in (0, 1)
        ]
        self.agents.append(stage.start(dse("dse-plant"), *common, "--recorder-lag", 1))
        ear.await_sample(HELD_AT)
        self.await_quiet()
        self.before = self.counters()

    def await_quiet(self) -> None:
        """Wait until all nodes have said that they are done with the sample at which it stands."""
        for key in NODES_OF_AHG_43:
            eventually(
                lambda key=key: self.ear.of(*key)[-1].header.sample >= HELD_AT,
                f"{key} to be done with sample {HELD_AT}",
            )

    def counters(self) -> dict[str, int]:
        """The counters of node 0 of network 0 as last told."""
        last = self.ear.of(0, 0)[-1]
        return {name: getattr(last, name) for name in COUNTERS}

    def send(self, messages: Iterable[tuple[str, bytes]]) -> int:
        """Publish them; how many there were."""
        count = 0
        for channel, data in messages:
            self.bus.publish(channel, data)
            count += 1
        return count

    def finish(self) -> dict[str, int]:
        """Let the run go on to its end; what was counted since it was held."""
        done = [one.header.sample for key in NODES_OF_AHG_43 for one in self.ear.of(*key)]
        assert max(done) == HELD_AT, "it must not have gone on by itself"
        self.conductor.let_run_until(2 * SAMPLES)
        for agent in self.agents:
            agent.wait().with_code(0)
        self.conductor.close()
        final = self.ear.final(0, 0)
        return {name: getattr(final, name) - self.before[name] for name in COUNTERS}

    def assert_undisturbed(self, answer: dict[tuple[int, int], tuple[int, int]]) -> None:
        """All nodes have estimated the bits of the undisturbed run."""
        for key, (number, _) in answer.items():
            assert own_hash(self.ear.final(*key)) == number, key


@pytest.mark.parametrize("kind", ATTACKS)
def test_what_cannot_be_believed_is_counted_and_changes_nothing(
    kind: str, stage: Stage, url: str, answer: dict[tuple[int, int], tuple[int, int]]
) -> None:
    counter, made = ATTACKS[kind]
    with listening(url) as ear:
        run = Held(stage, url, ear)
        sent = sum(run.send(made()) for _ in range(TIMES))
        counted = run.finish()
        run.assert_undisturbed(answer)
    assert counted[counter] == sent > 0, counted
    others = {name: n for name, n in counted.items() if name not in (counter, "duplicates")}
    assert not any(others.values()), others


def test_garbage_on_every_channel_changes_nothing(
    stage: Stage, url: str, answer: dict[tuple[int, int], tuple[int, int]]
) -> None:
    with listening(url) as ear:
        run = Held(stage, url, ear)
        for _ in range(TIMES):
            run.send(anything())
        counted = run.finish()
        run.assert_undisturbed(answer)
    assert counted["refused_length"] == TIMES * expected_of_anything()
    assert counted["refused_hash"] > 0


def test_old_messages_said_again_are_duplicates(
    stage: Stage, url: str, answer: dict[tuple[int, int], tuple[int, int]]
) -> None:
    """Everything that was said so far, once more, as from a relay that goes mad."""
    with listening(url, keep=True) as ear:
        run = Held(stage, url, ear)
        old = [
            (channel, data)
            for channel, data in list(ear.messages)
            if channel != "DSE_DONE" and channel != "DSE_STATUS"
        ]
        run.send(old)
        counted = run.finish()
        run.assert_undisturbed(answer)
    heard = [channel for channel, _ in old]
    mine = sum(heard.count(one) for one in ("DSE_INPUT", "DSE_MEASUREMENT_0", "DSE_EXCHANGE_0_1"))
    assert mine > 6 * HELD_AT - 50
    assert counted["duplicates"] >= mine
    assert not any(n for name, n in counted.items() if name != "duplicates"), counted


def test_the_words_of_agents_said_again_change_nothing(
    stage: Stage, url: str, answer: dict[tuple[int, int], tuple[int, int]]
) -> None:
    """Old `done` and status messages: nobody is taken for finished, late or doubled."""
    with listening(url, keep=True) as ear:
        run = Held(stage, url, ear)
        run.send([(c, data) for c, data in list(ear.messages) if c in ("DSE_DONE", "DSE_STATUS")])
        run.finish()
        run.assert_undisturbed(answer)


def test_exchanges_of_samples_far_ahead_do_not_block_the_coming_ones(
    stage: Stage, url: str, answer: dict[tuple[int, int], tuple[int, int]]
) -> None:
    with listening(url) as ear:
        run = Held(stage, url, ear)
        run.send(
            with_fields(channel, header__sample=k, count=count)
            for channel, count in (
                ("DSE_EXCHANGE_0_1", 2),
                ("DSE_INPUT", 2),
                ("DSE_MEASUREMENT_0", 1),
            )  # fmt: skip
            for k in (10**6, 10**9, 2**40, 2**62, 2**63 - 1, *range(5000, 5020))
        )
        run.finish()
        run.assert_undisturbed(answer)
