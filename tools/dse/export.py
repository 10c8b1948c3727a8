"""A run as tables for other programs."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.io import savemat

from dse.run import HEALTH, Node, Run, Series, Signal

FORMATS = ("csv", "parquet", "mat")


def tables(run: Run) -> dict[str, pd.DataFrame]:
    """One table per source, one row per sample: truth, inputs, measurements, estimates, costs.

    Columns: sample, time, then the signals by name; for estimates also health, variance_<state>
    and the diagnostics by name. Units are in `description`.
    """
    found = {"truth": _frame(run.truth, run.states), "inputs": _frame(run.input, run.inputs)}
    for name, (signals, series) in run.measurements.items():
        found[f"measurement_{_word(name)}"] = _frame(series, signals)
    for network, node in run.nodes:
        who = f"{_word(network.name)}_{node.node}"
        found[f"estimate_{who}"] = _estimates(run, node)
        found[f"done_{who}"] = pd.DataFrame(vars(node.done))
    return {name: frame for name, frame in found.items() if len(frame)}


def description(run: Run) -> dict[str, Any]:
    """What the tables do not tell: run_info, units, who is who."""
    return {
        "run_info": run.info,
        "time_unit": run.time_unit,
        "states": [vars(state) for state in run.states],
        "inputs": [vars(signal) for signal in run.inputs],
        "outputs": [vars(signal) for signal in run.outputs],
        "health": list(HEALTH),
        "nodes": [
            {
                "network": network.name,
                "node": node.node,
                "name": node.name,
                "method": node.method,
                "states": [run.states[i].name for i in node.states],
                "diagnostics": [vars(signal) for signal in node.diagnostics],
                "table": f"estimate_{_word(network.name)}_{node.node}",
            }
            for network, node in run.nodes
        ],
    }


def write(run: Run, kind: str, directory: Path) -> list[Path]:
    """Write all tables of a run as `kind`, and run.json; the paths written."""
    directory.mkdir(parents=True, exist_ok=True)
    frames, written = tables(run), []
    if kind == "mat":
        path = directory / "run.mat"
        content = {_field(name): _struct(frame) for name, frame in frames.items()}
        savemat(path, content, long_field_names=True, oned_as="column")
        written.append(path)
    for name, frame in frames.items() if kind != "mat" else ():
        path = directory / f"{name}.{kind}"
        if kind == "csv":
            frame.to_csv(path, index=False)
        else:
            frame.to_parquet(path, index=False)
        written.append(path)
    path = directory / "run.json"
    path.write_text(json.dumps(_strict(description(run)), indent=2) + "\n")
    return [*written, path]


def _frame(series: Series, signals: list[Signal]) -> pd.DataFrame:
    columns = {signal.name: series.value[:, i] for i, signal in enumerate(signals)}
    return pd.DataFrame({"sample": series.sample, "time": series.time, **columns})


def _estimates(run: Run, node: Node) -> pd.DataFrame:
    estimates = node.estimates
    frame = _frame(estimates, [run.states[i] for i in node.states])
    frame.insert(2, "health", estimates.health)
    for column, i in enumerate(node.states):
        frame[f"variance_{run.states[i].name}"] = estimates.variance[:, column]
    for column, signal in enumerate(node.diagnostics):
        # A diagnostic may be called like a state: then it says what it is.
        name = signal.name if signal.name not in frame else f"diagnostic_{signal.name}"
        frame[name] = estimates.diagnostic[:, column]
    return frame


def _struct(frame: pd.DataFrame) -> dict[str, Any]:
    return {_field(str(name)): frame[name].to_numpy() for name in frame.columns}


def _word(name: str) -> str:
    """A name as part of a file name."""
    return re.sub(r"[^\w.-]+", "_", name)


def _field(name: str) -> str:
    """A name as MATLAB accepts it: letters, digits, underscores, a letter first, 63 at most."""
    word = re.sub(r"\W", "_", name, flags=re.ASCII)
    return (word if word[:1].isalpha() else f"x{word}")[:63]


def _strict(value: Any) -> Any:  # noqa: ANN401 - JSON
    """NaN and infinity, which JSON does not know, as None."""
    if isinstance(value, dict):
        return {key: _strict(member) for key, member in value.items()}
    if isinstance(value, list):
        return [_strict(member) for member in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
