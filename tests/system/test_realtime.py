"""Pace realtime: by the wall clock; who is late is predicted, not waited for."""

import os
import re
import signal
import time
from pathlib import Path

from harness import NODES_OF_AHG_43, Ear, Stage, dse, eventually, listening, nodes_of, pid_of

from dse import lcmtypes
from dse.log import read

SPEED = 50
SAMPLES = 300
SECONDS = SAMPLES / SPEED
RUN = ("ahg-43", "--pace", "realtime", "--speed", SPEED)


def test_all_samples_are_published_in_time_and_estimated(
    stage: Stage, url: str, tmp_path: Path
) -> None:
    log = tmp_path / "realtime.lcm"
    with listening(url) as ear:
        stage.run(
            dse("dse-run"), *RUN, "--set", f"time.duration_s={SAMPLES}",
            "--lcm-url", url, "--log", log, "--quiet",
        ).with_code(0)  # fmt: skip
        # Never early; how much later than that is the machine's affair.
        first = next(when for when, k in ear.inputs if k == 0)
        last = next(when for when, k in ear.inputs if k == SAMPLES - 1)
    assert last - first > SECONDS * (SAMPLES - 1) / SAMPLES - 0.5
    run = read(log)
    assert run.info["pace"] == "realtime"
    assert run.truth.sample.tolist() == list(range(SAMPLES))
    assert nodes_of(run).keys() == NODES_OF_AHG_43
    for node in nodes_of(run).values():
        assert node.estimates.sample.tolist() == list(range(SAMPLES))


def test_the_run_ends_when_it_says_although_an_estimator_stands_still(
    stage: Stage, url: str, tmp_path: Path
) -> None:
    """It is stopped for good: the others predict, and the clock does not wait for it."""
    with listening(url) as ear:
        log = tmp_path / "stopped.lcm"
        run = stage.start(
            dse("dse-run"), *RUN, "--set", f"time.duration_s={SAMPLES}",
            "--lcm-url", url, "--log", log, "--quiet",
        )  # fmt: skip
        ear.await_sample(50)
        stopped = pid_of(url, "--node 1")
        os.kill(stopped, signal.SIGSTOP)
        began = time.monotonic()
        ear.await_sample(SAMPLES - 1, limit=10 * SECONDS)
        assert time.monotonic() - began < 5 * SECONDS, "the clock must not wait for node 1"
        for network in (0, 1):
            eventually(
                lambda network=network: ear.of(network, 0)[-1].predicted > 0,
                f"node 0 of network {network} to predict",
            )
        os.kill(stopped, signal.SIGCONT)
        run.wait().with_code(0)
    nodes = nodes_of(read(log))
    for network in (0, 1):
        assert nodes[network, 0].estimates.sample.tolist() == list(range(SAMPLES))


def test_an_estimator_that_stood_still_comes_back(stage: Stage, url: str, tmp_path: Path) -> None:
    """After SIGCONT it catches up and the others hear it again: no more predictions."""
    with listening(url) as ear:
        log = tmp_path / "back.lcm"
        run = stage.start(
            dse("dse-run"), *RUN, "--set", "time.duration_s=100000",
            "--lcm-url", url, "--log", log, "--quiet",
        )  # fmt: skip
        ear.await_sample(50)
        stopped = pid_of(url, "--node 1")
        os.kill(stopped, signal.SIGSTOP)
        eventually(lambda: last(ear, 0).predicted > 20, "node 0 to predict")
        os.kill(stopped, signal.SIGCONT)
        # Its own estimates are in step with the clock again, and nobody predicts any more.
        eventually(
            lambda: (
                last(ear, 1).header.sample > ear.sample - 2 * SPEED
                and stands_still(ear, seconds=1.5)
            ),
            "node 1 to have come back",
            seen=lambda: [(one.header.sample, one.predicted) for one in ear.of(0, 0)][-5:],
        )
        run.send(signal.SIGINT)
        told = run.wait().with_code(1)
        assert re.search(r"interrupted at sample \d+", told.err)


def last(ear: Ear, node: int) -> lcmtypes.status_t:
    """The last word of a node of network 0."""
    return ear.of(0, node)[-1]


def stands_still(ear: Ear, seconds: float) -> bool:
    """Whether node 0 predicts nothing between two of its words."""
    before = last(ear, 0)
    eventually(
        lambda: last(ear, 0).header.sample > before.header.sample + seconds * SPEED,
        "another word of node 0",
    )
    return last(ear, 0).predicted == before.predicted
