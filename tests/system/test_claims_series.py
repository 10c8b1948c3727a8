"""AHG-70: in a series a filter that predicts and hears only the tanks upstream loses nothing."""

from pathlib import Path

import pytest
from harness import Stage, dse, hashes, inproc

from dse.log import read

SCENARIO = "ahg-70"
LENGTH = ("--set", "time.duration_s=400")
NETWORKS = ("all", "upstream")


def both(key: str, value: str) -> list[str]:
    """Options that change a key of both networks."""
    return [word for name in NETWORKS for word in ("--set", f"networks.{name}.{key}={value}")]


VARIANTS = {
    "as it is": [],
    "mapped": both("high_gain_ekf.coordinates", "mapped"),
    "physical, full": [
        *both("high_gain_ekf.coordinates", "physical"),
        *both("high_gain_ekf.scaling", "full"),
    ],
    "held": both("high_gain_ekf.communication.predictor", "false"),
    "stages": both("high_gain_ekf.communication", "{kind: stages}"),
    "triggered": both(
        "high_gain_ekf.communication", "{kind: triggered, every: 5, trigger: {L: 0.5}}"
    ),
    "late and lost": both("link", "{D: 3, T_m: 2, loss: 0.4}"),
    "wrong predictor": both("high_gain_ekf.predictor_parameters", "[{name: F02, value: 12}]"),
}


@pytest.mark.parametrize("changes", VARIANTS.values(), ids=VARIANTS.keys())
def test_the_smaller_predictor_estimates_the_same(
    changes: list[str], stage: Stage, tmp_path: Path
) -> None:
    found = hashes(inproc(stage, tmp_path / "log.lcm", *LENGTH, *changes, scenario=SCENARIO))
    assert {count for _, count in found.values()} == {400}
    for node in range(4):
        assert found[0, node] == found[1, node]
    assert len({number for number, _ in found.values()}) == 4


def test_it_needs_half_the_links_and_less_memory(stage: Stage, tmp_path: Path) -> None:
    run = read(
        inproc(
            stage,
            tmp_path / "log.lcm",
            "--set",
            "time.duration_s=40",
            scenario=SCENARIO,
        )
    )
    links = [sum(len(node.neighbours) for node in network.nodes) for network in run.networks]
    assert links == [12, 6]
    everything, upstream = (
        [node.storage_bytes or 0 for node in network.nodes] for network in run.networks
    )
    assert upstream[0] < 0.6 * everything[0]
    assert sum(upstream) < 0.85 * sum(everything)


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        (
            "plant.parameters.Fr2=5",
            "subsystem 3 acts on subsystem 0: node 0 has to hear it",
        ),
        (
            "networks.upstream.graph.edges=[0, 1, 1, 2, 2, 3]",
            "node 2 predicts node 1, which hears node 0: it has to hear that, too",
        ),
        (
            "networks.upstream.graph={nodes: 3, edges: []}",
            "has 3 nodes; the plant has 4",
        ),
        (
            "networks.upstream.high_gain_ekf.innovation=sum",
            "all 4 nodes need to hear each other",
        ),
        (
            "networks.upstream.high_gain_ekf.framework=centralised",
            "filter talks to nobody",
        ),
    ],
)
def test_a_graph_that_leaves_somebody_out_is_refused(
    change: str, wanted: str, stage: Stage
) -> None:
    said = stage.run(dse("dse-run"), SCENARIO, "--inproc", "--no-log", "--set", change).failed()
    assert "networks.upstream.graph: " in said.err
    assert wanted in said.err
