"""dse design graph: what is made, what is stored, what is said about it."""

import math
from pathlib import Path

import pytest
import yaml
from conftest import Command

from dse.design import networks
from dse.design.networks import Network
from dse.errors import UserError

STORED = Path(__file__).parents[2] / "sim" / "scenarios" / "graphs"


def stored(name: str) -> Network:
    (found,) = networks.load(STORED / f"{name}.yaml").values()
    return found


def test_stored_network_of_fifty_nodes_is_that_of_the_source() -> None:
    net = stored("aho-net50")
    assert (net.nodes, len(net.edges), net.undirected) == (50, 229, True)
    assert (min(net.in_degrees()), max(net.in_degrees())) == (2, 14)
    assert net.digraph().number_of_edges() == 458
    assert net.strongly_connected() and net.balanced()


# nodes, directed edges, strongly connected, nodes that hear nobody
STORED_GRAPHS = {
    "aho-ring6": (6, 12, True, 0),
    "aho-moebius6": (6, 18, True, 0),
    "aho-directed5": (5, 10, True, 0),
    "aho-uio6": (6, 6, False, 1),
    "aho-uio6-ring": (6, 6, True, 0),
    "aho-fo4": (4, 4, True, 0),
}


@pytest.mark.parametrize("name", STORED_GRAPHS)
def test_stored_graphs_are_those_of_the_source(name: str) -> None:
    net = stored(name)
    edges = net.digraph().number_of_edges()
    alone = net.in_degrees().count(0)
    assert (net.nodes, edges, net.strongly_connected(), alone) == STORED_GRAPHS[name]


# scenario and network -> the stored graph that it copies
COPIES = {
    ("aho-e1_net50", "edge"): "aho-net50",
    ("aho-e2_ring6", "edge"): "aho-ring6",
    ("aho-e3_ladder6", "edge"): "aho-moebius6",
    ("aho-e4_directed5", "edge"): "aho-directed5",
    ("aho-e5_unknown_input", "consistent"): "aho-uio6",
    ("aho-e6_functional", "consistent"): "aho-fo4",
}


@pytest.mark.parametrize(("scenario", "network"), COPIES)
def test_scenarios_have_the_stored_graphs(scenario: str, network: str) -> None:
    found = networks.load(STORED.parent / f"{scenario}.yaml")[network]
    assert set(found.digraph().edges) == set(stored(COPIES[scenario, network]).digraph().edges)


def test_every_stored_graph_is_tested() -> None:
    assert {path.stem for path in STORED.glob("*.yaml")} == {"aho-net50", *STORED_GRAPHS}


# kinds with a spectrum in closed form, 2 - 2 cos for a ring, N for a complete graph
SPECTRA = {
    "ring": (networks.ring(6), [0, 1, 1, 3, 3, 4]),
    "complete": (networks.complete(5), [0, 5, 5, 5, 5]),
    "ladder": (networks.ladder(4), [0, 2, 2, 4]),
    "moebius-ladder": (networks.moebius_ladder(6), [0, 3, 3, 3, 3, 6]),
}


@pytest.mark.parametrize("kind", SPECTRA)
def test_spectrum_is_that_of_the_closed_form(kind: str) -> None:
    made, expected = SPECTRA[kind]
    assert [value.real for value in made.spectrum()] == pytest.approx(expected, abs=1e-12)
    assert made.strongly_connected()


def test_spectrum_of_a_directed_ring_lies_on_a_circle_around_one() -> None:
    made = networks.ring(5, directed=True)
    assert made.in_degrees() == [1] * 5
    assert [abs(value - 1) for value in made.spectrum()] == pytest.approx([1] * 5)
    second = 1 - math.cos(2 * math.pi / 5)
    assert made.spectrum()[1].real == pytest.approx(second)
    assert made.diameter() == 4


def test_geometric_network_links_the_nearest_and_depends_on_the_seed_alone() -> None:
    made = networks.geometric(30, 90, None, seed=4)
    assert (len(made.edges), made.strongly_connected()) == (90, True)
    assert made.edges == networks.geometric(30, 90, None, seed=4).edges
    assert made.edges != networks.geometric(30, 90, None, seed=5).edges
    near = networks.geometric(30, None, 0.3, seed=4)
    far = networks.geometric(30, None, 0.5, seed=4)
    assert len(near.edges) < len(far.edges)


def test_small_world_has_the_links_of_a_ring_and_shorter_ways() -> None:
    ring, made = (networks.small_world(60, 4, rewired, seed=2) for rewired in (0.0, 0.3))
    assert len(ring.edges) == len(made.edges) == 120
    assert (ring.diameter(), made.strongly_connected()) == (15, True)
    assert (made.diameter() or 0) < 8


def test_roots_reach_everybody() -> None:
    tree = Network(4, [(0, 1), (1, 0), (1, 2), (2, 3)], False)
    assert tree.roots() == [0, 1]
    assert not tree.strongly_connected() and tree.weakly_connected() and not tree.balanced()
    assert Network(3, [(0, 1), (2, 1)], False).roots() == []
    assert not Network(3, [(0, 1)], False).weakly_connected()


def test_written_section_reads_back(dse: Command, tmp_path: Path) -> None:
    path = tmp_path / "graph.yaml"
    result = dse("design", "graph", "geometric", "-n", 12, "--links", 20, "--seed", 3, "-o", path)
    assert result.code == 0 and "algebraic connectivity" in result.out
    section = yaml.safe_load(path.read_text())["graph"]
    assert (section["nodes"], len(section["edges"]), section["undirected"]) == (12, 40, True)
    (back,) = networks.load(path).values()
    assert back == networks.geometric(12, 20, None, 3)
    assert "20" in dse("design", "graph", path).out


def test_graphs_of_a_scenario_are_described_by_network(dse: Command, tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_text("networks: [{name: one, graph: {nodes: 2, edges: [0, 1]}}, {name: two}]\n")
    out = dse("design", "graph", path).out
    assert "one: 2 nodes" in out and "two" not in out and "weakly" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["ring"], "say how many nodes"),
        (["ring", "-n", "2"], "needs at least 3"),
        (["ladder", "-n", "5"], "needs an even number"),
        (["geometric", "-n", "5"], "either --links or --radius"),
        (["geometric", "-n", "5", "--links", "3"], "5 nodes need 4 to 10"),
        (["geometric", "-n", "9", "--radius", "0.01"], "no connected network"),
        (["complete", "-n", "5", "--directed"], "only a ring goes one way"),
        (["rimg"], "did you mean ring"),
    ],
)
def test_wrong_wishes_are_explained(dse: Command, words: list[str], message: str) -> None:
    result = dse("design", "graph", *words)
    assert result.code == 2 and message in result.err


def test_file_without_a_graph_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    for text in ("a: 1", "graph: {nodes: 2}", "graph: {nodes: 2, edges: [0, 2]}", "[1]"):
        path.write_text(text)
        with pytest.raises(UserError, match="x.yaml"):
            networks.load(path)
