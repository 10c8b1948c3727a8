"""Consensus Kalman filters and second-order filters: every way of running gives the same bits."""

from pathlib import Path

import pytest
from harness import Stage, dse, hashes, inproc, only

from dse.log import read


@pytest.mark.parametrize(
    ("scenario", "names", "samples"),
    [
        ("cno-e4_loss", ("B_information", "C", "none"), 60),
        ("cno-e4_dead_sensor", ("B_information", "C_information", "B"), 30),
        ("cno-e4_ring6", ("A_information", "central"), 30),
        ("cno-e4_pair", ("A_average", "A_persistent", "unscented"), 30),
        ("cno-linear_heterogeneous", ("A", "C"), 40),
        ("cno-pod_forced", ("B_information", "extended", "central"), 12),
    ],
)
def test_processes_one_process_and_a_replay_give_the_same_bits(
    scenario: str,
    names: tuple[str, ...],
    samples: int,
    stage: Stage,
    url: str,
    tmp_path: Path,
) -> None:
    file = only(scenario, names, samples, tmp_path)
    log, alone = tmp_path / "processes.lcm", tmp_path / "inproc.lcm"
    stage.run(dse("dse-run"), file, "--lcm-url", url, "--log", log, "--quiet").with_code(0)
    inproc(stage, alone, scenario=str(file))
    found = hashes(log)
    assert found == hashes(alone)
    assert {count for _, count in found.values()} == {samples}
    assert len({number for number, _ in found.values()}) == len(found), "nodes must differ"
    stage.run(dse("dse-run"), "--replay", log, "--quiet").with_code(0)


def test_losses_of_networks_with_the_same_link_are_the_same(stage: Stage, tmp_path: Path) -> None:
    """One fate per sample and direction, whatever is said: B says one message, B-I-inf two."""
    file = only("cno-e4_loss", ("B_information", "B"), 60, tmp_path)
    run = read(inproc(stage, tmp_path / "run.lcm", scenario=str(file)))
    silent = {}
    for network in run.networks:
        node = network.nodes[0]
        place = [signal.name for signal in node.diagnostics].index("messages not heard")
        silent[network.name] = node.estimates.diagnostic[:, place]
    assert 15 < silent["B"][-1] < 45
    assert (silent["B_information"] == 2 * silent["B"]).all()
