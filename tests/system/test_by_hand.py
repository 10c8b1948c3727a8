"""Agents started by hand, one by one, as in terminals on one or several hosts."""

import itertools
from pathlib import Path

import pytest
from harness import (
    NODES_OF_AHG_43,
    Agent,
    Conductor,
    Stage,
    dse,
    eventually,
    hashes,
    inproc,
    listening,
    own_hash,
    text_of,
    tool,
)

from dse import lcmtypes

SAMPLES = 300
LENGTH = ("--set", f"time.duration_s={SAMPLES}", "--set", "timeouts.give_up_s=100")
READY, RUNNING = lcmtypes.status_t.STATE_READY, lcmtypes.status_t.STATE_RUNNING
FAILED = lcmtypes.status_t.STATE_FAILED
Hashes = dict[tuple[int, int], tuple[int, int]]


@pytest.fixture(scope="module")
def answer(shared: Stage) -> Hashes:
    """What all ways must give."""
    return hashes(inproc(shared, shared.folder / "inproc.lcm", *LENGTH))


def estimator(stage: Stage, url: str, node: object, *arguments: object) -> Agent:
    """One estimator process."""
    return stage.start(
        dse("dse-estimator"),
        "ahg-43",
        *LENGTH,
        "--lcm-url",
        url,
        "--node",
        node,
        *arguments,
    )


def plant(stage: Stage, url: str, *arguments: object) -> Agent:
    """The plant."""
    return stage.start(dse("dse-plant"), "ahg-43", *LENGTH, "--lcm-url", url, *arguments)


@pytest.mark.parametrize("order", list(itertools.permutations(("plant", 0, 1))), ids=str)
def test_agents_may_be_started_in_any_order(
    order: tuple[object, ...], stage: Stage, url: str, answer: Hashes
) -> None:
    with listening(url) as ear:
        agents: list[Agent] = []
        for one in order:
            if agents:
                ear.await_any_from(agents[-1])
            agents.append(plant(stage, url) if one == "plant" else estimator(stage, url, one))
        for agent in agents:
            agent.wait().with_code(0)
        assert {key: own_hash(ear.final(*key)) for key in answer} == {
            key: number for key, (number, _) in answer.items()
        }


def test_the_url_of_the_environment_is_used_and_lcm_logger_records(
    stage: Stage, url: str, answer: Hashes, tmp_path: Path
) -> None:
    env = {"LCM_DEFAULT_URL": url}
    log = tmp_path / "by-hand.lcm"
    with listening(url) as ear:
        logger = stage.start(tool("lcm-logger"), "--flush-interval=10", log, env=env)
        nodes = [
            stage.start(dse("dse-estimator"), "ahg-43", *LENGTH, "--node", node, env=env)
            for node in (0, 1)
        ]
        ear.await_state(lcmtypes.status_t.STATE_JOINING, NODES_OF_AHG_43)
        eventually(lambda: log.exists() and log.stat().st_size > 0, "lcm-logger to write")
        stage.run(dse("dse-plant"), "ahg-43", *LENGTH, env=env).with_code(0)
        for node in nodes:
            node.wait().with_code(0)
        assert {key: own_hash(ear.final(*key)) for key in answer} == {
            key: number for key, (number, _) in answer.items()
        }
    stage.end(logger)
    told = stage.run(tool("dse"), "info", log).with_code(0)
    assert "ahg-43_cstr2_continuous" in told.out


def test_dse_run_uses_the_url_of_the_environment(stage: Stage, url: str) -> None:
    """With a buffer for bursts, which its recorder needs, where the URL does not say one."""
    short = url.split("&recv_buf_size")[0]
    with listening(url) as ear:
        ended = stage.run(
            dse("dse-run"),
            "ahg-43",
            *LENGTH,
            "--no-log",
            env={"LCM_DEFAULT_URL": short},
        ).with_code(0)
        assert f"network {short}&recv_buf_size=" in ended.err
        ear.await_sample(SAMPLES - 1)


