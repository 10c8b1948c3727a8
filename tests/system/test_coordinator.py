"""The coordinator as a program: every way gives the same bits; its death is survived and healed."""

import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from harness import (
    Agent,
    Conductor,
    Ear,
    Stage,
    dse,
    eventually,
    hashes,
    inproc,
    listening,
    nodes_of,
)

from dse import lcmtypes
from dse.log import read
from dse.run import HEALTH

ALONE, TRACKING = HEALTH.index("alone"), HEALTH.index("tracking")
CONVERGED, HELD, LOCAL_ONLY = 1, 3, 4
"""Values of the diagnostic `status`: enum dse_mhe_status."""
AGENTS = (0, 1, 2)
SHORT = ("--set", "time.duration_s=540")
"""Thirty samples."""
HORIZON = 10


@pytest.mark.parametrize("scenario", ["cdm-e2", "cdm-e5", "cdm-x2"])
def test_processes_one_process_and_a_replay_give_the_same_bits(
    scenario: str, stage: Stage, url: str, tmp_path: Path
) -> None:
    """With bounds, with triggers, with losses; the coordinator's diagnostics included."""
    log, alone = tmp_path / "processes.lcm", tmp_path / "inproc.lcm"
    stage.run(
        dse("dse-run"), scenario, *SHORT, "--lcm-url", url, "--log", log, "--quiet"
    ).with_code(0)
    inproc(stage, alone, *SHORT, scenario=scenario)
    found, expected = hashes(log), hashes(alone)
    assert found == expected
    assert len(found) > len(AGENTS)
    for mine, theirs in zip(read(log).networks, read(alone).networks, strict=True):
        for one, other in zip(mine.nodes, theirs.nodes, strict=True):
            assert np.array_equal(
                one.estimates.diagnostic.view(np.uint64), other.estimates.diagnostic.view(np.uint64)
            )
    stage.run(dse("dse-run"), "--replay", log, "--quiet").with_code(0)


# ---- by hand ----

BY_HAND = ("cdm-e1", "--set", "time.duration_s=100000", "--set", "timeouts.patience_s=0.5")
RUN_ID = 4711


class Hand:
    """A run of cdm-e1, price-driven network, whose agents are started and killed by hand."""

    def __init__(self, stage: Stage, url: str, ear: Ear, *changes: str) -> None:
        self.stage, self.url, self.ear, self.changes = stage, url, ear, changes
        self.conductor = Conductor(url, RUN_ID)
        self.conductor.start()

    def start(self, program: str, *arguments: object) -> Agent:
        """One of its processes."""
        return self.stage.start(
            dse(program), *BY_HAND, *self.changes, "--lcm-url", self.url, *arguments
        )

    def estimators(self, *nodes: object) -> list[Agent]:
        """Estimators, one process each."""
        return [self.start("dse-estimator", "--node", node) for node in nodes]

    def plant(self) -> Agent:
        """The plant, which waits for the conductor."""
        return self.start("dse-plant", "--run-id", RUN_ID, "--recorder-lag", 1)

    def run_to(self, k: int) -> None:
        """Let it go to sample k and wait until the agents that live have estimated it."""
        self.conductor.let_run_until(k)
        self.ear.await_sample(k)

    def estimates(self, node: int) -> dict[int, lcmtypes.estimate_t]:
        """What a node of network 0 has said, by sample."""
        channel = f"DSE_ESTIMATE_0_{node}"
        said = [lcmtypes.estimate_t.decode(data) for name, data in list(self.ear.messages)
                if name == channel]  # fmt: skip
        return {one.header.sample: one for one in said}

    def status(self, node: int, k: int) -> int:
        """What it says of its estimate of a sample: a diagnostic."""
        return int(self.estimates(node)[k].diagnostic[1])

    def await_health(self, node: int, health: int, since: int) -> int:
        """The first sample from `since` on at which a node reports it."""
        found: int = eventually(
            lambda: next(
                (k for k, one in sorted(self.estimates(node).items())
                 if k >= since and one.health == health),
                None,
            ),
            f"node {node} to be {HEALTH[health]} after sample {since}",
            seen=lambda: [(k, one.health) for k, one in sorted(self.estimates(node).items())][-5:],
        )  # fmt: skip
        return found


