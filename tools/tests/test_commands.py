"""The command dse as a user meets it."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import synthetic
from conftest import Command
from PIL import Image
from scipy.io import loadmat
from synthetic import Plan, estimate, node_states, published_hash, truth, write

from dse import plots


@pytest.fixture
def rough_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures without layout, in a fraction of the time."""
    monkeypatch.setitem(plots.STYLE, "figure.constrained_layout.use", False)
    monkeypatch.setitem(plots.STYLE, "savefig.dpi", 50)


def members(value: Any, path: str = "") -> set[str]:  # noqa: ANN401 - JSON
    """Paths of all members, names of networks, nodes and states left out."""
    if isinstance(value, dict):
        return {path}.union(*(members(v, f"{path}.{k}") for k, v in value.items()))
    if isinstance(value, list):
        return {path}.union(*(members(v, f"{path}[]") for v in value))
    return {path}


def test_info_names_run_states_nodes_and_channels(plain: Path, dse: Command) -> None:
    outcome = dse("info", plain)
    assert outcome.code == 0
    assert outcome.err == ""
    for text in (
        *("0x1234567890abcde", "Two reactors, made up", "T1 [K], C1 [kmol/m3]", "200 of 200"),
        *("reactor 2", "high-gain-ekf", "DSE_ESTIMATE_1_1", "complete", "storage [bytes]"),
    ):
        assert text in outcome.out


def test_info_prints_the_scenario_as_it_was_read(plain: Path, dse: Command) -> None:
    assert dse("info", plain, "--yaml").out.startswith("name: synthetic\n# long text\n")


