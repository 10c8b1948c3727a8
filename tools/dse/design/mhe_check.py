"""Will coordinated moving horizon estimation work? Before it is run, for every window length.

For each network with a section `coordinated_mhe` (or for a file with A, C, blocks, Q, R, Hp):

  existence     Psi > 0, and Omega_ii > 0 for each subsystem by itself: without it no scheme runs
  prediction    rho_L < 1: the iteration that is run converges, by this factor a round; the coupling
                may grow by 1/rho_L; `consistent` is the recursion of the source's theorem
  price         condition on D (smallest eigenvalue of M_x positive), condition number of the dual;
                without D the scheme is singular

Start-up windows count as well as the full one. Exit code 1 when something does not hold.

For example

    dse design mhe-check cdm-e1
    dse design mhe-check plant.yaml --horizons 3,10,25 --first 0.2
    dse design mhe-check cdm-e4 --active xA3@0      the oldest xA3 of the window stays at its bound
    dse design mhe-check cdm-e4 --active each       every state, at every place, one at a time
"""

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dse.design.certificates import Certificate, certify, iteration_map, radius
from dse.design.mhe_file import Scheme, schemes
from dse.design.window import Model, Window, window
from dse.errors import UserError, unknown
from dse.tables import console, number, table

NAME = "mhe-check"
HELP = "existence and convergence of coordinated moving horizon estimation"

