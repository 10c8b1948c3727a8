"""A network's trouble, recorded from one run and replayed by another."""

from pathlib import Path

import pytest
from harness import BIN, Stage, dse, hashes, inproc, listening, tool

SCENARIO = "ahg-49"
OUTAGE = "networks.random.link.outages=[{from: 0, to: 1, start_s: 150, end_s: 260}]"


def text_of(log: Path, stage: Stage, network: str, file: Path) -> str:
    """What `dse network record` writes."""
    library = BIN.parent / "lib" / "libdse_plants.so"
    command = (tool("dse"), "network", "record", log, "--network", network)
    stage.run(*command, "--library", library, "-o", file).with_code(0)
    return file.read_text()


def test_a_recorded_network_gives_the_same_estimates(stage: Stage, tmp_path: Path) -> None:
    """Delays, losses and an outage, first from the seed, then from the file."""
    log = inproc(stage, tmp_path / "random.lcm", "--set", OUTAGE, scenario=SCENARIO)
    written = text_of(log, stage, "random", tmp_path / "mine.csv")
    replaced = f"networks.random.link={{D: 3, file: {tmp_path / 'mine.csv'}}}"
    again = inproc(stage, tmp_path / "again.lcm", "--set", replaced, scenario=SCENARIO)
    plain = inproc(stage, tmp_path / "plain.lcm", scenario=SCENARIO)
    for node in (0, 1):
        assert hashes(again)[0, node] == hashes(log)[0, node]
    assert hashes(plain)[0, 1] != hashes(log)[0, 1], "the outage must have an effect"
    # and what was replayed is recorded as it was
    rows = [line for line in written.splitlines() if not line.startswith("#")]
    repeated = text_of(again, stage, "random", tmp_path / "twice.csv")
    assert rows == [line for line in repeated.splitlines() if not line.startswith("#")]


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """The scenario with its recorded network, in a folder of its own."""
    source = Path(__file__).resolve().parents[2] / "sim" / "scenarios"
    for name in ("ahg-49_cstr2_ages.yaml", "ahg-49_network.csv"):
        (tmp_path / name).write_text((source / name).read_text())
    return tmp_path / "ahg-49_cstr2_ages.yaml"


def test_a_replay_needs_no_file_beside_the_log(stage: Stage, copied: Path) -> None:
    log = inproc(stage, copied.with_name("run.lcm"), scenario=str(copied))
    copied.with_name("ahg-49_network.csv").unlink()
    copied.unlink()
    replayed = stage.run(dse("dse-run"), "--replay", log)
    replayed.with_code(0)
    assert replayed.out.count("720 estimates equal the recorded ones bit for bit") == 4


def test_a_changed_file_is_another_experiment(stage: Stage, copied: Path, url: str) -> None:
    """A plant and an estimator that have read different files do not run together."""
    table = copied.with_name("ahg-49_network.csv")
    text = table.read_text()
    assert "0,1,1,2\n" in text
    run = ("--run-id", 5, "--lcm-url", url)
    with listening(url) as ear:
        plant = stage.start(dse("dse-plant"), copied, *run)
        ear.await_any_from(plant)
        table.write_text(text.replace("0,1,1,2\n", "0,1,1,1\n"))
        told = stage.run(dse("dse-estimator"), copied, "--node", 0, *run).with_code(1)
    assert "the plant of this run reads another scenario than" in told.err
