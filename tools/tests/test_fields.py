"""Fields of flows in logs: what is drawn is what the coefficients and the simulated flow say."""

from pathlib import Path

import lcm
import numpy as np
import pytest
import synthetic
from conftest import Command

from dse import field_plots, fields, lcmtypes
from dse.flow import TEST, Flow
from dse.log import read
from dse.plants import Plant
from dse.run import Floats
from dse.tables import percent

PERIOD, SAMPLES = 0.25, 9
RUN_ID = 77


def write(path: Path, x: Floats, plant: str = "cavity_free", missing: bool = False) -> Path:
    """A log with the truth x (SAMPLES, 10) and an estimator of two nodes, off by a tenth."""
    log = lcm.EventLog(path, "w", overwrite=True)
    writer = synthetic.Writer(log, synthetic.Plan(run_id=RUN_ID))
    names = ["a1", "a2", "a3", "a4", "b1", "b2", "b3", "h1", "h2", "h3"]
    info = synthetic.plant_info(writer.plan) | {
        "time": {"unit": "s", "unit_s": 1, "period": PERIOD, "samples": SAMPLES},
        "plant": {
            "name": plant,
            "set": "test",
            "states": [{"name": name} for name in names],
            "groups": [{"name": f"s{i}", "outputs": [3 * i, 3 * i + 1]} for i in range(4)],
        },
        "networks": [{"name": "fused", "method": "second_order", "nodes": 2}],
    }
    synthetic.put_info(writer, lcmtypes.header_t.ROLE_PLANT, -1, 0, info)
    for node in range(2):
        about = {"kind": "node", "name": f"sensor {node + 1}", "method": "second_order"}
        synthetic.put_info(
            writer, 1, 0, node, about | {"states": list(range(10)), "groups": [node + 2]}
        )
    for k in range(SAMPLES):
        for part, parts, count, values in synthetic.parts(x[k]):
            message = lcmtypes.truth_t()
            message.header = writer.header("truth", lcmtypes.header_t.ROLE_PLANT, -1, 0, k)
            message.header.plant_time = k * PERIOD
            message.part, message.parts, message.count, message.value = part, parts, count, values
            writer.put("DSE_TRUTH", message)
        for node in range(2):
            if not (missing and node == 1 and k == 4):
                synthetic.put_estimate(writer, 0, node, k, 1.1 * x[k] + node, 0.0)
    log.close()
    return path


@pytest.fixture(scope="module")
def reduced(native: Path) -> Floats:
    """The reduced model's own trajectory."""
    plant = Plant("cavity_free", native)
    found = plant.set("test")
    no_inputs = np.zeros((SAMPLES, 0))
    return plant.simulate(found.values, found.x0, no_inputs, PERIOD, steps=10)[0]


@pytest.fixture(scope="module")
def flow_states(native: Path) -> Floats:
    """The simulated flow."""
    flow = Flow(library=native)
    return flow.advance(flow.start(TEST), SAMPLES)


def test_fields_are_the_sums_of_modes(library: Path, reduced: Floats, tmp_path: Path) -> None:
    run = read(write(tmp_path / "run.lcm", reduced))
    found = fields.open_run(run)
    assert not found.simulated
    truth = found.truth(4)
    for mine, wanted in zip(truth, found.model.fields(reduced[4]), strict=True):
        np.testing.assert_allclose(mine, wanted)
    estimate = found.estimate(run.networks[0].nodes[0], 4)
    assert estimate is not None
    for mine, wanted in zip(estimate, truth, strict=True):
        assert fields.relative(mine, wanted) == pytest.approx(0.1)


def test_a_truth_that_is_the_simulated_flow_has_its_whole_fields(
    library: Path, flow_states: Floats, reduced: Floats, tmp_path: Path
) -> None:
    model = fields.open_run(read(write(tmp_path / "one.lcm", reduced))).model
    x = np.array([model.project(z) for z in flow_states])
    found = fields.open_run(read(write(tmp_path / "two.lcm", x)))
    for k in (0, 4, SAMPLES - 1):
        wanted = model.flow.fields(flow_states[k])
        for mine, other in zip(found.truth(k), wanted, strict=True):
            np.testing.assert_allclose(mine, other, atol=1e-12)
    # more than the modes show: the published error of the projection of the contaminant
    assert 0.05 < fields.relative(model.fields(x[4])[1], found.truth(4)[1]) < 0.3


