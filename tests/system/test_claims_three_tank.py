"""What the three-tank scenarios claim, on logs of their runs (sim/scenarios/README.md).

Section 6 of the adaptive high-gain source: AHG-41 identification, AHG-60 identified model, AHG-61
step of the inputs, AHG-62 communication, AHG-71 valves, AHG-72 identified parameters. Late means
the last quarter of an hour of a run.
"""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dse.design.output_error import fit
from dse.log import read
from dse.plants import Plant
from dse.run import Floats, Run

BIN = Path(os.environ["DSE_BIN"])
DSE = str(Path(sys.prefix) / "bin" / "dse")
LIBRARY = BIN.parent / "lib" / "libdse_plants.so"
SCENARIOS = Path(__file__).resolve().parents[2] / "sim" / "scenarios"
SEEDS = (1, 2, 3)
FITTED = "ap1,ap2,ad1,ad2,ad3,b1,b2"
TRUE = np.array([3.43, 3.43, 18.15, 10.541392, 18.98, 4.56e-4, 4.16e-4])
"""Of the parameter set `rig`."""

Recorded = Callable[..., Path]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """The log of a scenario with a seed and changes, run once."""
    folder = tmp_path_factory.mktemp("logs")

    def run(scenario: str, seed: int, *changes: str) -> Path:
        log = folder / f"{'-'.join((scenario, str(seed), *changes))}.lcm"
        if not log.exists():
            words = [BIN / "dse-run", scenario, "--inproc", "--quiet", "--seed", seed]
            words += [word for change in changes for word in ("--set", change)]
            said = subprocess.run(
                [*map(str, words), "--log", str(log)], capture_output=True, text=True, timeout=300
            )
            assert said.returncode == 0, said.stderr
        return log

    return run


def late(log: Path, fraction: float) -> dict[str, dict[str, float]]:
    """Root mean square errors by network and state."""
    words = [DSE, "report", str(log), "--json", "--late", str(fraction)]
    said = subprocess.run(words, capture_output=True, text=True, timeout=300)
    assert said.returncode == 0, said.stderr
    networks: dict[str, Any] = json.loads(said.stdout)["networks"]
    return {
        name: {state: found["late_rmse"] for state, found in network["states"].items()}
        for name, network in networks.items()
    }


def gain_is_high(run: Run, network: str) -> list[float]:
    """Share of the samples with theta above half of its largest, of each filter that adapts."""
    shares = []
    for node in run.network(network).nodes:
        names = [signal.name for signal in node.diagnostics]
        theta = node.estimates.diagnostic[:, names.index("theta")]
        if theta.max() > 1:
            shares.append(float((theta > theta.max() / 2).mean()))
    return shares


@pytest.mark.parametrize("seed", SEEDS)
def test_ahg_61_the_adaptive_filter_comes_closer_to_the_truth(
    recorded: Recorded, seed: int
) -> None:
    """Levels 0.20, 0.11 against 0.49, 1.10 cm; interactions 0.60, 0.26 against 2.47, 5.42."""
    error = late(recorded("ahg-61", seed), 0.25)
    for state in ("x1", "x2", "x5", "x4"):
        assert error["ahg"][state] < 0.5 * error["ekf"][state], state
    # the mismatch of the model leaves tank 2 biased in both
    assert min(error["ahg"]["x3"], error["ekf"]["x3"]) > 5


def test_ahg_61_over_the_whole_hour_the_interactions_are_worse(recorded: Recorded) -> None:
    """Only the late part supports the claim."""
    error = late(recorded("ahg-61", 1), 1.0)
    assert error["ahg"]["x2"] > 1.3 * error["ekf"]["x2"]


def test_ahg_61_theta_rises_at_the_start_and_returns(recorded: Recorded) -> None:
    run = read(recorded("ahg-61", 1))
    for share in gain_is_high(run, "ahg"):
        assert 0.05 < share < 0.3


@pytest.mark.parametrize("seed", SEEDS)
def test_ahg_62_every_90_seconds_is_about_as_good_as_always(recorded: Recorded, seed: int) -> None:
    """0.12, 0.06, 0.23, 0.37 against 0.20, 0.11, 0.60, 0.26 cm; never: 1.55, 1.52, 13.1, 14.3."""
    error = late(recorded("ahg-62", seed), 0.25)
    for state in ("x1", "x2", "x5", "x4"):
        assert error["hold90"][state] < 2 * error["continuous"][state], state
        assert error["none"][state] > 5 * error["continuous"][state], state


def test_ahg_62_without_communication_the_gain_is_high_more_often(recorded: Recorded) -> None:
    """0.79 against 0.12 of the samples."""
    run = read(recorded("ahg-62", 1))
    alone, together = gain_is_high(run, "none"), gain_is_high(run, "continuous")
    assert len(alone) == len(together) == 2
    for without, with_ in zip(alone, together, strict=True):
        assert without > 3 * with_


@pytest.mark.parametrize("seed", SEEDS)
def test_ahg_71_filters_that_are_told_of_the_valves_find_the_levels(
    recorded: Recorded, seed: int
) -> None:
    """Levels 0.76, 1.18, 0.05 against 1.6, 4.4, 1.5 cm; interactions 4.7, 1.5 against 37, 50."""
    error = late(recorded("ahg-71", seed), 0.25)
    for state, factor in {"x1": 0.5, "x3": 0.5, "x5": 0.5, "x2": 0.2, "x4": 0.2}.items():
        assert error["told"][state] < factor * error["untold"][state], state


