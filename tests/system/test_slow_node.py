"""Lockstep with a node that stands still for a while: nobody shouts, and the bits are the same."""

import os
import signal
import time
from pathlib import Path

from harness import Stage, dse, hashes, inproc, listening, nodes_of, pid_of

from dse.log import read

SHORT = ("--set", "time.duration_s=300")
NODES = 4
SLEEPER = 2


def test_only_the_node_that_is_missing_is_asked_and_answers(
    stage: Stage, url: str, tmp_path: Path
) -> None:
    """Four reactors that exchange something at every sample; one estimator sleeps two seconds."""
    log = tmp_path / "slow.lcm"
    with listening(url) as ear:
        run = stage.start(
            dse("dse-run"), "ahg-56", *SHORT, "--lcm-url", url, "--log", log, "--quiet"
        )
        ear.await_sample(20)
        sleeper = pid_of(url, f"--node {SLEEPER}")
        os.kill(sleeper, signal.SIGSTOP)
        time.sleep(2)
        os.kill(sleeper, signal.SIGCONT)
        run.wait().with_code(0)
    nodes = nodes_of(read(log))
    asked = sum(node.status["asked"] for node in nodes.values())
    needed = sum(node.status["asked"] for (_, number), node in nodes.items() if number == SLEEPER)
    answered = sum(
        node.status["answered"] for (_, number), node in nodes.items() if number != SLEEPER
    )
    assert asked - needed >= 2 * (NODES - 1), "two seconds are long enough to ask more than once"
    # The others are not missing: only the sleeper itself may have lost something of theirs.
    assert answered <= (NODES - 1) * needed + (asked - needed) // 4
    assert hashes(log) == hashes(inproc(stage, tmp_path / "inproc.lcm", *SHORT, scenario="ahg-56"))
