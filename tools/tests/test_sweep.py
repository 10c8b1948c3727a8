"""dse sweep: metrics of trade-offs, on logs whose errors are known."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from conftest import Command
from synthetic import Plan, estimate, truth
from test_design_tune import FAKE

from dse.errors import UserError
from dse.log import read
from dse.run import Floats
from dse.tradeoff import KINDS, PER_STATE, Metric, first_within, measure, short


@pytest.fixture
def fake(tmp_path: Path) -> Path:
    """A dse-run that writes a made-up log."""
    path = tmp_path / "bin" / "dse-run"
    path.parent.mkdir()
    path.write_text(FAKE)
    path.chmod(0o755)
    return path


def error() -> Floats:
    """Of the first network in the log `plain`."""
    return estimate(Plan(), 0) - truth(Plan())


def of(log: Path, *texts: str, **weights: float) -> list[float]:
    """Metrics of the first network."""
    metrics = [Metric.parse(text) for text in texts]
    return measure(read(log), metrics, weights)["ahg"]


def test_metrics_of_a_state_are_those_of_the_known_error(plain: Path) -> None:
    C1 = error()[:, 1]
    rmse, late, largest = of(plain, "rmse:C1", "late:C1", "max:C1")
    assert rmse == pytest.approx(np.sqrt(np.mean(C1**2)))
    assert late == pytest.approx(np.sqrt(np.mean(C1[120:] ** 2)))
    assert largest == pytest.approx(np.abs(C1).max())


def test_index_weighs_by_the_first_pattern_that_fits(plain: Path) -> None:
    weighted = np.sum(error() ** 2 @ [1, 200, 1, 200])
    assert of(plain, "U", **{"C*": 200.0}) == pytest.approx([weighted])
    assert of(plain, "U:C2", **{"C2": 7.0, "C*": 200.0}) == pytest.approx(
        [7 * np.sum(error()[:, 3] ** 2)]
    )
    assert of(plain, "U") == pytest.approx([np.sum(error() ** 2)])


def test_index_counts_exchange_instants_only(plain: Path) -> None:
    run = read(plain)
    run.info["scenario"]["yaml"] = (
        "networks: [{name: ahg, high_gain_ekf: {communication: {every: 18}}}, {name: ekf}]"
    )
    found = measure(run, [Metric.parse("U")], {})
    assert found["ahg"] == pytest.approx([np.sum(error()[::18] ** 2)])
    assert found["ekf"][0] > np.sum((estimate(Plan(), 1) - truth(Plan()))[::18] ** 2)


def test_first_is_when_the_error_first_comes_below_the_band() -> None:
    time, e = np.array([1.0, 2.0, 3.0, 4.0]), np.array([-9.0, -2.0, 1.0, 5.0])
    assert first_within(time, e, 2.5) == 1.0
    assert first_within(time, e, 2.0) == 2.0  # below, not at
    assert math.isinf(first_within(time, e, 1.0))


def test_every_metric_of_a_state_can_be_taken(plain: Path) -> None:
    texts = [f"{kind}:T2" + ("=3" if kind == "first" else "") for kind in PER_STATE]
    texts += [kind for kind in PER_STATE if kind != "first"]
    values = of(plain, *texts)
    assert len(values) == len(texts)
    assert all(value >= 0 for value in values)


def test_keys_are_short_where_that_is_clear() -> None:
    assert short(["networks.a.trigger.L", "plant.Fr"]) == ["L", "Fr"]
    assert short(["a.d", "b.d"]) == ["a.d", "b.d"]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("rsme", "rsme"),
        ("sent:T1", "is of a network"),
        ("first:T1", "a band belongs to first"),
        ("first", "a band belongs to first"),
        ("rmse:T1=2", "a band belongs to first"),
        ("first:T1=cold", "'cold' is not a number"),
    ],
)
def test_wrong_metrics_are_refused(text: str, told: str) -> None:
    with pytest.raises(UserError, match=told):
        Metric.parse(text)


def test_what_a_network_does_not_tell_is_said(plain: Path) -> None:
    with pytest.raises(UserError, match="does not tell 'states sent'"):
        of(plain, "sent")


def test_command_writes_table_figure_and_numbers(dse: Command, fake: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    key = "networks[ahg].high_gain_ekf.R"
    words = ("--vary", f"{key}=1,2,4", "--seeds", 2, "--bin", fake, "-o", folder)
    done = dse("sweep", "two-reactors", *words, "--metric", "late:T1", "--metric", "rmse")
    assert done.code == 0, done.err
    assert "late T1 [K]" in done.out
    assert (folder / "sweep.png").read_bytes()[:4] == b"\x89PNG"
    with (folder / "sweep.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * 2 * 2  # values, seeds, networks
    late = [float(row["late T1 [K]"]) for row in rows if row["network"] == "ahg"]
    assert late[0] < late[2] < late[4]  # the noise grows with R


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ((), "give at least one --vary"),
        (("--vary", "R=1", "--metric", "U", "--weight", "C"), "--weight C: expected"),
        (("--vary", "R=1", "--late", "0"), "--late 0"),
        (("--vary", "R=1", "--seeds", "0"), "--seeds 0"),
        (("--vary", "R=1", "--network", "akf"), "akf"),
        (("--vary", "R=1", "--metric", "max:T9"), "T9"),
    ],
)
def test_mistakes_are_told_in_one_line(
    dse: Command, fake: Path, words: tuple[str, ...], told: str
) -> None:
    done = dse("sweep", "two-reactors", *words, "--bin", fake)
    assert done.code == 2
    assert told in done.err
    assert done.err.startswith("dse sweep: ")


def test_help_names_every_metric(dse: Command) -> None:
    text = " ".join(dse("sweep", "--help").out.split())
    assert all(f"{kind}: " in text for kind in KINDS)
