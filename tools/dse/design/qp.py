"""OSQP's workspace for a bounded window, as C for a microcontroller.

For a linear model (a scenario with a section `coordinated_mhe`, or a file with A, C, blocks, Q, R,
Hp: see `dse design mhe-check`) the quadratic programme of a full window, of the whole plant or of
one subsystem with predicted interactions:

    min 1/2 z'Pz - c'z   over z = x_0 .. x_{H-1},   bounds on x_j and on w_j = x_{j+1} - A x_j - h_j

The folder gets OSQP's generated code and NAME.c, NAME.h: the blocks of P, the scales, and the
backend `NAME_backend` for lib/include/dse/window_qp.h. To be compiled with them:
lib/mhe/window_qp_osqp.c of the library; with -I for the folder, inc/public and inc/private.

For example

    dse design qp cdm-e4 -o generated --subsystem 1
    dse design qp plant.yaml -o generated --float --name tank
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

import dse
from dse.design.mhe_file import Scheme, schemes
from dse.design.window import Model
from dse.errors import UserError, unknown
from dse.run import Floats

NAME = "qp"
HELP = "OSQP workspace of a bounded window, as C"


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("file", metavar="FILE", help="scenario, or YAML or JSON with matrices")
    parser.add_argument("-o", "--output", metavar="FOLDER", type=Path, required=True)
    parser.add_argument("--network", metavar="NAME", help="only this one (default: the first)")
    parser.add_argument("--subsystem", metavar="I", type=int, help="from 1 (default: the whole)")
    parser.add_argument("--horizon", metavar="H", type=int, help="default: Hp")
    parser.add_argument("--float", action="store_true", help="single precision")
    parser.add_argument("--name", default="window_qp", help="of the C files and their contents")
    parser.add_argument(
        "--library", metavar="FILE", help="libdse_plants.so, default the newest below build/"
    )


def run(options: argparse.Namespace) -> int:
    """Write the folder."""
    if not options.name.isidentifier():
        raise UserError(f"--name {options.name}: not a name in C")
    scheme = _chosen(schemes(options.file, options.library), options.network)
    qp = window_qp(_part(scheme.model, options.subsystem), options.horizon or scheme.Hp)
    generate(qp, options.output, options.name, options.float)
    print(f"{options.output}: {qp.n} unknowns, {qp.m - qp.n} rows")
    return 0


def _chosen(found: list[Scheme], name: str | None) -> Scheme:
    if name is None:
        return found[0]
    names = [one.name for one in found]
    if name not in names:
        raise unknown("network", name, names)
    return found[names.index(name)]


def _part(model: Model, subsystem: int | None) -> Model:
    """One subsystem by itself, or the whole plant as one."""
    if subsystem is None:
        first, last, low, high = 0, len(model.A), 0, len(model.C)
    elif 1 <= subsystem <= len(model.states):
        first, low = sum(model.states[: subsystem - 1]), sum(model.outputs[: subsystem - 1])
        last = first + model.states[subsystem - 1]
        high = low + model.outputs[subsystem - 1]
    else:
        raise UserError(f"--subsystem {subsystem}: there are {len(model.states)}")
    own, seen = slice(first, last), slice(low, high)
    arrival = None if model.arrival is None else model.arrival[own]
    return Model(
        model.A[own, own],
        model.C[seen, own],
        [last - first],
        [high - low],
        model.Q[own],
        model.R[seen],
        arrival=arrival,
    )


@dataclass
class WindowQP:
    """A window's programme in the order of the C solver: stage by stage, oldest first."""

    H: int
    oldest: Floats
    """(nz, nz): P_00."""
    between: Floats
    newest: Floats
    below: Floats
    """(nz, nz): P_{j+1,j}."""
    E: Floats
    """(nz, nz): w_j = E x_j + x_{j+1} - h_j."""

    @property
    def nz(self) -> int:
        """Unknowns of a stage."""
        return len(self.E)

    @property
    def n(self) -> int:
        """Unknowns."""
        return self.H * self.nz

    @property
    def m(self) -> int:
        """Bounds and rows."""
        return self.n + (self.H - 1) * self.nz

    def diagonal(self, j: int) -> Floats:
        """P_jj."""
        return self.oldest if j == 0 else self.between if j + 1 < self.H else self.newest

    def P(self) -> Floats:  # noqa: N802
        """(n, n)."""
        whole = np.zeros((self.n, self.n))
        for j in range(self.H):
            own, after = _stage(j, self.nz), _stage(j + 1, self.nz)
            whole[own, own] = self.diagonal(j)
            if j + 1 < self.H:
                whole[after, own] = self.below
                whole[own, after] = self.below.T
        return whole

    def rows(self) -> Floats:
        """((H - 1) nz, n): all w_j + h_j of all x_j."""
        whole = np.zeros((self.m - self.n, self.n))
        for j in range(self.H - 1):
            whole[_stage(j, self.nz), _stage(j, self.nz)] = self.E
            whole[_stage(j, self.nz), _stage(j + 1, self.nz)] = np.eye(self.nz)
        return whole

    def scales(self) -> tuple[Floats, Floats]:
        """1 / sqrt(P_ii), and the norms of the rows in unknowns so scaled."""
        scale = 1 / np.sqrt(np.diag(self.P()))
        return scale, np.linalg.norm(self.rows() * scale, axis=1)


