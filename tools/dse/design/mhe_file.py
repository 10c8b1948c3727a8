"""What coordinated moving horizon estimation a file describes: a scenario, or plain matrices.

A scenario's networks with a section `coordinated_mhe`, its plant linear and discrete or a shipped
one, which is linearised about the section's `origin`. Or a YAML or JSON file with

    A: [[..], ..]   C: [[..], ..]   blocks: [3, 3, 3]   groups: [1, 1, 1]
    Q: [..]   R: [..]   D: [..]   Hp: 10   Hmin: 3   eps: 0.001

diagonals flat, matrices in rows or flat; groups, D, Hmin and eps may be left out.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dse.design.linearise import linearise
from dse.design.scenario_file import find, load
from dse.design.window import Model
from dse.errors import UserError
from dse.run import Floats

SECTION = "coordinated_mhe"


@dataclass
class Scheme:
    """One network."""

    name: str
    kinds: set[str]
    """Values of the key `scheme` of all networks that this stands for; empty: any."""
    model: Model
    Hp: int
    Hmin: int
    eps: float
    beta: float


def schemes(name: str, library: str | Path | None = None) -> list[Scheme]:
    """All that the file describes; UserError when there is none or it cannot be understood."""
    import yaml

    path = find(name)
    try:
        text: Any = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise UserError(f"{path}: {' '.join(str(error).split())}") from None
    if not isinstance(text, dict):
        raise UserError(f"{path}: neither a scenario nor matrices")
    try:
        if "plant" in text:
            found = list(_networks(path, text, library))
        else:
            found = [_plain(path, text)]
        for one in found:
            one.model.check()
    except (TypeError, ValueError, KeyError, AttributeError) as error:
        raise UserError(f"{path}: cannot be understood ({error})") from None
    if not found:
        raise UserError(f"{path}: no network has a section {SECTION}")
    return found


def _floats(value: Any) -> Floats:  # noqa: ANN401 - YAML
    return np.array(value, dtype=float)


def _optional(section: dict[str, Any], key: str) -> Floats | None:
    return _floats(section[key]) if section.get(key) is not None else None


def _matrices(about: dict[str, Any]) -> tuple[Floats, Floats, list[int], list[int]]:
    """A, C and the states and outputs of the subsystems."""
    n = int(about.get("nx") or round(np.sqrt(_floats(about["A"]).size)))
    A, C = _floats(about["A"]).reshape(n, n), _floats(about["C"]).reshape(-1, n)  # noqa: N806
    if "blocks" not in about:
        raise UserError("which states belong to which subsystem is missing: blocks: [3, 3, 3]")
    states = [int(count) for count in about["blocks"]]
    outputs = [int(count) for count in about.get("groups") or []]
    if not outputs and sum(states) == n:  # a row of C belongs to the subsystem that it sees first
        of_state = np.repeat(np.arange(len(states)), states)
        seen = [int(of_state[np.flatnonzero(row)[0]]) for row in C if row.any()]
        if seen != sorted(seen):
            raise UserError("C: its rows are not in the order of the subsystems")
        outputs = [seen.count(i) for i in range(len(states))]
    return A, C, states, outputs


def _scheme(
    path: Path,
    name: str,
    section: dict[str, Any],
    parts: tuple[Floats, Floats, list[int], list[int]],
    names: list[str],
) -> Scheme:
    model = Model(
        *parts,
        Q=_floats(section["Q"]),
        R=_floats(section["R"]),
        D=_optional(section, "D"),
        arrival=_optional(section, "P_inv"),
        names=names,
    )
    longest = int(section["Hp"])
    shortest = int(section.get("Hmin", longest))
    if not 1 <= shortest <= longest:
        raise UserError(f"{path}: Hmin {shortest} and Hp {longest} are not in order")
    return Scheme(
        name,
        {str(section["scheme"])} if "scheme" in section else set(),
        model,
        longest,
        shortest,
        float(section.get("eps", 1e-3)),
        float(section.get("beta", 1)),
    )


def _plain(path: Path, text: dict[str, Any]) -> Scheme:
    parts = _matrices(text)
    names = [str(name) for name in text.get("states") or []]
    return _scheme(path, path.stem, text, parts, names)


def _networks(path: Path, text: dict[str, Any], library: str | Path | None) -> Iterator[Scheme]:
    about = text["plant"]
    for network in text.get("networks") or []:
        section = network.get(SECTION)
        if section is None:
            continue
        if about.get("linear"):
            linear = about["linear"]
            if linear.get("time") != "discrete":
                raise UserError(f"{path}: plant.linear must be discrete: dse design linearise")
            parts = _matrices(linear)
            names = [str(name) for name in linear.get("states") or []]
        else:
            parts, names = _linearised(path, text, network, section, library)
        yield _scheme(path, str(network["name"]), section, parts, names)


def _linearised(
    path: Path,
    text: dict[str, Any],
    network: dict[str, Any],
    section: dict[str, Any],
    library: str | Path | None,
) -> tuple[tuple[Floats, Floats, list[int], list[int]], list[str]]:
    scenario = load(str(path), library)
    plant = scenario.plant
    states = [i for one in plant.subsystems for i in one.states]
    if states != list(range(len(plant.states))):
        raise UserError(f"{path}: the states of {plant.name} do not stand in subsystems")
    period = float(text["time"]["period_s"]) / plant.time_unit_s
    values = scenario.believed[str(network["name"])]
    found = linearise(plant, values, scenario.u, _floats(section["origin"]), period)
    sizes = [len(one.states) for one in plant.subsystems]
    outputs = [len(one.outputs) for one in plant.subsystems]
    return (found.A, found.C, sizes, outputs), [one.name for one in plant.states]