def test_ahg_71_has_no_normal_form() -> None:
    words = [str(BIN / "dse-run"), "ahg-71", "--inproc", "--no-log"]
    words += ["--set", "networks.told.high_gain_ekf.coordinates=normal"]
    said = subprocess.run(words, capture_output=True, text=True, timeout=300)
    assert said.returncode != 0
    assert "plant three_tank has no normal form with these parameters; use physical" in said.stderr


def identified(log: Path, folder: Path, *options: str) -> tuple[Floats, Floats, str]:
    """Parameters FITTED, half the widths of their intervals, and what was printed."""
    words = [DSE, "design", "identify", str(log), "--fit", FITTED, *options]
    start = ("ap1=2.5", "ap2=4.5", "ad1=24", "ad2=7.5", "ad3=24", "b1=3e-4", "b2=5.5e-4")
    words += [word for one in start for word in ("--start", one)]
    words += ["--library", str(LIBRARY), "-o", str(folder)]
    said = subprocess.run(words, capture_output=True, text=True, timeout=300)
    assert said.returncode == 0, said.stderr
    text = (folder / "parameters.yaml").read_text()
    found = re.findall(r"value: (\S+)\} # \+- (\S+)", text)
    assert len(found) == len(TRUE)
    value, half = np.array(found, dtype=float).T
    return value, half, said.stdout


def test_ahg_41_identification_finds_the_rig(recorded: Recorded, tmp_path: Path) -> None:
    """a_d within 4 %, a_p within 5.2 % and fits of 90, 34, 89 % are the spec's numbers."""
    found, half, said = identified(recorded("ahg-41", 1), tmp_path)
    error = np.abs(found / TRUE - 1)
    assert error[:2].max() < 0.052  # a_p
    assert error[2:5].max() < 0.04  # a_d
    assert error[5:].max() < 0.005  # b: 0.0003 in the spec; the Euler step costs 0.002
    fits = {
        line.split()[0]: float(line.split()[2])
        for line in said.splitlines()
        if line.strip().startswith("y") and len(line.split()) == 3
    }
    assert fits["y1"] > 85 and fits["y3"] > 85  # AHG-60: tank 2 is the weakly identified one
    assert 15 < fits["y2"] < 60
    # AHG-72: what acts on tank 2 is known least, mirrored parameters are nearly equal
    ap1, ap2, ad1, ad2, ad3, b1, b2 = half / found
    assert min(ap1, ap2, ad2) > 3 * max(ad1, ad3, b1, b2)
    ap1, ap2, ad1, _, ad3, b1, b2 = found
    for one, other, apart in ((ap1, ap2, 0.05), (ad1, ad3, 0.06), (b1, b2, 0.12)):
        assert abs(one / other - 1) < apart


def test_ahg_72_another_sampling_time_needs_another_fit(recorded: Recorded, tmp_path: Path) -> None:
    """The inflow with samples of 10 s: 1.6 and 1.9 % too small for a model in Euler steps.

    Those with samples of 1 s are within 0.2 %. With Runge-Kutta steps the model is that of the
    continuous plant, and the parameters are the same for all sampling times.
    """
    log = recorded("ahg-41", 1, "time.period_s=10")
    inflow, half = (one[5:] for one in identified(log, tmp_path)[:2])
    assert (np.abs(inflow - TRUE[5:]) > 2 * half).all()
    assert (inflow < 0.99 * TRUE[5:]).all()
    inflow, half = (one[5:] for one in identified(log, tmp_path, "--steps", "1")[:2])
    assert (np.abs(inflow - TRUE[5:]) < half).all()


@pytest.mark.parametrize("seed", SEEDS[1:])
def test_ahg_60_tank_2_is_the_one_that_the_model_reproduces_worst(
    recorded: Recorded, seed: int
) -> None:
    """Levels simulated with the inputs of a record that the parameters were not fitted to."""
    run = read(recorded("ahg-60", seed))
    plant = Plant("three_tank", LIBRARY)
    values = plant.set("identified").values.copy()
    text = (SCENARIOS / "ahg-60_threetank_identified.yaml").read_text()
    refitted = re.findall(r"name: (\w+), value: (\S+)\}", text)
    assert [name for name, _ in refitted] == FITTED.split(",")
    for name, value in refitted:
        values[plant.parameter(name)] = float(value)
    period = 1 / plant.time_unit_s
    _, simulated = plant.simulate(values, plant.set("rig").x0, run.input.value, period)
    measured = {
        signal.name: series.value[:, column]
        for signals, series in run.measurements.values()
        for column, signal in enumerate(signals)
    }
    y1, y2, y3 = fit(np.column_stack([measured[name] for name in ("y1", "y2", "y3")]), simulated)
    assert min(y1, y3) > 85
    assert y2 < 60


@pytest.mark.parametrize("seed", SEEDS[1:])
def test_ahg_60_refitted_parameters_take_the_bias_out_of_tank_2(
    recorded: Recorded, seed: int
) -> None:
    error = late(recorded("ahg-60", seed), 0.5)
    assert error["published"]["x3"] > 5
    assert error["refitted"]["x3"] < 0.1 * error["published"]["x3"]