def test_an_error_beyond_the_fields_size_is_told() -> None:
    assert percent(1.264) == "126 %"
    assert percent(0.99999) == "99.99 %"


def test_the_stream_function_is_that_of_the_velocity(library: Path) -> None:
    flow = Flow(forced=True)
    z = flow.start(TEST)
    w = flow.fields(z)[0]
    psi = field_plots.stream_function(flow, w)
    inner = z[: flow.corners].reshape(flow.n - 1, flow.n - 1)
    np.testing.assert_allclose(psi[1:-1, 1:-1], inner, atol=1e-13)
    np.testing.assert_allclose(np.r_[psi[0], psi[-1], psi[:, -1]], 0, atol=1e-13)


def test_a_picture_has_a_column_for_the_truth_and_each_node(
    library: Path, reduced: Floats, tmp_path: Path
) -> None:
    run = read(write(tmp_path / "run.lcm", reduced, missing=True))
    network = run.networks[0]
    figure = field_plots.figure(fields.open_run(run), 4, [(network, n) for n in network.nodes])
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert [fields.open_run(run).sensors(node) for node in network.nodes] == [[2], [3]]
    assert titles[:3] == ["truth: the reduced model", "fused, sensor 1", "fused, sensor 2"]
    assert [axes.get_xlabel() for axes in figure.axes[:9:3]] == [""] * 3
    assert [axes.get_xlabel() for axes in figure.axes[1:9:3]] == ["off by 10.00 %"] * 3
    assert [axes.texts[0].get_text() for axes in figure.axes[2:9:3]] == ["no estimate"] * 3


def test_fields_writes_pictures_at_the_times_asked_for(
    dse: Command, library: Path, reduced: Floats, tmp_path: Path
) -> None:
    log = write(tmp_path / "run.lcm", reduced)
    done = dse(
        "fields", log, "--at", "1", "--at", "0.9", "--node", "sensor 2", "-o", tmp_path / "p"
    )
    assert done.code == 0
    assert [Path(line).name for line in done.out.splitlines()] == ["run_fields_4.png"]
    assert (tmp_path / "p" / "run_fields_4.png").read_bytes()[:4] == b"\x89PNG"


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reports without drawing their pictures."""
    monkeypatch.setattr("dse.plots.save", lambda figure, path: path.touch())


def test_the_report_of_a_flow_shows_its_fields(
    dse: Command, library: Path, reduced: Floats, tmp_path: Path, quick: None
) -> None:
    log = write(tmp_path / "run.lcm", reduced)
    assert dse("report", log, "-o", tmp_path / "r").code == 0
    page = (tmp_path / "r" / "report.html").read_text()
    for sample in (0, SAMPLES - 1):
        assert f"fields_{sample}.png" in page
        assert (tmp_path / "r" / f"fields_{sample}.png").is_file()


def test_a_report_without_the_library_says_why_there_are_no_fields(
    dse: Command, reduced: Floats, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quick: None
) -> None:
    monkeypatch.setenv("DSE_PLANTS", str(tmp_path / "none.so"))
    log = write(tmp_path / "run.lcm", reduced)
    assert dse("report", log, "-o", tmp_path / "r").code == 0
    page = (tmp_path / "r" / "report.html").read_text()
    assert "fields are not drawn" in page
    assert "fields_0.png" not in page


def test_mistakes_are_told(
    dse: Command, library: Path, plain: Path, reduced: Floats, tmp_path: Path
) -> None:
    done = dse("fields", plain)
    assert done.code == 2
    assert "cstr2 has no fields" in done.err
    log = write(tmp_path / "run.lcm", reduced)
    done = dse("fields", log, "--node", "sensor 3")
    assert done.code == 2
    assert "sensor 2" in done.err


def test_a_sanitized_library_is_not_taken_by_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from dse import plants
    from dse.errors import UserError

    monkeypatch.delenv("DSE_PLANTS", raising=False)
    monkeypatch.setattr(plants, "ROOT", tmp_path)
    where = tmp_path / "build" / "asan" / "lib"
    where.mkdir(parents=True)
    (where / plants.NAME).write_bytes(b"\x7fELF __asan_init")
    with pytest.raises(UserError, match="not built"):
        plants.find()
    good = tmp_path / "build" / "release" / "lib"
    good.mkdir(parents=True)
    (good / plants.NAME).write_bytes(b"\x7fELF")
    assert plants.find() == good / plants.NAME
