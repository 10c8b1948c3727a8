"""Reading logs, whatever has happened to them."""

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lcm
import numpy as np
import pytest
import synthetic
from conftest import Command
from synthetic import PERIOD, Plan, Writer, estimate, truth, write

from dse import events, lcmtypes
from dse.log import read


def test_a_log_gives_back_what_was_written(plain: Path) -> None:
    run = read(plain)
    plan = Plan()
    assert run.warnings == []
    assert run.ended == "complete"
    assert [state.label for state in run.states] == [
        *("T1 [K]", "C1 [kmol/m3]", "T2 [K]", "C2 [kmol/m3]"),
    ]
    np.testing.assert_array_equal(run.truth.value, truth(plan))
    np.testing.assert_array_equal(run.truth.time, np.arange(plan.samples) * PERIOD)
    for network, node in run.nodes:
        expected = estimate(plan, network.index)[:, node.states]
        np.testing.assert_array_equal(node.estimates.value, expected)
    first = run.networks[0].nodes[0]
    assert [signal.name for signal in first.diagnostics] == ["theta", "J", "innovation"]
    assert first.estimates.diagnostic.shape == (plan.samples, 3)
    assert (first.estimates.variance == plan.noise**2).all()
    assert np.isnan(run.networks[1].nodes[0].estimates.variance).all()
    assert first.done.sent_bytes.sum() == 16 * plan.samples


def test_an_unknown_input_is_what_the_truth_says(tmp_path: Path) -> None:
    plan = Plan(samples=50, disturbed=True)
    run = read(write(tmp_path / "disturbed.lcm", plan))
    assert run.warnings == []
    assert [one.name for one in run.inputs] == ["Q1", "v"]
    np.testing.assert_array_equal(run.truth.value, truth(plan))
    np.testing.assert_array_equal(run.input.value[:, 0], 2.5e5)
    np.testing.assert_array_equal(run.input.value[:, 1], np.arange(50) / 10)


def test_an_unknown_input_stays_unknown_without_truth(tmp_path: Path) -> None:
    run = read(write(tmp_path / "blind.lcm", Plan(samples=20, disturbed=True, truth=False)))
    np.testing.assert_array_equal(run.input.value[:, 0], 2.5e5)
    assert np.isnan(run.input.value[:, 1]).all()


def test_a_missing_channel_is_nan(plain: Path) -> None:
    signals, series = read(plain).measurements["reactor 2"]
    assert [signal.name for signal in signals] == ["T2"]
    missing = series.sample % 10 == 5
    assert np.isnan(series.value[missing]).all()
    assert np.isfinite(series.value[~missing]).all()


def test_vectors_of_several_parts_are_joined(tmp_path: Path) -> None:
    plan = Plan(samples=20, states=80)
    run = read(write(tmp_path / "wide.lcm", plan))
    np.testing.assert_array_equal(run.truth.value, truth(plan))
    node = run.networks[1].nodes[0]
    assert len(node.states) == 78
    np.testing.assert_array_equal(node.estimates.value, estimate(plan, 1)[:, node.states])


def test_a_sample_of_which_a_part_is_missing_is_left_out(tmp_path: Path) -> None:
    whole = write(tmp_path / "wide.lcm", Plan(samples=20, states=80))
    cut = lcm.EventLog(tmp_path / "cut.lcm", "w")
    for event in lcm.EventLog(whole, "r"):
        if event.channel == "DSE_TRUTH":
            message = lcmtypes.truth_t.decode(event.data)
            if (message.header.sample, message.part) == (4, 1):
                continue
        cut.write_event(event.timestamp, event.channel, event.data)
    cut.close()
    run = read(tmp_path / "cut.lcm")
    np.testing.assert_array_equal(run.truth.sample, np.delete(np.arange(20), 4))
    expected = np.delete(truth(Plan(samples=20, states=80)), 4, axis=0)
    np.testing.assert_array_equal(run.truth.value, expected)
    assert any("1 samples of truth are incomplete" in warning for warning in run.warnings)