@pytest.fixture
def hand(stage: Stage, url: str) -> Iterator[Hand]:
    """A run by hand with an ear on it; its conductor ends with the test."""
    with listening(url, keep=True) as ear:
        made = Hand(stage, url, ear)
        yield made
        made.conductor.close()


@pytest.fixture
def undisturbed(stage: Stage, tmp_path: Path) -> dict[int, np.ndarray]:
    """The estimates of the agents when nobody dies, by node."""
    log = inproc(stage, tmp_path / "undisturbed.lcm", "--set", "time.duration_s=1800",
                 scenario="cdm-e1")  # fmt: skip
    nodes = nodes_of(read(log))
    return {node: nodes[0, node].estimates.value for node in AGENTS}


def assert_as_undisturbed(
    hand: Hand, node: int, undisturbed: dict[int, np.ndarray], samples: range
) -> None:
    """What a node says is what it says when nobody dies: it depends on its window only."""
    said = hand.estimates(node)
    for k in samples:
        mine = np.array(said[k].state[: said[k].count])
        assert mine == pytest.approx(undisturbed[node][k], abs=1e-9), f"node {node}, sample {k}"


def test_a_killed_coordinator_leaves_decentralised_agents_and_heals_them_when_it_returns(
    hand: Hand, undisturbed: dict[int, np.ndarray]
) -> None:
    agents = hand.estimators(*AGENTS)
    coordinator = hand.start("dse-coordinator")
    plant = hand.plant()
    hand.run_to(20)
    for node in AGENTS:
        hand.await_health(node, TRACKING, 20)
    coordinator.send(signal.SIGKILL)
    coordinator.wait()
    hand.run_to(45)
    for node in AGENTS:
        lonely = hand.await_health(node, ALONE, 20)
        assert hand.status(node, lonely) == HELD
        # What the coordinator said last is held for Hp samples.
        hand.await_health(node, ALONE, 45)
        assert hand.status(node, lonely + HORIZON + 1) == LOCAL_ONLY
        assert hand.status(node, 45) == LOCAL_ONLY
    again = hand.start("dse-coordinator")
    hand.ear.await_any_from(again)
    eventually(
        lambda: any(
            one.pid == again.pid and one.state == lcmtypes.status_t.STATE_RUNNING
            for one in list(hand.ear.statuses)
        ),
        "the new coordinator to be let in",
    )
    hand.run_to(80)
    for node in AGENTS:
        back = hand.await_health(node, TRACKING, 46)
        assert back <= 50
        hand.await_health(node, TRACKING, 80)
        assert hand.status(node, 80) == CONVERGED
        assert_as_undisturbed(hand, node, undisturbed, range(back, 81))
    assert all(agent.running for agent in [*agents, again, plant])


def test_a_coordinator_that_stood_still_is_not_waited_for_and_catches_up(hand: Hand) -> None:
    hand.estimators("0..2")
    coordinator = hand.start("dse-coordinator")
    hand.plant()
    hand.run_to(20)
    coordinator.send(signal.SIGSTOP)
    hand.run_to(400)  # more than a node keeps in store
    hand.await_health(0, ALONE, 400)
    coordinator.send(signal.SIGCONT)
    hand.run_to(450)
    back = hand.await_health(0, TRACKING, 400)
    hand.await_health(0, TRACKING, 450)
    assert back < 450


