"""C data of the reduced cavity models, for lib/plants and sim."""

from collections.abc import Iterator
from pathlib import Path

import jinja2
import numpy as np

from dse.design.pod_model import Reduced
from dse.errors import UserError
from dse.flow import SENSORS, Flow
from dse.run import Floats

ROUNDING = 1e-13
"""Quadratic terms below this share of the largest one are rounding errors."""


def terms(F: Floats) -> list[tuple[int, int, int, float]]:  # noqa: N803
    """The terms (k, i, j, value) of q_k = sum value x_i x_j, i <= j, of forms F (N, N, N)."""
    n = len(F)
    found = []
    for k in range(n):
        for i in range(n):
            for j in range(i, n):
                value = F[k, i, i] if i == j else F[k, i, j] + F[k, j, i]
                found.append((k, i, j, float(value)))
    largest = max(abs(term[3]) for term in found)
    return [term for term in found if abs(term[3]) > ROUNDING * largest]


def model(name: str, reduced: Reduced, command: str) -> str:
    """The file lib/plants/cavity_NAME_data.c."""
    energy = "/".join(f"{100 * basis.energy[basis.count - 1]:.2f}" for basis in reduced.bases)
    return _render(
        "cavity.c.j2",
        name=name,
        command=command,
        modes=[basis.count for basis in reduced.bases],
        energy=energy,
        driven=bool(np.any(reduced.d)),
        A=reduced.A,
        d=reduced.d,
        C=reduced.C.reshape(-1, len(reduced.A)),
        terms=[(k, i, j, repr(v)) for k, i, j, v in terms(reduced.F)],
        x0=reduced.starts,
    )


def weights(name: str, reduced: Reduced, command: str) -> str:
    """The file sim/flow_weights_NAME.c: the modes as sums of snapshots."""
    rows = [row for basis in reduced.bases for row in basis.weights]
    return _render("flow_weights.c.j2", name=name, command=command, weights=rows)


def files(name: str, reduced: Reduced, command: str) -> dict[str, str]:
    """The C data of a case by path."""
    return {
        f"lib/plants/cavity_{name}_data.c": model(name, reduced, command),
        f"sim/flow_weights_{name}.c": weights(name, reduced, command),
    }


def text(reduced: Reduced, command: str) -> str:
    """The model as YAML."""
    import yaml

    found = {
        "modes": [basis.count for basis in reduced.bases],
        "energy": [float(basis.energy[basis.count - 1]) for basis in reduced.bases],
        "A": reduced.A.tolist(),
        "d": reduced.d.tolist(),
        "quadratic": [list(term) for term in terms(reduced.F)],
        "sensors": [
            {"cell": list(cell), "C": rows.tolist()}
            for cell, rows in zip(SENSORS, reduced.C, strict=True)
        ],
        "starts": reduced.starts.tolist(),
    }
    head = (
        f"# {command}\n# x' = d + A x + q(x); quadratic: [k, i, j, value], q_k has value x_i x_j."
        "\n# starts: projected initial states of the test run and the runs of the snapshots.\n"
    )
    dumped: str = yaml.safe_dump(found, sort_keys=False, default_flow_style=None, width=100)
    return head + dumped


def save(path: Path, flow: Flow, fields: list[Floats]) -> None:
    """Write snapshots of velocity, contaminant and temperature as u, v, c, T."""
    n = flow.n
    pairs = [flow.components(w) for w in fields[0]]
    np.savez_compressed(
        path,
        u=np.array([u for u, _ in pairs]),
        v=np.array([v for _, v in pairs]),
        c=fields[1].reshape(-1, n, n),
        T=fields[2].reshape(-1, n, n),
    )


def load(path: Path, forced: bool, library: Path | None = None) -> tuple[Flow, list[Floats]]:
    """Snapshots as `save` writes them, and the flow on their cells; UserError."""
    try:
        with np.load(path) as file:
            u, v, c, T = (np.asarray(file[name], dtype=float) for name in "uvcT")  # noqa: N806
    except (OSError, ValueError, KeyError) as error:
        raise UserError(f"{path}: not an .npz file with u, v, c and T ({error})") from None
    m, n = len(c), c.shape[-1]
    if (u.shape, v.shape, c.shape, T.shape) != (
        (m, n + 1, n),
        (m, n, n + 1),
        (m, n, n),
        (m, n, n),
    ):
        raise UserError(
            f"{path}: u {u.shape}, v {v.shape}, c {c.shape}, T {T.shape} are not on the same cells"
        )
    if n < 1 + max(max(cell) for cell in SENSORS):
        raise UserError(f"{path}: {n} x {n} cells do not have the sensors' cells")
    w = np.hstack([u.reshape(m, -1), v.reshape(m, -1)])
    return Flow(forced, n, library), [w, c.reshape(m, -1), T.reshape(m, -1)]


def write(path: Path, text: str) -> None:
    """Write a file."""
    path.write_text(text, encoding="utf-8")


def _render(template: str, **values: object) -> str:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("dse"),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters["numbers"] = lambda v: "\n".join(_lines(np.ravel(v), "DSE_REAL({})"))
    environment.filters["doubles"] = lambda v: "\n".join(_lines(np.ravel(v), "{}"))
    return environment.get_template(template).render(**values)


def _lines(values: Floats, form: str) -> Iterator[str]:
    """Literals that are these doubles exactly, in lines of at most 100 characters."""
    line = "   "
    for value in values:
        literal = form.format(repr(float(value))) + ","
        if len(line) + 1 + len(literal) > 100:
            yield line
            line = "   "
        line += " " + literal
    yield line
