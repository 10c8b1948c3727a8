"""Nodes of a network together: agreement of their estimates, and what their talk costs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import Command
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from synthetic import Plan, write

from dse.agreement import agreement, same_states
from dse.agreement_plots import figure
from dse.communication import communication, frame_bytes
from dse.errors import UserError
from dse.log import read
from dse.metrics import disagreement
from dse.plots import colours, legend
from dse.run import Network, Run
from dse.tradeoff import Metric, measure


def together(run: Run) -> Network:
    """The first network as if both of its nodes estimated the states 0 and 1."""
    network = run.networks[0]
    for node in network.nodes:
        node.states = [0, 1]
    return network


def test_nodes_with_different_states_have_no_agreement(plain: Path) -> None:
    run = read(plain)
    assert agreement(run, run.networks[0]) is None
    with pytest.raises(UserError, match="estimate the same states"):
        measure(run, [Metric.parse("ID")], {})


def test_sixteen_networks_have_sixteen_colours(plain: Path) -> None:
    run = read(plain)
    run.networks = [replace(run.networks[0], name=f"network {i}") for i in range(16)]
    assert len(set(colours(run).values())) == 16


def test_agreement_is_over_the_samples_that_all_nodes_have(tmp_path: Path) -> None:
    skipped = {(0, 1, 7), (0, 0, 9)}
    run = read(write(tmp_path / "some.lcm", Plan(skip=skipped)))
    network = together(run)
    found, shape = agreement(run, network), same_states(run, network)
    assert found is not None
    assert shape is not None
    assert (found.nodes, found.samples) == (2, Plan().samples - 2)
    assert shape[2].shape == (2, Plan().samples - 2, 2)


def test_agreement_is_that_of_the_logged_estimates(plain: Path) -> None:
    run = read(plain)
    network = together(run)
    a, b = (node.estimates.value for node in network.nodes)
    true, time = run.truth.value[:, :2], run.truth.time
    found = agreement(run, network)
    assert found is not None
    power = ((a - true) ** 2 + (b - true) ** 2).sum(axis=1)
    assert found.l2_norm == pytest.approx(np.sqrt(np.trapezoid(power, time)))
    assert found.error_integral == pytest.approx(np.trapezoid(np.sqrt(power) / 2, time))
    # Two nodes: each is half of the difference away from the mean.
    apart = np.sqrt(((a - b) ** 2).sum(axis=1) / 2)
    assert found.disagreement_integral == pytest.approx(np.trapezoid(apart, time))
    assert found.final_disagreement == pytest.approx(apart[-1])
    assert found.late_disagreement == pytest.approx(apart[120:].mean())
    names = ("IE", "ID", "L2", "steady")
    for one in run.networks:
        for node in one.nodes:
            node.states = [0, 1]
    assert measure(run, [Metric.parse(name) for name in names], {})[network.name] == [
        *(found.error_integral, found.disagreement_integral, found.l2_norm, found.late_error)
    ]


def test_an_infinite_estimate_has_no_agreement_in_numbers(plain: Path) -> None:
    run = read(plain)
    network = together(run)
    network.nodes[1].estimates.value[3, 0] = np.inf
    found = agreement(run, network)
    assert found is not None
    assert np.isnan([found.l2_norm, found.error_integral, found.disagreement_integral]).all()


def test_458_frames_with_one_or_two_values_have_the_published_size() -> None:
    """5038 and 6870 bytes per exchange, 36 % more: section 5.1 of the source."""
    assert 458 * frame_bytes(1) == 5038
    assert 458 * frame_bytes(2) == 6870
    assert [frame_bytes(n) for n in (1, 2, 4, 6)] == [11, 15, 23, 31]


def test_measured_communication_is_what_the_nodes_counted(plain: Path) -> None:
    run = read(plain)
    network = run.networks[0]
    found = communication(network)
    assert (found.links, found.frames, found.frame_bytes) == (2, None, None)
    assert found.messages == pytest.approx(2)
    assert found.payload_bytes == pytest.approx(32)
    for node in network.nodes:
        node.frames = [(1 - node.node, 2)]
    assert communication(network).frame_bytes == 2 * 15


def test_the_figure_draws_error_and_disagreement_of_each_network(plain: Path) -> None:
    run = read(plain)
    assert figure(run, run.networks, colours(run)) is None
    network = together(run)
    made = figure(run, run.networks, colours(run))
    assert made is not None
    wrong, apart = made.axes
    assert len(wrong.lines) == len(apart.lines) == 1
    found = same_states(run, network)
    assert found is not None
    np.testing.assert_allclose(apart.lines[0].get_ydata(), disagreement(found[1]))


def test_the_report_has_the_tables(plain: Path, tmp_path: Path, dse: Command) -> None:
    outcome = dse("report", plain, "-o", tmp_path)
    assert "Communication per sample" in outcome.out
    assert "Nodes together" not in outcome.out
    numbers = dse("report", plain, "--json").json["networks"]["ahg"]
    assert numbers["agreement"] is None
    assert numbers["communication"]["messages"] == pytest.approx(2)


@pytest.mark.parametrize(("count", "length"), [(2, 5), (8, 14), (9, 40), (7, 60)])
def test_no_entry_of_a_legend_is_cut_off(count: int, length: int) -> None:
    made = Figure(figsize=(9.5, 3.4))
    legend(made, [Line2D([], [], label=f"{i} {'m' * length}") for i in range(count)])
    (shown,) = made.legends
    assert len(shown.get_texts()) == count
    assert shown.get_window_extent().width < made.bbox.width
    assert shown.get_window_extent().height < made.bbox.height / 2


def test_a_legend_that_fits_takes_one_row() -> None:
    made = Figure(figsize=(9.5, 3.4))
    legend(made, [Line2D([], [], label=name) for name in ("edge", "node", "none")])
    assert made.get_figheight() == pytest.approx(3.4)