def test_a_second_agent_for_a_node_is_refused_before_the_run(
    stage: Stage, url: str, answer: Hashes
) -> None:
    with listening(url) as ear:
        both = [estimator(stage, url, 1, "--network", "ahg") for _ in range(2)]
        others = [
            estimator(stage, url, 0),
            estimator(stage, url, 1, "--network", "ekf"),
        ]
        left = next_to_end(both)
        stays = both[1 - both.index(left)]
        said = left.wait().with_code(1)
        assert (
            f"node 1 (reactor 2) of network ahg: already served by process {stays.pid}:"
            " one agent per node" in said.err
        )
        plant(stage, url).wait().with_code(0)
        for agent in [stays, *others]:
            agent.wait().with_code(0)
        assert {key: own_hash(ear.final(*key)) for key in answer} == {
            key: number for key, (number, _) in answer.items()
        }


def test_a_second_agent_for_a_node_is_refused_during_the_run(
    stage: Stage, url: str, answer: Hashes
) -> None:
    conductor = Conductor(url, run_id=77)
    with listening(url) as ear:
        conductor.start()
        conductor.let_run_until(100)
        agents = [estimator(stage, url, 0), estimator(stage, url, 1)]
        agents.append(plant(stage, url, "--run-id", 77, "--recorder-lag", 1))
        ear.await_sample(100)
        said = estimator(stage, url, 1).wait().with_code(1)
        assert f"already served by process {agents[1].pid}: one agent per node" in said.err
        conductor.let_run_until(2 * SAMPLES)
        for agent in agents:
            agent.wait().with_code(0)
        assert {key: own_hash(ear.final(*key)) for key in answer} == {
            key: number for key, (number, _) in answer.items()
        }
    conductor.close()


@pytest.mark.parametrize(
    "other",
    [("ahg-43", *LENGTH, "--set", "seed=2"), ("ahg-45", *LENGTH)],
    ids=["another seed", "another scenario"],
)
def test_an_estimator_of_another_scenario_does_no_harm(
    other: tuple[str, ...], stage: Stage, url: str, answer: Hashes
) -> None:
    """It is not part of this run: it keeps waiting for its own, and the run does not notice."""
    with listening(url) as ear:
        stray = stage.start(dse("dse-estimator"), *other, "--lcm-url", url, "--node", 1)
        ear.await_any_from(stray)
        agents = [estimator(stage, url, 0), estimator(stage, url, 1), plant(stage, url)]
        for agent in agents:
            agent.wait().with_code(0)
        assert stray.running
        mine = {agent.pid for agent in agents}
        for key, (number, _) in answer.items():
            finals = [
                status
                for status in ear.of(*key)
                if status.state == lcmtypes.status_t.STATE_FINISHED
            ]
            assert {own_hash(status) for status in finals if status.pid in mine} == {number}
        stage.end(stray)


def test_an_estimator_told_to_join_a_run_of_another_scenario_says_so(
    stage: Stage, url: str
) -> None:
    with listening(url) as ear:
        plant(stage, url, "--run-id", 5)
        odd = estimator(stage, url, 0, "--set", "seed=2", "--run-id", 5)
        said = odd.wait().with_code(1)
        assert "the plant of this run reads another scenario than" in said.err
        assert any("another scenario" in text_of(status) for status in ear.statuses)


def test_a_plant_that_waits_in_vain_names_the_node_and_how_to_start_it(
    stage: Stage, url: str
) -> None:
    with listening(url) as ear:
        estimator(stage, url, 0)
        ear.await_state(lcmtypes.status_t.STATE_JOINING, [(0, 0), (1, 0)])
        said = plant(stage, url, "--wait", 3).wait().with_code(1)
        assert "node 1 of network ahg (and others) did not join within 3 s" in said.err
        command = said.err.partition("start it with: ")[2].split()
        assert command[0] == "dse-estimator"
        assert command[-2:] == ["--node", "1"]
        assert Path(command[1]).exists()


def next_to_end(agents: list[Agent]) -> Agent:
    """The first of them that ends."""
    return eventually(lambda: [one for one in agents if not one.running], "one of two to leave")[0]
