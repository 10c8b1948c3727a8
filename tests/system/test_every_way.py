"""Every way, one answer: however a scenario is run, its estimates have the same bits."""

import struct
from pathlib import Path

import pytest
from harness import NODES_OF_AHG_43, Stage, dse, hashes, inproc, listening, own_hash, tool

from dse import lcmtypes
from dse.events import read as read_events
from dse.log import read, runs

SAMPLES = 5000
LENGTH = ("--set", f"time.duration_s={SAMPLES}")
Hashes = dict[tuple[int, int], tuple[int, int]]


@pytest.fixture(scope="module")
def in_one_process(shared: Stage) -> Path:
    """Log of a run with everything in one process."""
    return inproc(shared, shared.folder / "inproc.lcm", *LENGTH)


@pytest.fixture(scope="module")
def as_processes(shared: Stage) -> Path:
    """Log of a run with one process per agent."""
    log = shared.folder / "processes.lcm"
    ended = shared.run(dse("dse-run"), "ahg-43", "--log", log, *LENGTH)
    ended.with_code(0)
    return log


@pytest.fixture(scope="module")
def answer(in_one_process: Path) -> Hashes:
    """What all ways must give."""
    found = hashes(in_one_process)
    assert found.keys() == NODES_OF_AHG_43
    assert {count for _, count in found.values()} == {SAMPLES}
    assert len({number for number, _ in found.values()}) == len(found), "nodes must differ"
    return found


def test_processes_estimate_the_same_bits_as_one_process(
    as_processes: Path, answer: Hashes
) -> None:
    assert hashes(as_processes) == answer


def test_the_nodes_publish_the_hash_of_what_stands_in_the_log(
    as_processes: Path, answer: Hashes
) -> None:
    for network, node in read(as_processes).nodes:
        assert node.estimate_hash == answer[network.index, node.node][0]


@pytest.mark.parametrize("way", ["as_processes", "in_one_process"])
def test_replay_of_a_log_estimates_the_recorded_bits(
    way: str, request: pytest.FixtureRequest, stage: Stage, answer: Hashes, tmp_path: Path
) -> None:
    again = tmp_path / "again.lcm"
    ended = stage.run(
        dse("dse-run"), "--replay", request.getfixturevalue(way), "--log", again, "--quiet"
    )
    ended.with_code(0)
    assert ended.out.count(f"all {SAMPLES} estimates equal the recorded ones bit for bit") == 4
    assert hashes(again) == answer


def test_a_log_without_the_recorded_bits_is_noticed(
    in_one_process: Path, stage: Stage, tmp_path: Path
) -> None:
    """The comparison of a replay can fail: with one bit of one estimate turned."""
    content = bytearray(in_one_process.read_bytes())
    at = content.find(b"DSE_ESTIMATE_1_0", len(content) // 2)
    encoded = lcmtypes.estimate_t.decode(bytes(content[at + 16 : at + 16 + 8 + 711])[:719])
    assert encoded.header.network == 1
    first_state = content.find(_double(encoded.state[0]), at)
    content[first_state + 7] ^= 1
    changed = tmp_path / "changed.lcm"
    changed.write_bytes(content)
    ended = stage.run(dse("dse-run"), "--replay", changed, "--quiet")
    ended.with_code(1)
    assert f"ekf node 0: 1 of {SAMPLES} estimates differ from the record" in ended.out
    assert f"first at sample {encoded.header.sample}" in ended.out
    assert "the replay differs from the record" in ended.err


def _double(value: float) -> bytes:
    return struct.pack(">d", value)


def test_estimators_fed_by_logplayer_estimate_the_recorded_bits(
    as_processes: Path, stage: Stage, url: str, answer: Hashes, tmp_path: Path
) -> None:
    """Played slower until no gap is reported: then, and only then, the bits must be equal."""
    speed = 1.0
    for attempt in range(6):
        log = tmp_path / f"played-{attempt}.lcm"
        with listening(url) as ear:
            run = stage.start(
                dse("dse-run"), "ahg-43", *LENGTH, "--pace", "replay",
                "--lcm-url", url, "--log", log, "--quiet",
            )  # fmt: skip
            ear.await_state(lcmtypes.status_t.STATE_JOINING, NODES_OF_AHG_43)
            player = stage.run(
                tool("lcm-logplayer"), f"--lcm-url={url}", f"--speed={speed}", as_processes
            )
            player.with_code(0)
            ended = run.wait()
            ended.with_code(0)
            final = {key: ear.final(*key) for key in NODES_OF_AHG_43}
        gaps = sum(status.gaps for status in final.values())
        assert ("play it slower" in ended.err) == (gaps > 0)
        if gaps == 0:
            break
        speed /= 2
    assert gaps == 0, f"messages were lost even at speed {speed}"
    assert {key: own_hash(status) for key, status in final.items()} == {
        key: number for key, (number, _) in answer.items()
    }
    estimates = runs(read_events(log))
    assert len(estimates) == 2, "the replay has a run id of its own"


def test_nodes_that_share_a_process_estimate_the_same_bits(
    stage: Stage, url: str, answer: Hashes
) -> None:
    with listening(url) as ear:
        nodes = stage.start(
            dse("dse-estimator"), "ahg-43", *LENGTH, "--node", "0..1", "--lcm-url", url
        )
        plant = stage.run(dse("dse-plant"), "ahg-43", *LENGTH, "--lcm-url", url)
        plant.with_code(0)
        nodes.wait().with_code(0)
        for key, (number, _) in answer.items():
            assert own_hash(ear.final(*key)) == number
