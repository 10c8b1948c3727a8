"""What the system tests share: agents as processes, a bus of the test's own, logs as runs.

Every wait has a limit and says what it waited for. Limits are generous: they are there for a run
that hangs, not for a machine that is slow.
"""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import lcm
import numpy as np
import yaml

from dse import lcmtypes
from dse.compare import estimate_hash
from dse.log import read
from dse.run import Node, Run

BIN = Path(os.environ["DSE_BIN"])
TOOLS = Path(sys.prefix) / "bin"
PATIENCE = 100.0
"""Seconds after which something that should have happened counts as hanging."""

NODES_OF_AHG_43 = {(0, 0), (0, 1), (1, 0), (1, 1)}
"""(network, node) of everybody in the scenario ahg-43."""


def dse(program: str) -> str:
    """Path of a program that was built: dse-run, dse-plant, dse-estimator."""
    return str(BIN / program)


def tool(program: str) -> str:
    """Path of a program of the virtual environment: lcm-logger, lcm-logplayer, dse."""
    return str(TOOLS / program)


def free_port() -> int:
    """A UDP port on which nobody listens."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("", 0))
        port: int = one.getsockname()[1]
        return port


def url_of(port: int, ttl: int = 0) -> str:
    """The LCM URL of a port: with ttl 0 nothing leaves this machine."""
    return f"udpm://239.255.76.67:{port}?ttl={ttl}&recv_buf_size=2097152"


def eventually(
    condition: Callable[[], Any],
    what: str,
    limit: float = PATIENCE,
    seen: Callable[[], object] = lambda: "",
) -> Any:  # noqa: ANN401
    """The first true value of the condition; `seen` tells what there is instead, if it fails."""
    until = time.monotonic() + limit
    while not (value := condition()):
        if time.monotonic() > until:
            raise AssertionError(f"waited {limit:g} s for {what} {seen()}")
        time.sleep(0.01)
    return value


# ---- processes ----


@dataclass
class Ended:
    """A process that has ended and what it said."""

    name: str
    code: int
    out: str
    err: str

    def with_code(self, code: int) -> "Ended":
        """Itself, if that is its exit code."""
        if self.code != code:
            raise AssertionError(
                f"{self.name} ended with exit code {self.code}, not {code}"
                f"\n--- stdout\n{self.out}\n--- stderr\n{self.err}"
            )
        return self

    def failed(self) -> "Ended":
        """Itself, if it failed in an orderly way: an exit code, no signal."""
        return self if 0 < self.code < 64 else self.with_code(1)


class Agent:
    """A process of a test; its output goes into files, so that it never waits for a reader."""

    def __init__(self, name: str, process: subprocess.Popen[bytes], out: Path, err: Path) -> None:
        self.name, self.process, self._out, self._err = name, process, out, err

    @property
    def pid(self) -> int:
        """Process id."""
        return self.process.pid

    @property
    def running(self) -> bool:
        """Whether it has not ended yet."""
        return self.process.poll() is None

    @property
    def err(self) -> str:
        """What it has written to stderr so far."""
        return self._err.read_text(errors="replace")

    @property
    def out(self) -> str:
        """What it has written to stdout so far."""
        return self._out.read_text(errors="replace")

    def send(self, number: signal.Signals) -> None:
        """Send a signal."""
        self.process.send_signal(number)

    def wait(self, limit: float = PATIENCE) -> Ended:
        """Wait until it ends."""
        try:
            code = self.process.wait(limit)
        except subprocess.TimeoutExpired:
            raise AssertionError(
                f"{self.name} has not ended within {limit:g} s\n{self.out}\n{self.err}"
            ) from None
        return Ended(self.name, code, self.out, self.err)

    def says(self, text: str, limit: float = PATIENCE) -> None:
        """Wait until the text stands in its output."""
        eventually(
            lambda: text in self.err + self.out or not self.running,
            f"{self.name} to say '{text}'",
            limit,
        )
        assert text in self.err + self.out, f"{self.name} ended without '{text}':\n{self.err}"


class Stage:
    """Starts processes of one test and ends those that are left."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.agents: list[Agent] = []

    def start(
        self,
        *arguments: object,
        env: Mapping[str, str] | None = None,
        inside: str | None = None,
    ) -> Agent:
        """Start a program; `inside`: in the network namespace of that name."""
        words = [str(argument) for argument in arguments]
        name = f"{len(self.agents)}-{Path(words[0]).name}"
        out, err = self.folder / f"{name}.out", self.folder / f"{name}.err"
        if inside is not None:
            words = ["nsenter", f"--net=/run/netns/{inside}", *words]
        settings = {k: v for k, v in os.environ.items() if k != "LCM_DEFAULT_URL"} | dict(env or {})
        with out.open("wb") as stdout, err.open("wb") as stderr:
            process = subprocess.Popen(
                words, stdout=stdout, stderr=stderr, env=settings, cwd=self.folder
            )
        self.agents.append(agent := Agent(name, process, out, err))
        return agent

    def run(
        self,
        *arguments: object,
        limit: float = PATIENCE,
        env: Mapping[str, str] | None = None,
        inside: str | None = None,
    ) -> Ended:
        """Start a program and wait for its end."""
        return self.start(*arguments, env=env, inside=inside).wait(limit)

    def end(self, agent: Agent) -> Ended:
        """Ask a process to end and wait for it."""
        agent.send(signal.SIGTERM)
        return agent.wait()

    def close(self) -> None:
        """End what still runs; stopped processes too."""
        for agent in self.agents:
            if agent.running:
                agent.send(signal.SIGCONT)
                agent.send(signal.SIGTERM)
        for agent in self.agents:
            try:
                agent.process.wait(5)
            except subprocess.TimeoutExpired:
                agent.process.kill()
                agent.process.wait()


