"""Conditions and ultimate bounds of the high-gain filter's theorems, from a file of constants.

FILE.yaml gives one constant per line, name: number. A theorem is evaluated when all its constants
are there. A condition that does not hold is shown with its numbers as NOT SATISFIED; the theorem
then promises nothing, and no bound is printed.

The theorems are sufficient and very conservative (exponentials of Lipschitz constants): a filter
whose constants satisfy none of them may work well. They are of use for what makes a bound grow.
"""

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from dse.design import theorems
from dse.errors import UserError, unknown
from dse.tables import console, number, table

NAME = "bounds"
HELP = "conditions and bounds of the theorems on the high-gain filter"


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("file", metavar="FILE.yaml", type=Path, help="constants")
    lines = "\n".join(f"  {name:<10} {text}" for name, text in theorems.MEANINGS.items())
    example = Path(__file__).parent / "examples" / "bounds.yaml"
    parser.epilog = (
        f"constants, in units of the plant's time and of the coordinates z:\n{lines}\n\n"
        f"Example: {example}"
    )


def run(options: argparse.Namespace) -> int:
    """Print every theorem."""
    out = console()
    for result in theorems.evaluate(read(options.file)):
        if result.missing:
            out.print(f"{result.theorem}\n  not evaluated, needs {', '.join(result.missing)}\n")
            continue
        word = "satisfied" if result.satisfied else "NOT SATISFIED"
        made = table(f"{result.theorem}: {word}", "", "value", "must exceed", "", left=1)
        for one in result.conditions:
            verdict = "yes" if one.satisfied else "no"
            made.add_row(one.what, number(one.value), number(one.limit), verdict)
        for what, value in result.bounds.items():
            made.add_row(what, number(value), "", "")
        out.print(made)
    return 0


def read(path: Path) -> dict[str, float]:
    """Constants of a YAML file; UserError says what is wrong."""
    import yaml

    try:
        found: Any = yaml.safe_load(path.read_text())
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: {' '.join(str(error).split())}") from None
    if not isinstance(found, dict):
        raise UserError(f"{path}: must hold lines of the form name: number")
    problem = next(_problems(found), None)
    if problem:
        raise UserError(f"{path}: {problem}")
    return {name: float(value) for name, value in found.items()}


def _problems(found: dict[Any, Any]) -> Iterator[str]:
    for name, value in found.items():
        if name not in theorems.MEANINGS:
            yield str(unknown("constant", str(name), theorems.MEANINGS))
        elif isinstance(value, bool) or not isinstance(value, int | float):
            # YAML 1.1 takes 1e-3 for a text: a number with an exponent needs a point
            hint = (
                ", YAML wants a point: 1.0e-3" if isinstance(value, str) and _number(value) else ""
            )
            yield f"{name}: {value!r} is not a number{hint}"
        elif not math.isfinite(value) or value < 0:
            yield f"{name}: {value} must be a number that is not negative"
        elif name in ("R_min", "S_min", "S_max", "n", "n_y", "n_star") and value == 0:
            yield f"{name}: must be positive"
    if float(found.get("S_min", 0)) > float(found.get("S_max", math.inf)):
        yield f"S_min {found['S_min']} is larger than S_max {found['S_max']}"
    if float(found.get("theta_min", 1)) < 1 or float(found.get("theta_m", 1)) < 1:
        yield "theta_min and theta_m are at least 1"


def _number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
