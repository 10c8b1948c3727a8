"""Agents that die, runs that are stopped: told plainly; the log survives, nobody stays behind."""

import os
import re
import signal
from pathlib import Path

import pytest
from harness import (
    NODES_OF_AHG_43,
    Agent,
    Stage,
    dse,
    eventually,
    listening,
    nobody_left,
    nodes_of,
    pid_of,
    processes_with,
    tool,
)

from dse.compare import estimate_hash
from dse.log import read
from dse.run import Node

ENDLESS = ("--set", "time.duration_s=1000000")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Where the run of a test is recorded."""
    return tmp_path / "run.lcm"


def start_run(stage: Stage, url: str, log: Path, *arguments: object) -> Agent:
    """A run that does not end by itself."""
    return stage.start(
        dse("dse-run"), "ahg-43", *ENDLESS, "--lcm-url", url, "--log", log, "--quiet", *arguments
    )


def assert_log_is_good(stage: Stage, log: Path) -> dict[tuple[int, int], Node]:
    """The log is readable as it is and holds estimates of all nodes."""
    told = stage.run(tool("dse"), "info", log).with_code(0)
    assert "ahg-43_cstr2_continuous" in told.out
    nodes = nodes_of(read(log))
    assert nodes.keys() == NODES_OF_AHG_43
    assert all(len(node.estimates.sample) > 0 for node in nodes.values())
    return nodes


def assert_log_is_complete(stage: Stage, log: Path, *, to: int) -> None:
    """It is good and holds the estimates of every sample up to one."""
    for node in assert_log_is_good(stage, log).values():
        assert node.estimates.sample[: to + 1].tolist() == list(range(to + 1))


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("dse-estimator", "--node 1"), "dse-estimator --node 1"),
        (("dse-plant",), "dse-plant"),
    ],
    ids=["estimator", "plant"],
)
def test_a_killed_agent_is_named_with_the_last_sample(
    words: tuple[str, ...], name: str, stage: Stage, url: str, log: Path
) -> None:
    with listening(url) as ear:
        run = start_run(stage, url, log)
        ear.await_sample(50)
        os.kill(pid_of(url, *words), signal.SIGKILL)
        ended = run.wait()
        last = ear.sample
    ended.with_code(1)
    found = re.search(rf"dse-run: {name} was killed by signal 9 .*; last sample.* (\d+)", ended.err)
    assert found, ended.err
    assert 50 <= int(found[1]) <= last
    assert f"log: {log}" in ended.out
    nobody_left(url)
    assert_log_is_complete(stage, log, to=40)


def test_a_killed_logger_is_told_and_what_it_wrote_survives(
    stage: Stage, url: str, log: Path
) -> None:
    with listening(url) as ear:
        run = start_run(stage, url, log)
        ear.await_sample(50)
        os.kill(pid_of(url, "lcm-logger"), signal.SIGKILL)
        ended = run.wait().with_code(1)
        found = re.search(r"lcm-logger has ended; the log stops at sample (\d+)", ended.err)
        assert found, ended.err
        assert int(found[1]) >= 40
    nobody_left(url)
    assert_log_is_complete(stage, log, to=40)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("way", ["processes", "inproc"])
def test_a_stopped_run_ends_cleanly_with_a_complete_log(
    number: signal.Signals, way: str, stage: Stage, url: str, log: Path
) -> None:
    """Nothing is missing: the nodes' own hashes are those of the logged estimates."""
    with listening(url) as ear:
        if way == "inproc":
            run = start_run(stage, url, log, "--inproc")
            eventually(lambda: log.exists() and log.stat().st_size > 1e6, "a megabyte of log")
        else:
            run = start_run(stage, url, log)
            ear.await_sample(50)
        run.send(number)
        ended = run.wait().with_code(1)
    found = re.search(r"dse-run: interrupted at sample (\d+)", ended.err)
    assert found, ended.err
    nobody_left(url)
    told = stage.run(tool("dse"), "info", log).with_code(0)
    assert re.search(r"end +early, at sample", told.out), told.out
    recorded = read(log)
    assert not recorded.lost, recorded.lost
    for node in nodes_of(recorded).values():
        assert len(node.estimates.sample) >= 50
        assert node.estimate_hash == estimate_hash(node.estimates)


def test_a_killed_dse_run_leaves_no_process_behind(stage: Stage, url: str, log: Path) -> None:
    with listening(url) as ear:
        run = start_run(stage, url, log)
        ear.await_sample(50)
        assert len(processes_with(url)) == 5
        run.send(signal.SIGKILL)
        run.wait()
        nobody_left(url)
    # lcm-logger's own log: on a busy machine it lacks messages, and nobody is left to mend that.
    assert_log_is_good(stage, log)