def test_a_killed_agent_is_done_without_and_is_coordinated_again_when_its_window_is_full(
    hand: Hand, undisturbed: dict[int, np.ndarray]
) -> None:
    first = hand.start("dse-estimator", "--node", 0, "--network", "price")
    for network in ("standard", "centralised", "centralised_D", "decentralised"):
        hand.start("dse-estimator", "--node", 0, "--network", network)
    hand.estimators("1..2")
    hand.start("dse-coordinator")
    hand.plant()
    hand.run_to(20)
    first.send(signal.SIGKILL)
    first.wait()
    hand.run_to(40)
    hand.await_health(1, TRACKING, 40)
    again = hand.start("dse-estimator", "--node", 0, "--network", "price")
    eventually(
        lambda: any(
            one.pid == again.pid and one.state == lcmtypes.status_t.STATE_RUNNING
            for one in list(hand.ear.statuses)
        ),
        "the new agent to be let in",
    )
    hand.run_to(80)
    for node in AGENTS:
        hand.await_health(node, TRACKING, 80)
    assert hand.status(0, 80) == CONVERGED
    # Nobody's window has data of the time in which it was away any more.
    for node in AGENTS:
        assert_as_undisturbed(hand, node, undisturbed, range(70, 81))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("dse-estimator", "cdm-e1", "--node", "3"), "dse-coordinator runs the coordinator"),
        (("dse-coordinator", "ahg-43"), "no network of this scenario has a coordinator"),
        (("dse-coordinator", "cdm-e1", "--network", "decentralised"),
         "this network has no coordinator"),
        (("dse-coordinator", "cdm-e1", "--network", "x"), "has no such network"),
    ],
)  # fmt: skip
def test_who_coordinates_nobody_is_told_so(words: tuple[str, ...], said: str, stage: Stage) -> None:
    program, *arguments = words
    ended = stage.run(dse(program), *arguments).with_code(2)
    assert said in ended.err


def test_a_plant_that_misses_the_coordinator_names_the_program(stage: Stage, url: str) -> None:
    stage.start(dse("dse-estimator"), "cdm-e1", "--lcm-url", url, "--node", "0..2")
    said = stage.run(dse("dse-plant"), "cdm-e1", "--lcm-url", url, "--wait", 3).with_code(1)
    assert "node 3 of network price (and others) did not join within 3 s" in said.err
    assert "start it with: dse-coordinator " in said.err


@pytest.mark.parametrize(
    ("scenario", "change", "said"),
    [
        ("cdm-e1", "Hmin=11", "coordinated_mhe.Hmin: 11 is more than Hp = 10"),
        ("cdm-e1", "anderson=8", "coordinated_mhe.anderson: it goes with scheme prediction only"),
        ("cdm-e1", "Hp=100", "make a message of 2701 numbers; at most 2048 fit"),
        ("cdm-e1", "origin=[0, 0, 0, 0, 0, 0, 0, 0, 0]", "origin is no steady state of plant"),
        ("cdm-e1", "scheme=x", "is not one of: prediction, price, decentralised, centralised"),
    ],
)
def test_a_section_that_makes_no_sense_is_refused(
    scenario: str, change: str, said: str, stage: Stage
) -> None:
    changed = f"networks.price.coordinated_mhe.{change}"
    ended = stage.run(dse("dse-run"), scenario, "--dry-run", "--set", changed).with_code(2)
    assert said in ended.err


def test_a_nonlinear_plant_needs_a_steady_state_to_be_linearised_at(
    stage: Stage, tmp_path: Path
) -> None:
    scenario = tmp_path / "no_origin.yaml"
    scenario.write_text(
        "name: no_origin\n"
        "time: {period_s: 18, duration_s: 180}\n"
        "plant: {name: cstr2}\n"
        "networks:\n"
        "  - name: one\n"
        "    coordinated_mhe: {scheme: centralised, Hp: 5, Hmin: 3, Q: [1, 1, 1, 1], R: [1, 1]}\n"
    )
    ended = stage.run(dse("dse-run"), scenario, "--dry-run").with_code(2)
    assert "networks.one.coordinated_mhe.origin is missing" in ended.err


def test_a_deadline_that_nobody_can_meet_ends_every_sample_with_what_there_is(
    stage: Stage, url: str, tmp_path: Path
) -> None:
    """Real time a million times too fast: estimates all the same, and they say what they are."""
    log = tmp_path / "late.lcm"
    stage.run(
        dse("dse-run"), "cdm-e5", *SHORT, "--pace", "realtime", "--speed", 1e6,
        "--lcm-url", url, "--log", log, "--quiet",
    ).with_code(0)  # fmt: skip
    run = read(log)
    for network in (0, 1):
        *agents, coordinator = run.networks[network].nodes
        assert not (coordinator.estimates.diagnostic[2:, 1] == CONVERGED).any()
        for agent in agents:
            assert agent.estimates.sample.tolist() == list(range(30))
            assert np.isfinite(agent.estimates.value).all()
            assert not (agent.estimates.diagnostic[2:, 1] == CONVERGED).any()