def _stage(j: int, nz: int) -> slice:
    return slice(j * nz, (j + 1) * nz)


def window_qp(model: Model, H: int) -> WindowQP:  # noqa: N803
    """The programme of a full window of H samples."""
    if H < 2:
        raise UserError("a window has two samples at least")
    Q, A = np.diag(1 / model.Q), model.A  # noqa: N806
    data = model.C.T @ (model.C / model.R[:, None])
    prior = 0 if model.arrival is None else np.diag(model.arrival)
    past = A.T @ Q @ A
    qp = WindowQP(H, data + past + prior, data + past + Q, data + Q, -Q @ A, -A)
    if np.linalg.eigvalsh(qp.P())[0] <= 0:
        raise UserError(f"the outputs do not determine the states over {H} samples")
    return qp


def generate(qp: WindowQP, folder: Path, name: str, single: bool) -> None:
    """OSQP's code and the glue."""
    import osqp
    import scipy.sparse as sparse

    scale, row_scale = qp.scales()
    P = sparse.triu(qp.P() * np.outer(scale, scale), format="csc")  # noqa: N806
    rows = qp.rows() * scale / row_scale[:, None]
    A = sparse.vstack([sparse.eye(qp.n), sparse.csc_matrix(rows)], format="csc")  # noqa: N806
    settings: dict[str, Any] = {
        "verbose": False,
        "eps_abs": 1e-4 if single else 1e-6,
        "eps_rel": 1e-4 if single else 1e-6,
        "max_iter": 20000,
        "adaptive_rho": False,
        "rho": _rho(P, A, qp),
    }
    solver = osqp.OSQP()
    free = np.full(qp.m, np.inf)
    solver.setup(P, np.zeros(qp.n), A, -free, free, **settings)
    solver.codegen(
        str(folder),
        parameters="vectors",
        extension_name=None,
        force_rewrite=True,
        use_float=single,
        prefix=f"{name}_",
    )
    (folder / "emosqp.c").unlink(missing_ok=True)  # its example
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("dse"), trim_blocks=True, lstrip_blocks=True, autoescape=False
    )
    environment.filters["numbers"] = lambda values: ", ".join(_numbers(values))
    for end in ("c", "h"):
        text = environment.get_template(f"qp.{end}.j2").render(
            name=name, qp=qp, scale=scale, row_scale=row_scale, version=dse.__version__
        )
        (folder / f"{name}.{end}").write_text(text)


def _rho(P: Any, A: Any, qp: WindowQP) -> float:  # noqa: ANN401, N803
    """The step size that OSQP arrives at by itself for bounds of the size of the scales."""
    import osqp

    solver = osqp.OSQP()
    ones = np.ones(qp.m)
    solver.setup(
        P, -np.ones(qp.n), A, -ones, ones, verbose=False, adaptive_rho=1, adaptive_rho_interval=50
    )
    solver.solve(raise_error=False)
    return float(solver._solver.get_settings().rho)


def _numbers(values: Floats) -> Iterator[str]:
    """Literals that are these doubles exactly."""
    for value in np.ravel(values):
        yield f"DSE_REAL({float(value)!r})"
