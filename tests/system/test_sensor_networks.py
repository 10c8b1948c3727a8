"""Sensors on a graph: many nodes in one process or each in its own, and nodes that come and go."""

import signal
from pathlib import Path

import pytest
import yaml
from harness import (
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

SCENARIOS = Path(__file__).resolve().parents[2] / "sim" / "scenarios"
TRACKING = 1
USED = 3
"""Index of the diagnostic `neighbours used` of the distributed Kalman filters."""


@pytest.mark.parametrize(
    "scenario", ["aho-e2", "aho-dt_ring6", "aho-loss_ring6", "aho-e5", "aho-e6"]
)
def test_processes_one_process_and_a_replay_give_the_same_bits(
    scenario: str, stage: Stage, url: str, tmp_path: Path
) -> None:
    """With one gain for the network too, whose sum is over all nodes; with losses."""
    log, alone = tmp_path / "processes.lcm", tmp_path / "inproc.lcm"
    short = ("--set", "time.duration_s=0.6")
    stage.run(
        dse("dse-run"), scenario, *short, "--lcm-url", url, "--log", log, "--quiet"
    ).with_code(0)
    inproc(stage, alone, *short, scenario=scenario)
    found = hashes(log)
    assert found == hashes(alone)
    assert len({number for number, _ in found.values()}) > len(found) / 2
    stage.run(dse("dse-run"), "--replay", log, "--quiet").with_code(0)


FEW = ("--set", "time.duration_s=0.05")


@pytest.fixture
def answer(stage: Stage, tmp_path: Path) -> dict[tuple[int, int], tuple[int, int]]:
    """What fifty nodes with 229 links estimate in one process with the plant: 200 filters."""
    found = hashes(inproc(stage, tmp_path / "inproc.lcm", *FEW, scenario="aho-e1"))
    assert len(found) == 200
    return found


def test_fifty_nodes_in_one_estimator_give_the_same_bits(
    stage: Stage, url: str, answer: dict[tuple[int, int], tuple[int, int]]
) -> None:
    """By hand: dse-estimator --node 0..49."""
    with listening(url) as ear:
        nodes = stage.start(
            dse("dse-estimator"), "aho-e1", *FEW, "--node", "0..49", "--lcm-url", url
        )
        stage.run(dse("dse-plant"), "aho-e1", *FEW, "--lcm-url", url).with_code(0)
        nodes.wait().with_code(0)
        assert {key: own_hash(ear.final(*key)) for key in answer} == {
            key: number for key, (number, _) in answer.items()
        }


@pytest.mark.parametrize(
    "words", [("--processes", 2), pytest.param((), marks=pytest.mark.long)], ids=["two", "fifty"]
)
def test_fifty_nodes_in_two_processes_or_each_in_its_own_give_the_same_bits(
    words: tuple[object, ...],
    stage: Stage,
    url: str,
    tmp_path: Path,
    answer: dict[tuple[int, int], tuple[int, int]],
) -> None:
    """By dse-run."""
    log = tmp_path / "processes.lcm"
    arguments = (*FEW, *words, "--lcm-url", url, "--log", log, "--quiet")
    stage.run(dse("dse-run"), "aho-e1", *arguments).with_code(0)
    assert hashes(log) == answer


# ---- a node that comes and goes ----


@pytest.fixture
def ring(tmp_path: Path) -> Path:
    """The ring of aho-e2, with a gain per edge only and without an end."""
    (file,) = SCENARIOS.glob("aho-e2_*.yaml")
    scenario = yaml.safe_load(file.read_text())
    scenario["time"]["duration_s"] = 1e5
    scenario["networks"] = scenario["networks"][:1]
    path = tmp_path / "ring.yaml"
    path.write_text(yaml.safe_dump(scenario))
    return path


def newest(ear: Ear, node: int) -> lcmtypes.estimate_t | None:
    """The last estimate of a node of network 0."""
    said = [data for name, data in list(ear.messages) if name == f"DSE_ESTIMATE_0_{node}"]
    return lcmtypes.estimate_t.decode(said[-1]) if said else None


def uses(ear: Ear, node: int, neighbours: int, since: int) -> bool:
    """Whether a node tracks with so many neighbours in use, at a sample after `since`."""
    one = newest(ear, node)
    return (
        one is not None
        and one.header.sample > since
        and one.health == TRACKING
        and one.diagnostic[USED] == neighbours
    )


def test_a_killed_node_is_left_out_and_taken_back_when_it_returns(
    ring: Path, stage: Stage, url: str
) -> None:
    """By the wall clock, twenty samples in a second: who is gone is not waited for."""
    pace = ("--pace", "realtime", "--speed", 0.2, "--lcm-url", url)
    with listening(url, keep=True) as ear:
        others = [stage.start(dse("dse-estimator"), ring, *pace, "--node", nodes)
                  for nodes in ("0..2", "4..5")]  # fmt: skip
        third = stage.start(dse("dse-estimator"), ring, *pace, "--node", 3)
        plant = stage.start(dse("dse-plant"), ring, *pace)
        ear.await_sample(5)
        for node in (2, 3, 4):
            eventually(lambda node=node: uses(ear, node, 2, 5), f"node {node} to use both")
        third.send(signal.SIGKILL)
        third.wait()
        killed = ear.sample
        for node in (2, 4):
            eventually(lambda node=node: uses(ear, node, 1, killed + 2), f"node {node} to use one")
        ear.await_sample(killed + 20)
        for node in (0, 1, 5):
            eventually(lambda node=node: uses(ear, node, 2, killed + 20), f"node {node} to go on")
        assert not uses(ear, 2, 2, killed + 2)
        again = stage.start(dse("dse-estimator"), ring, *pace, "--node", 3)
        back = ear.sample
        for node in (2, 3, 4):
            eventually(lambda node=node: uses(ear, node, 2, back), f"node {node} to use both again")
        assert all(agent.running for agent in [*others, again, plant])
