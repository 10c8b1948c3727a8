"""Is every state of a scenario's plant seen by its outputs? By linearisation at operating points.

    x' = A x,  y = C x  around a point;    rank [C; CA; ..; CA^(n-1)]

States count in units of their scales, and every row is brought to length one, so that the singular
values compare: the smallest says how well the state that is seen least is seen. The points are the
plant's initial state and the guess of each network, and those given with --at. Inputs are those of
the scenario at the start, parameters those of its plant or of a --network.Of the plant
called linear, also a time-varying one, every sensor group is judged alone, as distributed filters
need it, by the Gramian over a period of A(t) or a few time constants, and whether process noise
reaches all states. Exit code 1 when a point, or a group, is not observable.
"""

import argparse
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dse.design.linear_windows import judge, window
from dse.design.scenario_file import ScenarioPlant, document, load
from dse.errors import UserError, unknown
from dse.plants import ModelError
from dse.run import Floats
from dse.tables import console, number, table

NAME = "observability"
HELP = "does a scenario's plant show all its states"

RANK = 1e-9
"""A singular value below this part of the largest counts as zero."""
SHARE = 0.5
"""States with at least this part of the largest component are named."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("scenario", metavar="SCENARIO", help="YAML file, or its beginning: ahg-61")
    parser.add_argument(
        "--at",
        metavar="STATE=VALUE,..",
        action="append",
        default=[],
        help="another point: the initial state with these changes; may be repeated",
    )
    parser.add_argument(
        "--outputs", metavar="NAMES", help="only these outputs are measured, as y1,y3"
    )
    parser.add_argument(
        "--network", metavar="NAME", help="the model as this network of estimators has it"
    )
    parser.add_argument(
        "--library", metavar="FILE", help="libdse_plants.so, default the newest below build/"
    )


@dataclass
class Seen:
    """What a point shows."""

    singular: Floats
    """(n,) descending."""
    weakest: dict[str, float]
    """States along the direction that is seen least, with their components, largest first."""
    eigenvalues: NDArray[np.complex128]
    """(n,) by real part."""

    @property
    def rank(self) -> int:
        """Number of singular values that are not zero."""
        return int((self.singular > RANK * self.singular[0]).sum())


def seen(A: Floats, C: Floats, scale: Floats, names: list[str]) -> Seen:  # noqa: N803
    """The observability matrix of (A, C), states in units of `scale`, rows of length one."""
    A, C = A * scale / scale[:, None], C * scale  # noqa: N806
    block, rows = C, []
    for _ in range(len(A)):
        length = np.linalg.norm(block, axis=1, keepdims=True)
        block = block / np.where(length > 0, length, 1)
        rows.append(block)
        block = block @ A
    _, singular, directions = np.linalg.svd(np.vstack(rows))
    # of a space that is not seen at all, every direction counts
    blind = np.flatnonzero(singular <= RANK * singular[0])
    part = np.linalg.norm(directions[blind if len(blind) else [-1]], axis=0)
    order = np.argsort(-part)
    weakest = {names[k]: float(part[k]) for k in order if part[k] >= SHARE * part.max()}
    values = np.asarray(np.linalg.eigvals(A), dtype=np.complex128)
    return Seen(singular, weakest, values[np.argsort(values.real)])


def run(options: argparse.Namespace) -> int:
    """A line per point; of a linear plant, a line per kind of sensor group."""
    text = document(options.scenario)
    if text["plant"]["name"] == "linear":
        return _linear(options, text)
    scenario = load(options.scenario, options.library)
    plant = scenario.plant
    values = scenario.values
    if options.network:
        if options.network not in scenario.believed:
            raise unknown("network", options.network, scenario.believed)
        values = scenario.believed[options.network]
    measured = _measured(scenario, options.outputs)
    out = console()
    made = table("Observability", "point", "rank", "singular values", "seen least", left=4)
    made.add_column("eigenvalues [1/time]")
    blind = []
    for name, x in _points(scenario, options.at).items():
        try:
            A = plant.evaluate("dfdx", values, x, scenario.u)  # noqa: N806
            C = plant.evaluate("dhdx", values, x, scenario.u)[measured]  # noqa: N806
        except ModelError as error:
            raise UserError(f"{scenario.path}: at {name}: {error}") from None
        names = [state.name for state in plant.states]
        found = seen(A, C, np.array([state.scale for state in plant.states]), names)
        made.add_row(
            name,
            f"{found.rank} of {len(x)}",
            "  ".join(f"{value:.2f}" for value in found.singular),
            ", ".join(f"{state} ({part:.2f})" for state, part in found.weakest.items()),
            "  ".join(_eigenvalue(value) for value in found.eigenvalues),
        )
        if found.rank < len(x):
            blind.append(
                f"not observable at {name}: the outputs do not show {' and '.join(found.weakest)}"
            )
    out.print(made)
    for line in blind:
        out.print(line)
    return 1 if blind else 0


def _linear(options: argparse.Namespace, text: dict[str, Any]) -> int:
    """Every sensor group alone, over a window; whether process noise reaches all states."""
    if options.at or options.outputs or options.network:
        raise UserError("--at, --outputs, --network: a linear plant is the same at every point")
    noise = (text.get("noise") or {}).get("process")
    try:
        found = window(text["plant"]["linear"])
        scale = None if noise is None else np.array(noise["scale"], dtype=float)
        excited = None if scale is None else judge(found.excited(scale**2), found.names)
    except (KeyError, TypeError, ValueError, np.linalg.LinAlgError) as error:
        raise UserError(
            f"{options.scenario}: plant.linear: {error}; see dse-run --dry-run"
        ) from None
    n, unit = len(found.names), "samples" if found.discrete else "s"
    title = f"Each sensor group alone, over {number(found.length)} {unit}"
    made = table(title, "sensor groups", "rank", "smallest to largest", "seen least", left=1)
    blind = []
    kinds: dict[bytes, list[int]] = {}
    for i, rows in enumerate(found.groups):
        kinds.setdefault(rows.tobytes(), []).append(i)
    for members in kinds.values():
        rank, share, weakest = judge(found.gramian(found.groups[members[0]]), found.names)
        who = ", ".join(map(str, members))
        made.add_row(who, f"{rank} of {n}", number(share), weakest)
        if rank < n:
            blind.append(f"not observable by sensor groups {who}: {weakest}")
    if excited is not None and excited[0] < n:
        blind.append(f"process noise does not reach {excited[2]}: gains there go to zero")
    out = console()
    out.print(made)
    grow = ", ".join(number(value) for value in found.multipliers)
    out.print(f"over that window the plant's free motions change by the factors {grow}")
    for line in blind:
        out.print(line)
    return 1 if blind else 0


def _eigenvalue(value: complex) -> str:
    real = f"{value.real:.1f}".replace("-0.0", "0.0")
    return real if abs(value.imag) < 1e-9 * (1 + abs(value)) else f"{real}{value.imag:+.1f}i"


def _measured(scenario: ScenarioPlant, names: str | None) -> list[int]:
    known = [output.name for output in scenario.plant.outputs]
    wanted = names.split(",") if names else known
    for name in wanted:
        if name not in known:
            raise unknown("output", name, known)
    return [known.index(name) for name in wanted]


def _points(scenario: ScenarioPlant, changes: list[str]) -> dict[str, Floats]:
    plant = scenario.plant
    names = [state.name for state in plant.states]
    points: dict[str, Floats] = {"the initial state": scenario.x0}
    for network, guess in scenario.guesses.items():
        if not any(np.array_equal(guess, x) for x in points.values()):
            points[f"the guess of {network}"] = guess
    for text in changes:
        x = scenario.x0.copy()
        for part in text.split(","):
            name, _, value = part.partition("=")
            if name not in names:
                raise unknown("state", name, names)
            try:
                x[names.index(name)] = float(value)
            except ValueError:
                raise UserError(f"--at {text}: '{value}' is not a number") from None
        points[text] = x
    return points
