"""The plant of a scenario file, for offline design.

dse-run checks such files; here only what is needed is read, and what cannot be understood is a
UserError.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from dse.errors import UserError
from dse.plants import ROOT, Plant
from dse.run import Floats

SHIPPED = ROOT / "sim" / "scenarios"


@dataclass
class ScenarioPlant:
    """The plant as the scenario has it at its start."""

    path: Path
    plant: Plant
    values: Floats
    """(n_parameters,)."""
    x0: Floats
    """(nx,)."""
    u: Floats
    """(nu,)."""
    believed: dict[str, Floats]
    """By network: the parameter values that its estimators take for true, (n_parameters,)."""
    guesses: dict[str, Floats]
    """By network: its guess of the initial state, (nx,)."""


def find(name: str) -> Path:
    """A file, or the only shipped scenario whose name begins so ($DSE_SCENARIOS first)."""
    if (path := Path(name)).is_file():
        return path
    folders = [Path(one) for one in os.environ.get("DSE_SCENARIOS", "").split(":") if one]
    found = {
        one.name: one
        for folder in reversed([*folders, SHIPPED])
        for one in folder.glob(f"{name}*.yaml")
    }
    if exact := found.get(f"{name}.yaml"):
        return exact
    whole = [one for key, one in found.items() if key.startswith(f"{name}_")]
    matches = whole or list(found.values())
    if len(matches) != 1:
        names = ", ".join(sorted(one.stem for one in matches)) or "none"
        raise UserError(f"{name}: no scenario file; shipped scenarios that begin so: {names}")
    return matches[0]


def document(name: str) -> dict[str, Any]:
    """The scenario called so as it is written; it has a plant with a name."""
    path = find(name)
    try:
        text: Any = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise UserError(f"{path}: {error}") from None
    about = text.get("plant") if isinstance(text, dict) else None
    if not isinstance(about, dict) or "name" not in about:
        raise UserError(f"{path}: not a scenario: it names no plant")
    return dict(text)


def load(name: str, library: str | Path | None = None) -> ScenarioPlant:
    """Read the scenario called so."""
    path, text = find(name), document(name)
    about = text["plant"]
    try:
        return _plant(path, about, list(text.get("networks") or []), library)
    except (TypeError, ValueError, KeyError, AttributeError) as error:
        raise UserError(f"{path}: cannot be understood ({error}); see dse-run --dry-run") from None


def _changed(plant: Plant, values: Floats, about: dict[str, Any]) -> Floats:
    """Parameter values as `parameters` of a plant or network changes them."""
    values = values.copy()
    for one in about.get("parameters") or []:
        values[plant.parameter(str(one["name"]))] = float(one["value"])
    return values


def _plant(
    path: Path, about: dict[str, Any], networks: list[Any], library: str | Path | None
) -> ScenarioPlant:
    plant = Plant(str(about["name"]), library)
    chosen = plant.set(about.get("set"))
    values = _changed(plant, chosen.values, about)
    x0 = np.array(about.get("x0", chosen.x0), dtype=float)
    u = np.array(about.get("inputs", plant.nominal_inputs), dtype=float)
    if len(x0) != len(plant.states) or len(u) != len(plant.inputs):
        raise UserError(f"{path}: x0 or inputs do not fit the plant {plant.name}")
    names = [one.name for one in plant.inputs]
    for drive in about.get("drive") or []:
        if "loop" not in drive:
            u[names.index(str(drive["name"]))] = float(drive["value"])
    believed = {}
    for network in networks:
        own = plant.set(network["set"]).values if "set" in network else values
        believed[str(network["name"])] = _changed(plant, own, network)
    guesses = {
        str(one["name"]): np.array(one["guess"], dtype=float) for one in networks if "guess" in one
    }
    return ScenarioPlant(path, plant, values, x0, u, believed, guesses)
