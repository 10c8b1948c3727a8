"""What `dse design uio`, `functional` and `luenberger` write runs as a scenario's section."""

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from harness import BIN, tool

from dse.agreement import same_states
from dse.log import read
from dse.run import Floats, Run

SHIPPED = Path(__file__).parents[2] / "sim" / "scenarios"


def designed(*words: str) -> dict[str, Any]:
    """The section that a design command writes."""
    said = subprocess.run(
        [tool("dse"), "design", *words], capture_output=True, text=True, timeout=100
    )
    assert said.returncode == 0, said.stderr
    section = yaml.safe_load(said.stdout)["distributed_observer"]
    assert isinstance(section, dict)
    return section


def run(folder: Path, scenario: dict[str, Any]) -> Run:
    """Its log, all in one process."""
    path, log = folder / "made.yaml", folder / "made.lcm"
    path.write_text(yaml.safe_dump(scenario, sort_keys=False))
    said = subprocess.run(
        [str(BIN / "dse-run"), str(path), "--inproc", "--quiet", "--log", str(log)],
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert said.returncode == 0, said.stderr
    return read(log)


def shipped(name: str, duration_s: float, *networks: str) -> dict[str, Any]:
    """A shipped scenario, shorter and with these networks only."""
    scenario: dict[str, Any] = yaml.safe_load((SHIPPED / f"{name}.yaml").read_text())
    scenario["time"]["duration_s"] = duration_s
    scenario["networks"] = [one for one in scenario["networks"] if one["name"] in networks]
    assert len(scenario["networks"]) == len(networks)
    return scenario


def estimates(run: Run, network: str) -> Floats:
    """Samples, nodes, states."""
    return np.stack([node.estimates.value for node in run.network(network).nodes], axis=1)


CASES = {
    "uio, consistent": ("aho-e5_unknown_input", "consistent", ["uio", "descriptor_uio"]),
    "functional, consistent": (
        "aho-e6_functional",
        "consistent",
        ["functional", "descriptor_fo", "--gamma=0.1"],
    ),
    "functional, printed": (
        "aho-e6_functional",
        "printed",
        ["functional", "descriptor_fo", "--gamma=0.1", "--law=printed"],
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_designed_section_runs_as_the_shipped_scenario_does(case: str, tmp_path: Path) -> None:
    name, network, words = CASES[case]
    scenario = shipped(name, 0.5, network)
    made = {**scenario["networks"][0], "name": "made", "distributed_observer": designed(*words)}
    scenario["networks"].append(made)
    both = run(tmp_path, scenario)
    got, want = estimates(both, "made"), estimates(both, network)
    assert got.shape == want.shape and len(got) == 50
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-9)


LINEAR = "{time: %s, A: [%s], C: [1, 0, 0, 1], nx: 2, nu: 0, groups: [1, 1]}"


@pytest.mark.parametrize("time", ["continuous", "discrete"])
def test_designed_luenberger_observers_forget_their_start(time: str, tmp_path: Path) -> None:
    A = [[-0.15, -2.0], [2.0, 0.0]]
    if time == "discrete":
        A = [[0.9, -0.3], [0.3, 0.9]]
    plant = tmp_path / "plant.yaml"
    plant.write_text(f"time: {time}\nA: {A}\nnodes: [{{C: [[1, 0]]}}, {{C: [[0, 1]]}}]\n")
    linear = yaml.safe_load(LINEAR % (time, ", ".join(str(a) for row in A for a in row)))
    scenario = {
        "name": "made",
        "title": "Luenberger observers as designed",
        "seed": 1,
        "time": {"period_s": 0.02, "duration_s": 12.0},
        "plant": {"name": "linear", "linear": linear, "x0": [3, -2]},
        "networks": [{"name": "made", "distributed_observer": designed("luenberger", str(plant))}],
    }
    made = run(tmp_path, scenario)
    found = same_states(made, made.network("made"))
    assert found is not None
    _, _, error = found
    assert np.abs(error[:, 0]).max() > 1
    assert np.abs(error[:, -1]).max() < 1e-2
