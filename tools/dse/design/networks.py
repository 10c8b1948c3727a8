"""Networks of nodes: generators, the form in which scenarios state them, and what they are like."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np

from dse.design.algebra import Floats
from dse.errors import UserError

ATTEMPTS = 1000
"""Draws of a random network until it is connected."""


@dataclass(frozen=True)
class Network:
    """`graph:` of a scenario: node `to` hears node `from`."""

    nodes: int
    edges: list[tuple[int, int]]
    """(from, to); when undirected each link once."""
    undirected: bool

    def digraph(self) -> nx.DiGraph:
        """Who is heard by whom."""
        made = nx.DiGraph()
        made.add_nodes_from(range(self.nodes))
        made.add_edges_from(self.edges)
        if self.undirected:
            made.add_edges_from((b, a) for a, b in self.edges)
        return made

    def laplacian(self) -> Floats:
        """In-degree Laplacian D - A, row i of node i: A_ij = 1 when i hears j."""
        heard = np.zeros((self.nodes, self.nodes))
        for a, b in self.digraph().edges:
            heard[b, a] = 1
        return np.asarray(np.diag(heard.sum(axis=1)) - heard, dtype=float)

    def spectrum(self) -> list[complex]:
        """Eigenvalues of the Laplacian, by real part."""
        L = self.laplacian()
        values = np.linalg.eigvalsh(L) if self.undirected else np.linalg.eigvals(L)
        return sorted((complex(v) for v in values), key=lambda v: (round(v.real, 9), v.imag))

    def in_degrees(self) -> list[int]:
        """How many nodes each node hears."""
        return [int(d) for _, d in self.digraph().in_degree()]

    def strongly_connected(self) -> bool:
        """From every node to every node."""
        return bool(nx.is_strongly_connected(self.digraph()))

    def weakly_connected(self) -> bool:
        """Connected when directions do not count."""
        return bool(nx.is_weakly_connected(self.digraph()))

    def roots(self) -> list[int]:
        """Nodes from which all others are reached: roots of a spanning tree."""
        graph = self.digraph()
        parts = nx.condensation(graph)
        sources = [part for part, degree in parts.in_degree() if degree == 0]
        return sorted(parts.nodes[sources[0]]["members"]) if len(sources) == 1 else []

    def balanced(self) -> bool:
        """Every node is heard by as many as it hears."""
        graph = self.digraph()
        return all(graph.in_degree(i) == graph.out_degree(i) for i in range(self.nodes))

    def diameter(self) -> int | None:
        """Longest of the shortest ways; None where there is no way."""
        return int(nx.diameter(self.digraph())) if self.strongly_connected() else None


def from_undirected(graph: nx.Graph) -> Network:
    """Each link once, from the smaller node."""
    links = sorted((min(a, b), max(a, b)) for a, b in graph.edges)
    return Network(graph.number_of_nodes(), links, True)


def ring(n: int, directed: bool = False) -> Network:
    """Each node with the one behind it."""
    if n < 3:
        raise UserError(f"a ring of {n} nodes: needs at least 3")
    if directed:
        return Network(n, [(i, (i + 1) % n) for i in range(n)], False)
    return from_undirected(nx.cycle_graph(n))


def ladder(n: int) -> Network:
    """Two lines of n / 2 nodes, each node linked with the one beside it."""
    if n < 4 or n % 2:
        raise UserError(f"a ladder of {n} nodes: needs an even number, at least 4")
    return from_undirected(nx.ladder_graph(n // 2))


def moebius_ladder(n: int) -> Network:
    """A ring with a link between opposite nodes."""
    if n < 4 or n % 2:
        raise UserError(f"a Moebius ladder of {n} nodes: needs an even number, at least 4")
    graph = nx.cycle_graph(n)
    graph.add_edges_from((i, i + n // 2) for i in range(n // 2))
    return from_undirected(graph)


def complete(n: int) -> Network:
    """Everybody hears everybody."""
    return from_undirected(nx.complete_graph(n))


def small_world(n: int, neighbours: int, rewired: float, seed: int) -> Network:
    """Watts and Strogatz: a ring with links to the nearest, some of them put elsewhere."""
    try:
        graph = nx.connected_watts_strogatz_graph(n, neighbours, rewired, ATTEMPTS, seed)
    except nx.NetworkXError as error:
        raise UserError(f"no small world of {n} nodes: {error}") from None
    return from_undirected(graph)


def geometric(n: int, links: int | None, radius: float | None, seed: int) -> Network:
    """Points at random in the unit square, linked when near; drawn anew until connected.

    Near: the `links` shortest pairs, or closer than `radius`.
    """
    generator = np.random.default_rng(seed)
    first, second = np.triu_indices(n, 1)
    if links is not None and not n - 1 <= links <= len(first):
        raise UserError(f"{links} links: {n} nodes need {n - 1} to {len(first)}")
    for _ in range(ATTEMPTS):
        points = generator.random((n, 2))
        distance = np.hypot(*(points[first] - points[second]).T)
        near = np.argsort(distance, kind="stable")[:links]
        if links is None:
            near = near[distance[near] <= (radius or 0)]
        graph = nx.Graph()
        graph.add_nodes_from(range(n))
        graph.add_edges_from((int(first[k]), int(second[k])) for k in near)
        if nx.is_connected(graph):
            return from_undirected(graph)
    raise UserError(f"no connected network in {ATTEMPTS} draws: give more links or a larger radius")


def load(path: Path) -> dict[str, Network]:
    """The graph of a file, or those of a scenario's networks by their names."""
    import yaml

    try:
        text: Any = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise UserError(f"{path}: {' '.join(str(error).split())}") from None
    if not isinstance(text, dict):
        raise UserError(f"{path}: neither a graph nor a scenario")
    entries = text.get("networks") or []
    found = {str(one.get("name")): one["graph"] for one in entries if "graph" in one}
    if "graph" in text:
        found = {path.stem: text["graph"]}
    if not found:
        raise UserError(f"{path}: has no graph: {{nodes, edges, undirected}}")
    return {name: _network(path, graph) for name, graph in found.items()}


def _network(path: Path, graph: Any) -> Network:  # noqa: ANN401 - a user's file
    try:
        flat = [int(one) for one in graph["edges"]]
        nodes = int(graph["nodes"])
    except (TypeError, KeyError, ValueError):
        raise UserError(f"{path}: graph: must have nodes: N and edges: [from, to, ..]") from None
    if len(flat) % 2 or any(not 0 <= one < nodes for one in flat):
        raise UserError(f"{path}: graph: edges are pairs of nodes 0 to {nodes - 1}")
    pairs = list(zip(flat[::2], flat[1::2], strict=True))
    return Network(nodes, pairs, bool(graph.get("undirected", False)))


def text(network: Network, head: str) -> str:
    """The YAML section, eight links to a line."""
    pairs = [f"{a}, {b}" for a, b in network.edges]
    lines = [", ".join(pairs[k : k + 8]) for k in range(0, len(pairs), 8)]
    edges = ",\n          ".join(lines)
    undirected = "true" if network.undirected else "false"
    return (
        f"# {head}\ngraph:\n  nodes: {network.nodes}\n  undirected: {undirected}\n"
        f"  edges: [{edges}]\n"
    )
