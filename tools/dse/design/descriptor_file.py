"""The linear plant that `dse design uio`, `functional` and `luenberger` read.

    E x' = A x + B u + F v        v: inputs that nobody knows
    y_i  = C_i x + G_i v          node i's measurements
    z    = L x                    the functional that is to be estimated

A YAML file with matrices as lists of rows:

    E: [[1, 0], [0, 0]]      left out: the identity
    A: [[-1, 1], [0, 1]]
    B: [[1], [1]]            left out: no known inputs
    F: [[1], [0]]            uio only
    L: [[0, 1]]              functional only
    Q: [[1, 0], [0, 1]]      luenberger only: intensity of the process noise; identity
    time: discrete           luenberger only; left out: continuous
    nodes:
      - C: [[1, 0]]
        G: [[0]]             left out: zero
        R: [[0.1]]           luenberger only: intensity of the measurement noise; identity
        guess: [0, 0]        the node's guess of x; left out: zero
        z0: [0]              initial observer state instead of a guess

Further keys of a node fix what is free in the design, see the command.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dse.design.algebra import Floats
from dse.errors import UserError, unknown

EXAMPLES = Path(__file__).parent / "examples"


@dataclass(frozen=True)
class Node:
    """What one node measures, and what of its design is given."""

    C: Floats
    """(p, n)."""
    G: Floats
    """(p, q)."""
    given: dict[str, Floats]
    """Every other key of the node."""


@dataclass(frozen=True)
class DescriptorPlant:
    """A plant file, read and checked."""

    path: Path
    E: Floats
    """(m, n)."""
    A: Floats
    """(m, n)."""
    B: Floats
    """(m, nu)."""
    F: Floats
    """(m, q)."""
    L: Floats
    """(r, n)."""
    Q: Floats
    """(n, n)."""
    discrete: bool
    nodes: list[Node]


def find(name: str) -> Path:
    """A file, or the shipped plant of this name."""
    path = Path(name)
    if path.is_file():
        return path
    shipped = {one.stem: one for one in EXAMPLES.glob("descriptor_*.yaml")}
    if name in shipped:
        return shipped[name]
    raise UserError(f"{name}: no such file; {unknown('shipped plant', name, shipped)}")


def load(name: str, node_keys: tuple[str, ...]) -> DescriptorPlant:
    """Read the plant; node_keys are the further keys that a node may have."""
    import yaml

    path = find(name)
    try:
        text: Any = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise UserError(f"{path}: {' '.join(str(error).split())}") from None
    if not isinstance(text, dict):
        raise UserError(f"{path}: must hold the matrices of a plant, A: [[..], ..]")
    try:
        return _read(path, text, node_keys)
    except UserError as error:
        raise UserError(f"{path}: {error}") from None


PLANT_KEYS = ("title", "source", "time", "E", "A", "B", "F", "L", "Q", "nodes")


def _read(path: Path, text: dict[str, Any], node_keys: tuple[str, ...]) -> DescriptorPlant:
    for key in text:
        if key not in PLANT_KEYS:
            raise unknown("key of a plant", str(key), PLANT_KEYS)
    A = matrix("A", text.get("A"))
    m, n = A.shape
    E = matrix("E", text["E"], m, n) if "E" in text else np.eye(m, n)
    if "E" not in text and m != n:
        raise UserError(f"A is {m} x {n}: without E it must be square")
    if text.get("time", "continuous") not in ("continuous", "discrete"):
        raise UserError(f"time: {text['time']} is neither continuous nor discrete")
    entries = text.get("nodes")
    if not isinstance(entries, list) or not entries:
        raise UserError("nodes: must be a list with a C for each node")
    F = matrix("F", text["F"], m) if "F" in text else np.zeros((m, 0))
    return DescriptorPlant(
        path=path,
        E=E,
        A=A,
        B=matrix("B", text["B"], m) if "B" in text else np.zeros((m, 0)),
        F=F,
        L=matrix("L", text["L"], columns=n) if "L" in text else np.zeros((0, n)),
        Q=matrix("Q", text["Q"], n, n) if "Q" in text else np.eye(n),
        discrete=text.get("time") == "discrete",
        nodes=[_node(i, one, n, F.shape[1], node_keys) for i, one in enumerate(entries)],
    )


def _node(i: int, entry: Any, n: int, q: int, keys: tuple[str, ...]) -> Node:  # noqa: ANN401
    where = f"nodes[{i}]"
    if not isinstance(entry, dict) or "C" not in entry:
        raise UserError(f"{where}: must have a matrix C")
    known = ("C", "G", "guess", "z0", *keys)
    for key in entry:
        if key not in known:
            raise UserError(f"{where}: {unknown('key', str(key), known)}")
    C = matrix(f"{where}.C", entry["C"], columns=n)
    p = C.shape[0]
    G = matrix(f"{where}.G", entry["G"], p, q) if "G" in entry else np.zeros((p, q))
    given = {
        key: np.atleast_1d(_array(f"{where}.{key}", value))
        for key, value in entry.items()
        if key not in ("C", "G")
    }
    if "guess" in given and given["guess"].size != n:
        raise UserError(f"{where}.guess has {given['guess'].size} values, the plant {n} states")
    return Node(C, G, given)


def matrix(
    what: str,
    value: Any,  # noqa: ANN401 - a user's file
    rows: int | None = None,
    columns: int | None = None,
) -> Floats:
    """A matrix given as a list of rows."""
    found = _array(what, value)
    if found.ndim != 2:
        raise UserError(f"{what}: must be a list of rows, [[..], [..]]")
    for name, wanted, got in zip(("rows", "columns"), (rows, columns), found.shape, strict=True):
        if wanted is not None and got != wanted:
            raise UserError(f"{what} has {got} {name}, needed {wanted}")
    return found


def _array(what: str, value: Any) -> Floats:  # noqa: ANN401 - a user's file
    try:
        found = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise UserError(f"{what}: must be numbers in rows of equal length") from None
    if not np.all(np.isfinite(found)):
        raise UserError(f"{what}: has entries that are not finite")
    return found