@pytest.mark.parametrize("keep", [0.99, 0.5, 0.1])
def test_a_truncated_log_is_read_as_far_as_it_goes(
    plain: Path, tmp_path: Path, keep: float
) -> None:
    data = plain.read_bytes()
    cut = tmp_path / "cut.lcm"
    cut.write_bytes(data[: int(keep * len(data))])
    run = read(cut)
    whole = read(plain)
    got = run.networks[0].nodes[0].estimates
    n = len(got.sample)
    assert 0.9 * keep * 200 < n < 200
    np.testing.assert_array_equal(got.value, whole.networks[0].nodes[0].estimates.value[:n])
    warning = next(w for w in run.warnings if "cut off" in w)
    assert f"byte {run.log.cut_at} of {cut.stat().st_size}, in event {run.log.events}" in warning
    assert data[run.log.cut_at :][:4] == events.SYNC
    assert run.ended == "not in the log"


def test_damage_in_the_middle_costs_the_damaged_events_only(plain: Path, tmp_path: Path) -> None:
    data = bytearray(plain.read_bytes())
    place = data.index(events.SYNC, len(data) // 2)
    data[place : place + 40] = b"\0" * 40
    damaged = tmp_path / "damaged.lcm"
    damaged.write_bytes(data)
    run = read(damaged)
    assert run.log.events == read(plain).log.events - 1
    assert any(f"damaged at byte {place}" in warning for warning in run.warnings)


def test_events_that_are_not_ours_are_counted_by_channel_and_reason(tmp_path: Path) -> None:
    log = lcm.EventLog(tmp_path / "odd.lcm", "w")
    plan = Plan(samples=5)
    synthetic.put_run(log, plan)
    good = lcmtypes.done_t().encode()
    log.write_event(1, "DSE_DONE", b"\1" * 8 + good[8:])
    log.write_event(2, "DSE_DONE", good[:-1])
    log.write_event(3, "DSE_DONE", b"abc")
    log.write_event(4, "CAMERA", b"abc")
    odd = lcmtypes.truth_t()
    odd.header.run_id, odd.header.network = plan.run_id, -1
    odd.header.sample, odd.header.sequence = 5, 5
    odd.parts, odd.count = 1, 33
    log.write_event(5, "DSE_TRUTH", odd.encode())
    wrong = lcmtypes.estimate_t()
    wrong.header.network, wrong.parts = 1, 1
    log.write_event(6, "DSE_ESTIMATE_0_0", wrong.encode())
    log.close()
    run = read(tmp_path / "odd.lcm")
    assert run.log.refused == {
        "DSE_DONE": {"other type or version": 2, "wrong length": 1},
        "CAMERA": {"foreign channel": 1},
        "DSE_TRUTH": {"impossible part or count": 1},
        "DSE_ESTIMATE_0_0": {"header of another channel": 1},
    }
    np.testing.assert_array_equal(run.truth.value, truth(plan))
    assert run.lost == {}


def test_gaps_repetitions_and_missing_estimates_are_told_apart(tmp_path: Path) -> None:
    plan = Plan(
        lose={(0, 1, 7), (0, 1, 8)}, repeat={(1, 0, 3)}, skip={(1, 1, k) for k in range(20, 30)}
    )
    run = read(write(tmp_path / "gaps.lcm", plan))
    assert run.lost == {"estimate_t of ahg/reactor 2": 2}
    assert run.repeated == 1
    assert [len(node.estimates.sample) for _, node in run.nodes] == [200, 198, 200, 190]
    assert any("2 messages are missing in the log" in warning for warning in run.warnings)


def test_exchanges_are_counted_once_and_repeats_apart(plain: Path) -> None:
    exchanges = read(plain).networks[0].nodes[1].exchanges
    assert (exchanges.told, exchanges.payload_bytes, exchanges.repeats) == (200, 3200, 1)
    assert exchanges.wire_bytes == 201 * (8 + events.layout("exchange_t").itemsize)


def test_of_two_runs_the_larger_is_taken_and_said(tmp_path: Path, dse: Command) -> None:
    log = write(tmp_path / "two.lcm", Plan(samples=30, run_id=11), Plan(samples=50, run_id=22))
    run = read(log)
    assert run.run_id == 22
    assert run.other_runs == {11: 120}
    assert len(run.truth.sample) == 50
    assert any("2 runs in the log; this is run 0x16" in warning for warning in run.warnings)
    other = read(log, "0xb")
    assert len(other.truth.sample) == 30
    assert other.warnings == []
    outcome = dse("info", log, "--run", 33)
    assert (outcome.code, "there are 0xb, 0x16" in outcome.err) == (2, True)


def test_a_replay_takes_the_plant_from_the_recorded_run(tmp_path: Path) -> None:
    """As lcm-logplayer makes it: plant and old estimates of run 11, new estimates of run 22."""
    recorded = write(tmp_path / "recorded.lcm", Plan(samples=40, run_id=11))
    replay = lcm.EventLog(tmp_path / "replay.lcm", "w")
    for event in lcm.EventLog(recorded, "r"):
        replay.write_event(event.timestamp, event.channel, event.data)
        match event.channel.split("_")[1]:
            case "ESTIMATE":
                message = lcmtypes.estimate_t.decode(event.data)
            case "RUN":
                message = lcmtypes.run_info_t.decode(event.data)
                if message.header.network < 0:
                    continue
                text = json.loads(message.text[: message.count])
                body = json.dumps(text | {"source_run": 11}).encode()
                message.count, message.text = len(body), body.ljust(1024, b"\0")
            case _:
                continue
        message.header.run_id = 22
        replay.write_event(event.timestamp + 1, event.channel, message.encode())
    replay.close()
    run = read(tmp_path / "replay.lcm")
    assert run.run_id == 22
    assert len(run.truth.sample) == 40
    assert [len(node.estimates.sample) for _, node in run.nodes] == [40] * 4
    assert any("a replay" in warning for warning in run.warnings)


def test_without_a_nodes_run_info_its_estimates_are_left_out(tmp_path: Path) -> None:
    run = read(write(tmp_path / "anonymous.lcm", Plan(samples=10, node_info=False)))
    assert all(len(node.estimates.sample) == 0 for _, node in run.nodes)
    assert sum("its estimates are not used" in warning for warning in run.warnings) == 4


def test_a_failed_node_is_reported_with_its_reason(tmp_path: Path) -> None:
    log = lcm.EventLog(tmp_path / "failed.lcm", "w")
    plan = Plan(samples=5)
    synthetic.put_run(log, plan)
    status = lcmtypes.status_t()
    status.header.run_id, status.header.role, status.header.sequence = plan.run_id, 1, 9
    status.reason_length, status.reason = 12, b"out of luck!".ljust(200, b"\0")
    Writer(log, plan).put("DSE_STATUS", status)
    log.close()
    warnings = read(tmp_path / "failed.lcm").warnings
    assert "ahg/reactor 1 ended early: out of luck!" in warnings


def not_json(info: dict[str, Any]) -> bytes:
    return b"{" + json.dumps(info).encode()


def no_list(info: dict[str, Any]) -> bytes:
    info["plant"]["states"] = {"name": "T1"}
    return json.dumps(info).encode()


def no_number(info: dict[str, Any]) -> bytes:
    info["plant"]["states"][1]["scale"] = "large"
    return json.dumps(info).encode()


def no_object(_: dict[str, Any]) -> bytes:
    return b"[1, 2]"


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (not_json, "not JSON"),
        (no_list, "it.plant.states is {'name': 'T1'}"),
        (no_number, "it.plant.states[1].scale is 'large'"),
        (no_object, "it is [1, 2]"),
    ],
)
def test_run_info_of_another_form_is_refused_by_name(
    tmp_path: Path,
    dse: Command,
    spoil: Callable[[dict[str, Any]], bytes],
    message: str,
) -> None:
    plan = Plan(samples=5, run_info=False)
    log = lcm.EventLog(tmp_path / "spoilt.lcm", "w")
    text = spoil(synthetic.plant_info(plan))
    for part in range(count := -(-len(text) // 1024)):
        piece = text[1024 * part : 1024 * (part + 1)]
        info = lcmtypes.run_info_t()
        info.header.run_id, info.header.network, info.header.sequence = plan.run_id, -1, part
        info.part, info.parts, info.count = part, count, len(piece)
        info.text = piece.ljust(1024, b"\0")
        log.write_event(part, "DSE_RUN_INFO", info.encode())
    synthetic.put_run(log, plan)
    log.close()
    outcome = dse("info", tmp_path / "spoilt.lcm")
    assert outcome.code == 2
    assert message in outcome.err
    assert "Traceback" not in outcome.err


def test_random_bytes_never_cause_a_traceback(plain: Path, tmp_path: Path, dse: Command) -> None:
    data = plain.read_bytes()[:60000]
    generator = np.random.default_rng(5)
    for trial in range(40):
        spoilt = bytearray(data)
        for place in generator.integers(0, len(data), 60):
            spoilt[place] = generator.integers(0, 256)
        spoilt[:4] = struct.pack(">I", 0xEDA1DA01)
        path = tmp_path / f"spoilt{trial}.lcm"
        path.write_bytes(spoilt)
        assert dse("report", path, "--json").code in (0, 2)
