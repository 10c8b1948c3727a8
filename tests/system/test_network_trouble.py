"""Networks that lose, delay, reorder and double: the same bits, or a plain word why not."""

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from harness import (
    Ear,
    Stage,
    assert_equal_where_logged,
    dse,
    eventually,
    free_port,
    hashes,
    inproc,
    listening,
    nodes_of,
    own_hash,
    tool,
    url_of,
)
from netns import (
    bring_up_loopback,
    entered,
    join_with_cable,
    lose,
    lost,
    namespaces,
    needs_namespaces,
)

from dse.log import read

SAMPLES = 200
LENGTH = ("--set", f"time.duration_s={SAMPLES}", "--set", "timeouts.give_up_s=100")
QUICK = ("--set", "timeouts.repeat_s=0.004")
"""What is lost is asked for soon, so that the test is short."""
Hashes = dict[tuple[int, int], tuple[int, int]]


@pytest.fixture(scope="module")
def reference(shared: Stage) -> Path:
    """Log of the undisturbed run."""
    return inproc(shared, shared.folder / "inproc.lcm", *LENGTH)


@pytest.fixture(scope="module")
def answer(reference: Path) -> Hashes:
    """Its estimates."""
    return hashes(reference)


@contextmanager
def listening_inside(name: str, url: str) -> Iterator[Ear]:
    """An ear in a namespace."""
    with entered(name):
        ear = Ear(url)
    ear.start()
    try:
        yield ear
    finally:
        ear.close()


@needs_namespaces
@pytest.mark.parametrize("percent", [5, 20])
def test_random_losses_change_no_bit(
    percent: int, stage: Stage, url: str, reference: Path, answer: Hashes, tmp_path: Path
) -> None:
    """On one host a lost datagram is lost to all who listen, the logger too.

    So what is logged is compared, and the nodes' own hashes, which their later words tell.
    """
    log = tmp_path / "lossy.lcm"
    with namespaces(1) as (host,):
        bring_up_loopback(host)
        lose(host, percent)
        stage.run(
            dse("dse-run"), "ahg-43", *LENGTH, *QUICK, "--quiet", "--lcm-url", url, "--log", log,
            inside=host,
        ).with_code(0)  # fmt: skip
        assert lost(host) > percent * SAMPLES / 10
    assert_equal_where_logged(log, reference, least=1 - 2 * percent / 100)
    for node in nodes_of(read(log)).values():
        assert node.status["asked"] > 0
        assert node.status["predicted"] == 0
        assert node.status["gaps"] == 0


@needs_namespaces
def test_without_a_multicast_route_dse_run_tells_the_command_that_mends_it(
    stage: Stage, url: str
) -> None:
    run = (dse("dse-run"), "ahg-43", *LENGTH, "--no-log", "--quiet", "--lcm-url", url)
    with namespaces(1) as (host,):
        said = stage.run(*run, inside=host).failed()
        assert f"dse-run: cannot open the bus {url}" in said.err
        assert "LCM needs a route for multicast" in said.err
        command = re.search(r"^ +(ip link .*)$", said.err, re.MULTILINE)
        assert command, said.err
        subprocess.run(
            ["ip", "netns", "exec", host, "sh", "-e", "-c", command[1]], check=True, timeout=60
        )
        stage.run(*run, inside=host).with_code(0)


@needs_namespaces
def test_without_any_network_everything_runs_in_one_process(stage: Stage, tmp_path: Path) -> None:
    log = tmp_path / "alone.lcm"
    with namespaces(1) as (host,):
        stage.run(
            dse("dse-run"), "ahg-43", *LENGTH, "--inproc", "--log", log, "--quiet", inside=host
        ).with_code(0)


def test_delays_reordering_and_duplicates_change_no_bit(
    stage: Stage, url: str, answer: Hashes
) -> None:
    """The plant is on one bus, the estimators are on another, a bad relay is between them."""
    near, far = free_port(), free_port()
    relay = stage.start(
        sys.executable, "-B", Path(__file__).parent / "relay.py", "239.255.76.67", near, far,
        11, 0.008, 0.2,
    )  # fmt: skip
    relay.says("relaying")
    with listening(url_of(far)) as ear:
        nodes = [
            stage.start(
                dse("dse-estimator"),
                "ahg-43",
                *LENGTH,
                *QUICK,
                "--node",
                node,
                "--lcm-url",
                url_of(far),
            )  # fmt: skip
            for node in (0, 1)
        ]
        stage.run(dse("dse-plant"), "ahg-43", *LENGTH, *QUICK, "--lcm-url", url_of(near)).with_code(
            0
        )
        for node in nodes:
            node.wait().with_code(0)
        final = {key: ear.final(*key) for key in answer}
    stage.end(relay)
    forwarded, reordered, duplicated = map(int, relay.out.split()[1:])
    assert forwarded > 10 * SAMPLES
    assert reordered > SAMPLES
    assert duplicated > SAMPLES
    assert {key: own_hash(status) for key, status in final.items()} == {
        key: number for key, (number, _) in answer.items()
    }
    assert all(status.duplicates > SAMPLES / 4 for status in final.values())


@needs_namespaces
@pytest.mark.parametrize("percent", [0, 10])
def test_two_hosts_estimate_the_same_bits(
    percent: int, stage: Stage, reference: Path, answer: Hashes, tmp_path: Path
) -> None:
    """Plant and logger on one host, estimators on the other; with ttl=1 they hear each other."""
    url = url_of(7667, ttl=1)
    log = tmp_path / "two-hosts.lcm"
    with namespaces(2) as (near, far), ExitStack() as leave:
        join_with_cable(near, far)
        if percent:
            lose(near, percent)
            lose(far, percent)
        ear = leave.enter_context(listening_inside(near, url))
        logger = stage.start(
            tool("lcm-logger"), f"--lcm-url={url}", "--flush-interval=10", log, inside=near
        )
        nodes = [
            stage.start(
                dse("dse-estimator"),
                "ahg-43",
                *LENGTH,
                *QUICK,
                "--node",
                node,
                "--lcm-url",
                url,
                inside=far,
            )  # fmt: skip
            for node in (0, 1)
        ]
        eventually(lambda: log.exists() and log.stat().st_size > 0, "lcm-logger to write")
        stage.run(
            dse("dse-plant"), "ahg-43", *LENGTH, *QUICK, "--lcm-url", url, inside=near
        ).with_code(0)
        for node in nodes:
            node.wait().with_code(0)
        if not percent:
            assert {key: own_hash(ear.final(*key)) for key in answer} == {
                key: number for key, (number, _) in answer.items()
            }
        stage.end(logger)
        if percent:
            assert lost(near) > 0
            assert lost(far) > 0
    assert_equal_where_logged(log, reference, least=0.5)