def processes_with(text: str) -> dict[int, str]:
    """All processes of the machine with the text in their command lines; zombies do not count."""
    found = {}
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit() or int(entry.name) == os.getpid():
            continue
        try:
            line = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if text in line:
            found[int(entry.name)] = line
    return found


def pid_of(url: str, *words: str) -> int:
    """The one process on a bus with these words in its command line."""
    found = [
        pid for pid, line in processes_with(url).items() if all(word in line for word in words)
    ]
    assert len(found) == 1, f"{words}: {found}"
    return found[0]


def nobody_left(url: str) -> None:
    """Wait until no process has the URL of a test's bus in its command line."""
    eventually(lambda: not processes_with(url), f"all processes on {url} to be gone", 20)


# ---- the bus ----


@dataclass
class Ear(threading.Thread):
    """Listens to a bus in the background."""

    url: str
    statuses: list[lcmtypes.status_t] = field(default_factory=list)
    sample: int = -1
    """Newest sample of an input."""
    inputs: list[tuple[float, int]] = field(default_factory=list)
    """When which sample's input came (monotonic s, k)."""
    heard: Counter[str] = field(default_factory=Counter)
    """Messages by channel."""
    keep: bool = False
    """Whether every message is kept in `messages`."""
    messages: list[tuple[str, bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__(daemon=True)
        self._ending = threading.Event()
        self._bus = lcm.LCM(self.url)
        pattern = ".*" if self.keep else "DSE_(STATUS|INPUT|CLOCK)"
        self._bus.subscribe(pattern, self._take).set_queue_capacity(0)

    __hash__ = threading.Thread.__hash__

    def _take(self, channel: str, data: bytes) -> None:
        self.heard[channel] += 1
        if self.keep:
            self.messages.append((channel, data))
        try:
            if channel == "DSE_STATUS":
                self.statuses.append(lcmtypes.status_t.decode(data))
            elif channel == "DSE_INPUT":
                k = lcmtypes.input_t.decode(data).header.sample
                self.inputs.append((time.monotonic(), k))
                self.sample = max(self.sample, k)
        except Exception:  # noqa: BLE001, S110 - what a hostile test sends is no message for us
            pass

    def run(self) -> None:
        """Listen until told to end."""
        while not self._ending.is_set():
            self._bus.handle_timeout(50)

    def close(self) -> None:
        """Stop listening."""
        self._ending.set()
        self.join(10)

    def of(self, network: int, node: int) -> list[lcmtypes.status_t]:
        """What a node said of itself so far."""
        return [
            one
            for one in list(self.statuses)
            if (one.header.network, one.header.node) == (network, node)
            and one.header.role == lcmtypes.header_t.ROLE_ESTIMATOR
        ]

    def await_state(
        self, state: int, nodes: Iterable[tuple[int, int]], limit: float = PATIENCE
    ) -> None:
        """Wait until each node has said that it is in this state."""
        for key in nodes:
            eventually(
                lambda key=key: any(one.state == state for one in self.of(*key)),
                f"(network, node) {key} to be in state {state}",
                limit,
                lambda key=key: [(one.state, one.header.sample) for one in self.of(*key)][-5:],
            )

    def await_any_from(self, agent: Agent) -> None:
        """Wait until a process is on the bus: an estimator has said something, a plant invites."""
        eventually(
            lambda: (
                any(one.pid == agent.pid for one in list(self.statuses))
                or ("plant" in agent.name and self.heard["DSE_CLOCK"] > 0)
            ),
            f"a word of {agent.name}",
        )

    def await_sample(self, k: int, limit: float = PATIENCE) -> None:
        """Wait until the run has come to sample k."""
        eventually(lambda: self.sample >= k, f"sample {k} (it is at {self.sample})", limit)

    def final(self, network: int, node: int) -> lcmtypes.status_t:
        """The last word of a node that has finished."""
        self.await_state(lcmtypes.status_t.STATE_FINISHED, [(network, node)])
        return [
            one for one in self.of(network, node) if one.state == lcmtypes.status_t.STATE_FINISHED
        ][-1]


@contextmanager
def listening(url: str, keep: bool = False) -> Iterator[Ear]:
    """An ear on the bus for as long as the block lasts."""
    ear = Ear(url, keep=keep)
    ear.start()
    try:
        yield ear
    finally:
        ear.close()


class Conductor(threading.Thread):
    """Beats time for a plant with --recorder-lag 1: holds it at a sample, lets it go on.

    The plant waits for the recorder's word `done`; saying it here lets a test act in the middle of
    a run without depending on how fast the machine is.
    """

    def __init__(self, url: str, run_id: int) -> None:
        super().__init__(daemon=True)
        self._bus = lcm.LCM(url)
        self._done = lcmtypes.done_t()
        self._done.header.run_id = run_id
        self._done.header.role = lcmtypes.header_t.ROLE_RUN
        self._done.header.network = -1
        self._until = -1
        self._ending = threading.Event()

    def let_run_until(self, k: int) -> None:
        """The plant may publish samples up to k, and no further."""
        self._until = k - 2
        """It goes one sample beyond the lag, which is 1."""

    def run(self) -> None:
        """Say it again and again: a word may be lost."""
        while not self._ending.wait(0.02):
            if self._until >= 0:
                self._done.header.sample = self._until
                self._bus.publish("DSE_DONE", self._done.encode())

    def close(self) -> None:
        """Stop."""
        self._ending.set()
        self.join(10)


# ---- what was estimated ----


def nodes_of(run: Run) -> dict[tuple[int, int], Node]:
    """Nodes of a run by (network, node)."""
    return {(network.index, node.node): node for network, node in run.nodes}


def hashes(log: Path, run_id: int | None = None) -> dict[tuple[int, int], tuple[int, int]]:
    """(hash, number) of the estimates of each node in a log."""
    run = read(log, None if run_id is None else str(run_id))
    return {
        key: (estimate_hash(node.estimates), len(node.estimates.sample))
        for key, node in nodes_of(run).items()
    }


def own_hash(status: lcmtypes.status_t) -> int:
    """A node's own hash over its estimates, as in `hashes`."""
    return int(status.estimate_hash) & (1 << 64) - 1


def assert_equal_where_logged(log: Path, reference: Path, least: float) -> None:
    """Every estimate in the log has the bits of the reference; at least that share is there."""
    have, want = nodes_of(read(log)), nodes_of(read(reference))
    assert have.keys() == want.keys()
    for key, node in have.items():
        _, i, j = np.intersect1d(
            node.estimates.sample, want[key].estimates.sample, return_indices=True
        )
        assert len(i) == len(node.estimates.sample)
        assert len(i) >= least * len(want[key].estimates.sample), f"{key}: only {len(i)} estimates"
        for name in ("value", "variance", "diagnostic"):
            mine = np.ascontiguousarray(getattr(node.estimates, name)[i]).view(np.uint64)
            theirs = np.ascontiguousarray(getattr(want[key].estimates, name)[j]).view(np.uint64)
            assert (mine == theirs).all(), f"{key}: {name} differs"


def inproc(stage: Stage, log: Path, *arguments: object, scenario: str = "ahg-43") -> Path:
    """Record a run in one process: the undisturbed reference of the other tests."""
    stage.run(dse("dse-run"), scenario, "--inproc", "--quiet", "--log", log, *arguments).with_code(
        0
    )
    return log


def text_of(status: lcmtypes.status_t) -> str:
    """The reason in a status message."""
    return bytes(status.reason[: status.reason_length]).decode(errors="replace")


def only(scenario: str, names: tuple[str, ...], samples: int, folder: Path) -> Path:
    """A copy of a shipped scenario in `folder` with some of its networks and so many samples."""
    file = Path(__file__).resolve().parents[2] / "sim" / "scenarios" / f"{scenario}.yaml"
    tree = yaml.safe_load(file.read_text())
    tree["networks"] = [network for network in tree["networks"] if network["name"] in names]
    assert len(tree["networks"]) == len(names)
    tree["time"]["duration_s"] = samples * tree["time"]["period_s"]
    short = folder / f"{scenario}-short.yaml"
    short.write_text(yaml.safe_dump(tree))
    return short