WORST_CONDITION = 1e12
"""Of the dual's Hessian: beyond, prices lose all their digits."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("file", metavar="FILE", help="scenario, or YAML or JSON with matrices")
    parser.add_argument("--network", metavar="NAME", help="only this one")
    parser.add_argument("--horizons", metavar="H,H,..", help="default: Hmin to Hp")
    parser.add_argument(
        "--coupling", metavar="GAMMA", type=float, default=1.0, help="multiply all interactions"
    )
    parser.add_argument(
        "--first",
        metavar="NORM",
        type=float,
        default=1.0,
        help="change of X in the first round, for the expected number of rounds (default 1)",
    )
    parser.add_argument(
        "--active",
        metavar="STATE@PLACE,..|each",
        help="states held at a bound, w:STATE@PLACE for disturbances; place 0 is the oldest",
    )
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, help="all numbers as YAML")
    parser.add_argument(
        "--library", metavar="FILE", help="libdse_plants.so, default the newest below build/"
    )


def run(options: argparse.Namespace) -> int:
    """Tables, warnings, and the file."""
    import yaml

    found = schemes(options.file, options.library)
    if options.network:
        names = [one.name for one in found]
        if options.network not in names:
            raise unknown("network", options.network, names)
        found = [one for one in found if one.name == options.network]
    out, failed, written = console(), False, {}
    for scheme in _distinct(found):
        scheme.model = scheme.model.coupled(options.coupling)
        certificates = [
            certify(window(scheme.model, H), scheme.beta) for H in _lengths(options, scheme)
        ]
        _show(out, scheme, certificates, options.first)
        warnings = [
            line for one in certificates for line in warnings_of(scheme, one, options.coupling)
        ]
        if options.active:
            held = list(_active(scheme, options.active, certificates[-1].H))
            warnings += _show_active(out, held)
            written[scheme.name] = {"active": [_plain(one) for one in held]}
        for line in warnings:
            out.print(f"WARNING: {line}")
        failed = failed or bool(warnings)
        windows = [_plain(vars(one)) for one in certificates]
        written[scheme.name] = {"windows": windows, **written.get(scheme.name, {})}
    if options.output:
        options.output.write_text(yaml.safe_dump(written, sort_keys=False))
    return 1 if failed else 0


def _distinct(found: list[Scheme]) -> Iterator[Scheme]:
    """Networks with the same model, weights and windows once, under all their names."""
    seen: dict[Any, Scheme] = {}
    for one in found:
        m = one.model
        numbers = [m.A, m.C, m.Q, m.R, m.D, m.arrival]
        parts = tuple(None if value is None else value.tobytes() for value in numbers)
        key = (*parts, tuple(m.states), one.Hp, one.Hmin, one.beta)
        if key in seen:
            seen[key].name += f", {one.name}"
            seen[key].kinds |= one.kinds
        else:
            seen[key] = one
    yield from seen.values()


def _lengths(options: argparse.Namespace, scheme: Scheme) -> list[int]:
    if not options.horizons:
        return list(range(max(2, scheme.Hmin), max(2, scheme.Hp) + 1))
    try:
        found = [int(text) for text in options.horizons.split(",")]
    except ValueError:
        raise UserError(f"--horizons {options.horizons}: not whole numbers") from None
    if min(found) < 2:
        raise UserError("--horizons: a window has two samples at least")
    return found


def warnings_of(scheme: Scheme, one: Certificate, coupling: float = 1.0) -> Iterator[str]:
    """What does not hold for a window length, with the numbers."""
    who = f"{scheme.name}, H = {one.H}"
    for i, (good, value) in enumerate(zip(one.exists_local, one.min_eig_Omega, strict=True)):
        if not good:
            yield (
                f"{who}: subsystem {i + 1} is not observable from its own outputs"
                f" (smallest eigenvalue of Omega {value:.3g})"
            )
    if not one.exists:
        value = one.min_eig_Psi
        yield f"{who}: the plant is not observable (smallest eigenvalue of Psi {value:.3g})"
    if (not scheme.kinds or "prediction" in scheme.kinds) and one.rho_relaxed >= 1:
        yield (
            f"{who}: rho_L = {one.rho_relaxed:.4g} is not below 1, the prediction-driven iteration"
            f" diverges; the coupling must be below {coupling * one.admissible_coupling:.4g} times"
            f" what it is"
        )
    if "price" in scheme.kinds and one.min_eig_M_x is None and all(one.exists_local):
        states, outputs = scheme.model.states, scheme.model.outputs
        free = [one.H * (n - q) for n, q in zip(states, outputs, strict=True)]
        yield (
            f"{who}: price-driven without D: the local problems are singular, they lack"
            f" {', '.join(map(str, free))} ranks"
        )
    if one.min_eig_M_x is not None and not one.min_eig_M_x > 0:
        yield f"{who}: D fails its condition (smallest eigenvalue of M_x {one.min_eig_M_x:.3g})"
    if one.cond_Hd is not None and one.cond_Hd > WORST_CONDITION:
        yield f"{who}: the dual's condition number is {one.cond_Hd:.2g}, D is too large"


def _show(out: Any, scheme: Scheme, certificates: list[Certificate], first: float) -> None:  # noqa: ANN401
    columns = ["H", "min eig Omega", "min eig Psi", "min eig (Omega - Psi/2)", "rho_L"]
    columns += ["rho consistent", "coupling below", "rounds"]
    priced = scheme.model.D is not None
    made = table(
        f"{scheme.name}: {len(scheme.model.A)} states in {len(scheme.model.states)} parts",
        *columns,
        *(["min eig M_x", "cond Hd"] if priced else []),
        left=0,
    )
    for one in certificates:
        row = [
            str(one.H),
            number(min(one.min_eig_Omega)),
            number(one.min_eig_Psi),
            number(one.min_eig_test),
            number(one.rho_relaxed),
            number(one.rho_consistent),
            number(one.admissible_coupling),
            number(one.iterations(first, scheme.eps)),
        ]
        made.add_row(*row, *([number(one.min_eig_M_x), number(one.cond_Hd)] if priced else []))
    out.print(made)
    if scheme.beta < 1:
        out.print(f"rho_L under relaxation by beta = {scheme.beta:g}")


# ---- active bounds ----


def _place(w: Window, names: list[str], text: str) -> tuple[str, int]:
    """Whether of X or W, and the row there."""
    kind, _, rest = text.rpartition(":")
    name, at, place = rest.partition("@")
    if kind not in ("", "x", "w") or not at or not place.isdigit():
        raise UserError(f"--active {text}: must be STATE@PLACE or w:STATE@PLACE")
    if name not in names:
        raise unknown("state", name, names)
    of = w.w_of if kind == "w" else w.x_of
    if int(place) >= len(of):
        raise UserError(f"--active {text}: places are 0 to {len(of) - 1}")
    return ("w" if kind == "w" else "x"), int(of[int(place), names.index(name)])


def _names(model: Model) -> list[str]:
    return [model.name(j) for j in range(len(model.A))]


def _active(scheme: Scheme, text: str, H: int) -> Iterator[dict[str, Any]]:  # noqa: N803
    """Sets of active bounds with the spectral radius of the iteration under them."""
    w, names = window(scheme.model, H), _names(scheme.model)
    sets = [text.split(",")]
    if text == "each":
        sets = [[f"{name}@{place}"] for name in names for place in range(H)]
    for one in sets:
        rows: dict[str, list[int]] = {"x": [], "w": []}
        for item in one:
            kind, row = _place(w, names, item)
            rows[kind].append(row)
        try:
            rho = radius(iteration_map(w, rows["x"], rows["w"]))
        except np.linalg.LinAlgError:
            raise UserError(
                f"--active {','.join(one)}: these bounds cannot hold together"
            ) from None
        yield {"H": H, "active": ", ".join(one), "rho": rho}


def _show_active(out: Any, held: list[dict[str, Any]]) -> list[str]:  # noqa: ANN401
    """A row per set, or per state where all places were tried; the warnings."""
    if len(held) == 1:
        rows = {held[0]["active"]: [held[0]["rho"]]}
    else:
        rows = {}
        for one in held:
            rows.setdefault(one["active"].partition("@")[0], []).append(one["rho"])
    made = table(
        f"H = {held[0]['H']}, bounds that stay active", "active", "smallest rho", "largest rho"
    )
    for name, values in rows.items():
        made.add_row(name, number(min(values)), number(max(values)))
    out.print(made)
    return [
        f"with {name} at a bound rho is up to {max(values):.4g}: the plain iteration does not"
        " settle there; anderson or beta help"
        for name, values in rows.items()
        if max(values) >= 1
    ]


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """For YAML: no number that it has no word for."""

    def plain(value: Any) -> Any:  # noqa: ANN401
        if isinstance(value, float) and not math.isfinite(value):
            return None
        return [plain(one) for one in value] if isinstance(value, list | tuple) else value

    return {key: plain(value) for key, value in values.items()}