def test_json_metrics_are_those_of_the_known_errors(plain: Path, dse: Command) -> None:
    metrics = dse("report", plain, "--json").json
    plan = Plan()
    error = estimate(plan, 0) - truth(plan)
    for i, name in enumerate(("T1", "C1", "T2", "C2")):
        for got in (
            metrics["networks"]["ahg"]["states"][name],
            metrics["networks"]["ahg"]["nodes"][i // 2]["states"][name],
        ):
            assert got["rmse"] == pytest.approx(np.sqrt(np.mean(error[:, i] ** 2)), rel=1e-12)
            assert got["late_rmse"] == pytest.approx(
                np.sqrt(np.mean(error[120:, i] ** 2)), rel=1e-12
            )
            assert got["max_error"] == pytest.approx(np.abs(error[:, i]).max(), rel=1e-12)
            assert got["final_error"] == pytest.approx(error[-1, i], rel=1e-12)
            nees = np.mean(error[:, i] ** 2) / plan.noise**2
            assert got["nees"] == pytest.approx(nees, rel=1e-12)
    scaled = error / [10, 1, 10, 1]
    norm = np.sqrt(np.mean(scaled**2))
    assert metrics["networks"]["ahg"]["error_norm"]["rms"] == pytest.approx(norm, rel=1e-12)
    total = np.linalg.norm(error, axis=1).sum()
    assert metrics["networks"]["ahg"]["error_sum"] == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("worse", [0, 1])
def test_the_relative_norm_uses_the_largest_error_of_any_network(
    tmp_path: Path, dse: Command, monkeypatch: pytest.MonkeyPatch, worse: int
) -> None:
    rates = [6.0 if i == worse else 60.0 for i in range(2)]
    names = [(name, method, rates[i]) for i, (name, method, _) in enumerate(synthetic.NETWORKS)]
    monkeypatch.setattr(synthetic, "NETWORKS", names)
    metrics = dse("report", write(tmp_path / "worse.lcm", Plan()), "--json").json
    errors = np.array([estimate(Plan(), i) - truth(Plan()) for i in range(2)])
    largest = np.abs(errors).max(axis=(0, 1))
    for error, network in zip(errors, metrics["networks"].values(), strict=True):
        relative = np.sqrt(np.sum((error / largest) ** 2, axis=1))
        assert network["relative_norm"]["mean"] == pytest.approx(relative.mean(), rel=1e-12)
        assert network["relative_norm"]["max"] == pytest.approx(relative.max(), rel=1e-12)


def test_json_counts_messages_steps_health_and_status(plain: Path, dse: Command) -> None:
    node = dse("report", plain, "--json").json["networks"]["ekf"]["nodes"][1]
    assert (node["messages"], node["bytes"]) == (200, 3200)
    assert node["step_s"] == pytest.approx({"median": 4e-5, "p99": 7e-5, "max": 7e-5})
    assert node["rounds"] == {"median": 1, "p99": 1, "max": 1}
    assert node["health"]["initialising"] == 1 / 200
    assert node["health"]["coasting"] == 20 / 200
    assert node["health"]["tracking"] == 179 / 200
    assert node["status"]["duplicates"] == 3
    assert node["states"]["T2"]["nees"] is None
    assert node["exchange"]["told"] == 200


def test_every_json_key_is_documented_in_the_help(plain: Path, dse: Command) -> None:
    text = dse("report", "--help").out
    metrics = dse("report", plain, "--json").json
    names = {part for path in members(metrics) for part in path.replace("[]", "").split(".")}
    data = {*("ahg", "ekf", "T1", "C1", "T2", "C2", "theta", "J", "innovation", "")}
    health = set(metrics["networks"]["ahg"]["nodes"][0]["health"])
    status = set(metrics["networks"]["ahg"]["nodes"][0]["status"])
    undocumented = {n for n in names - data - health - status if n not in text}
    assert undocumented == set()


def test_missing_and_infinite_estimates_show_in_the_metrics(tmp_path: Path, dse: Command) -> None:
    skip = {(0, 0, k) for k in range(50, 60)}
    log = write(tmp_path / "skip.lcm", Plan(skip=skip, bias=float("inf")))
    metrics = dse("report", log, "--json").json
    ahg, ekf = (metrics["networks"][name]["nodes"][0] for name in ("ahg", "ekf"))
    assert (ahg["estimates"], ahg["missing"], ahg["nonfinite"]) == (190, 10, 140)
    assert (ekf["missing"], ekf["nonfinite"]) == (0, 150)
    assert ekf["states"]["T1"]["rmse"] is None
    assert ekf["states"]["T1"]["settling_time"] is None
    assert ekf["states"]["C1"]["rmse"] > 0


@pytest.mark.usefixtures("rough_pictures")
def test_without_truth_costs_are_still_reported(tmp_path: Path, dse: Command) -> None:
    log = write(tmp_path / "real.lcm", Plan(samples=50, truth=False))
    outcome = dse("report", log)
    assert outcome.code == 0
    assert "Cost and health" in outcome.out
    # By default the report stands beside the log.
    assert (tmp_path / "real_report" / "report.html").exists()
    assert (tmp_path / "real_report" / "state_T1.png").exists()
    metrics = dse("report", log, "--json").json
    node = metrics["networks"]["ahg"]["nodes"][0]
    assert node["states"]["T1"]["rmse"] is None
    assert node["messages"] == 50


def test_the_report_is_one_folder_with_all_its_pictures(
    plain: Path, tmp_path: Path, dse: Command
) -> None:
    folder = tmp_path / "report"
    outcome = dse("report", plain, "-o", folder)
    assert outcome.code == 0
    page = (folder / "report.html").read_text()
    pictures = {path.name for path in folder.glob("*.png")}
    assert pictures == {
        *("overview.png", "health.png"),
        *(f"state_{name}.png" for name in ("T1", "C1", "T2", "C2")),
        *(f"diagnostic_{name}.png" for name in ("theta", "J", "innovation")),
    }
    for name in pictures:
        assert f'src="{name}"' in page
        with Image.open(folder / name) as picture:
            assert picture.width > 1000
            # Something is drawn: not one colour only.
            assert len(picture.convert("RGB").getcolors(1 << 24) or []) > 50
    assert "http" not in page
    for text in ("Two reactors, made up", "seed 1", "kmol/m3", "reactor 2", "never"):
        assert text in page


@pytest.mark.usefixtures("rough_pictures")
def test_names_in_a_log_cannot_inject_html(
    tmp_path: Path, dse: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        synthetic, "STATES", (("<b>/../x", "K", "<script>", 1.0), *synthetic.STATES[1:])
    )
    log = write(tmp_path / "evil.lcm", Plan(samples=20))
    assert dse("report", log, "-o", tmp_path / "out").code == 0
    page = (tmp_path / "out" / "report.html").read_text()
    assert "<script>" not in page
    assert "<b>/" not in page
    assert len(list((tmp_path / "out").glob("state_*.png"))) == 4


@pytest.mark.usefixtures("rough_pictures")
@pytest.mark.parametrize("ending", ["png", "pdf", "svg"])
def test_plot_writes_the_picture_asked_for(
    plain: Path, tmp_path: Path, dse: Command, ending: str
) -> None:
    path = tmp_path / f"T1.{ending}"
    outcome = dse("plot", plain, "--state", "T1", "--network", "ahg", "-o", path)
    assert (outcome.code, outcome.out.strip()) == (0, str(path))
    assert path.stat().st_size > 5000


@pytest.mark.usefixtures("rough_pictures")
def test_plot_takes_several_states_or_a_diagnostic(
    plain: Path, tmp_path: Path, dse: Command
) -> None:
    both, theta = tmp_path / "both.png", tmp_path / "theta.png"
    assert dse("plot", plain, "--state", "T1", "--state", "C2", "-o", both).code == 0
    assert dse("plot", plain, "--diagnostic", "theta", "-o", theta).code == 0
    assert both.exists()
    assert theta.exists()


def test_csv_and_parquet_give_back_the_numbers(plain: Path, tmp_path: Path, dse: Command) -> None:
    assert dse("export", plain, "--format", "csv", "-o", tmp_path / "csv").code == 0
    assert dse("export", plain, "--format", "parquet", "-o", tmp_path / "parquet").code == 0
    plan = Plan()
    for read, ending in ((pd.read_csv, "csv"), (pd.read_parquet, "parquet")):
        x = read(tmp_path / ending / f"truth.{ending}")
        assert list(x.columns) == ["sample", "time", "T1", "C1", "T2", "C2"]
        np.testing.assert_array_equal(x[["T1", "C1", "T2", "C2"]], truth(plan))
        table = read(tmp_path / ending / f"estimate_ahg_1.{ending}")
        assert list(table.columns) == [
            *("sample", "time", "health", "T2", "C2", "variance_T2", "variance_C2"),
            *("theta", "J", "innovation"),
        ]
        np.testing.assert_array_equal(
            table[["T2", "C2"]], estimate(plan, 0)[:, node_states(plan, 1)]
        )
        assert (table[["variance_T2", "variance_C2"]] == plan.noise**2).all(axis=None)
        assert read(tmp_path / ending / f"measurement_reactor_2.{ending}")["T2"].isna().sum() == 20
        assert len(read(tmp_path / ending / f"done_ekf_0.{ending}")) == 200
        about = json.loads((tmp_path / ending / "run.json").read_text())
        assert about["states"][1]["unit"] == "kmol/m3"
        assert about["nodes"][3]["table"] == "estimate_ekf_1"


def test_mat_gives_back_the_numbers(plain: Path, tmp_path: Path, dse: Command) -> None:
    assert dse("export", plain, "--format", "mat", "-o", tmp_path).code == 0
    content = loadmat(tmp_path / "run.mat", squeeze_me=True)
    np.testing.assert_array_equal(content["truth"]["C1"].item(), truth(Plan())[:, 1])
    np.testing.assert_array_equal(content["estimate_ekf_0"]["T1"].item(), estimate(Plan(), 1)[:, 0])


def test_equal_estimates_compare_equal_whatever_the_run_id(
    plain: Path, tmp_path: Path, dse: Command
) -> None:
    again = write(tmp_path / "again.lcm", Plan(run_id=77))
    outcome = dse("compare", plain, again)
    assert (outcome.code, outcome.err) == (0, "")
    assert "DIFFERENT" not in outcome.out
    for network in range(2):
        for node in range(2):
            assert f"{published_hash(Plan(), network, node):016x}" in outcome.out


def test_a_log_without_all_that_a_node_published_is_found_by_the_nodes_own_hash(
    tmp_path: Path, dse: Command
) -> None:
    # Lost at the end, where the sequence numbers show no gap.
    log = write(tmp_path / "short.lcm", Plan(lose={(0, 0, 199)}))
    outcome = dse("compare", log, log)
    assert outcome.code == 0
    assert outcome.err.count("ahg/reactor 1 published estimates with hash") == 2
    assert "reactor 2" not in outcome.err


def test_the_smallest_difference_is_found_and_shown(
    plain: Path, tmp_path: Path, dse: Command
) -> None:
    other = write(tmp_path / "other.lcm", Plan(bias=1e-12))
    outcome = dse("compare", plain, other)
    assert outcome.code == 1
    assert "ahg/reactor 1: first difference at sample 50 (t = 0.0138889 h) in T1:" in outcome.out
    assert outcome.out.count("DIFFERENT") == 2
    assert "150 samples differ" in outcome.out


def test_missing_samples_and_nodes_make_logs_different(
    plain: Path, tmp_path: Path, dse: Command
) -> None:
    fewer = write(tmp_path / "fewer.lcm", Plan(lose={(0, 0, 9)}))
    outcome = dse("compare", plain, fewer)
    assert outcome.code == 1
    assert f"1 are only in {plain}" in outcome.out
    none = write(tmp_path / "none.lcm", Plan(node_info=False))
    assert dse("compare", plain, none).code == 1


def test_another_health_alone_is_a_difference(plain: Path, tmp_path: Path, dse: Command) -> None:
    worse = write(tmp_path / "worse.lcm", Plan(coasting=range(60, 81)))
    outcome = dse("compare", plain, worse)
    assert outcome.code == 1
    assert "ekf/reactor 1: first difference at sample 80" in outcome.out
    assert "in health: 1.0 and 2.0; 1 samples differ" in outcome.out
    assert outcome.out.count("DIFFERENT") == 2


def mistakes(folder: Path) -> dict[str, tuple[list[Any], str]]:
    """Command lines with the word that their error message must have."""
    (folder / "empty.lcm").touch()
    (folder / "text.lcm").write_text("hello\n" * 100)
    write(folder / "good.lcm", Plan(samples=5))
    write(folder / "anonymous.lcm", Plan(samples=5, run_info=False))
    (folder / "foreign.lcm").write_bytes(
        (folder / "good.lcm").read_bytes().replace(b"DSE_", b"ABC_")
    )
    (folder / "stub.lcm").write_bytes((folder / "good.lcm").read_bytes()[:20])
    good = folder / "good.lcm"
    return {
        "absent": (["info", folder / "absent.lcm"], "No such file"),
        "folder": (["info", folder], "directory"),
        "empty": (["report", folder / "empty.lcm"], "empty"),
        "text": (["info", folder / "text.lcm"], "not an LCM event log"),
        "stub": (["info", folder / "stub.lcm"], "no complete event"),
        "foreign": (["info", folder / "foreign.lcm"], "no run of dse in the log (foreign channel)"),
        "anonymous": (["report", folder / "anonymous.lcm"], "no run_info of the plant"),
        "near": (["plot", good, "--state", "t1"], "did you mean T1, "),
        "far": (["plot", good, "--state", "pressure"], "there are T1, C1, T2, C2"),
        "network": (["plot", good, "--state", "T1", "--network", "akf"], "did you mean"),
        "diagnostic": (["plot", good, "--diagnostic", "thata"], "did you mean theta?"),
        "nothing": (["plot", good], "give --state"),
        "ending": (["plot", good, "--state", "T1", "-o", folder / "x.doc"], "doc"),
        "run": (["info", good, "--run", "first"], "not a number"),
        "late": (["report", good, "--late", "0"], "--late 0.0"),
        "format": (["export", good, "--format", "xls", "-o", folder], "invalid choice"),
        "unwritable": (["export", good, "-o", good], "File exists"),
        "second": (["compare", good, folder / "absent.lcm"], "No such file"),
    }


MISTAKES = (
    *("absent", "folder", "empty", "text", "stub", "foreign", "anonymous", "near", "far"),
    *("network", "diagnostic", "nothing", "ending", "run", "late", "format", "unwritable"),
    "second",
)


@pytest.mark.parametrize("name", MISTAKES)
def test_a_users_mistake_is_one_clear_line_and_exit_code_2(
    tmp_path: Path, dse: Command, name: str
) -> None:
    arguments, word = mistakes(tmp_path)[name]
    outcome = dse(*arguments)
    assert outcome.code == 2
    assert word in outcome.err
    assert "Traceback" not in outcome.err
    assert outcome.out == ""
    errors = [line for line in outcome.err.splitlines() if line.startswith(f"dse {arguments[0]}: ")]
    assert len(errors) == 1


def test_a_reader_that_goes_away_causes_no_traceback(plain: Path) -> None:
    command = [sys.executable, "-m", "dse", "info", str(plain), "--yaml"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == b""
    process.stderr.close()
    process.wait()


def test_each_command_has_a_help(dse: Command) -> None:
    for command in ("info", "report", "plot", "export", "compare"):
        outcome = dse(command, "--help")
        assert outcome.code == 0
        assert "LOG" in outcome.out
        assert command in dse("--help").out
