"""Runs a scenario over values of its keys and over seeds."""

import itertools
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from dse.errors import UserError
from dse.log import read
from dse.run import Run

T = TypeVar("T")
BUILT = Path("build") / "release" / "bin"


@dataclass(frozen=True)
class Variation:
    """A key and the values it takes."""

    key: str
    values: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> "Variation":
        """KEY=V1,V2,..; commas within brackets belong to a value."""
        key, equals, rest = text.partition("=")
        values, depth, start = [], 0, 0
        for k, character in enumerate(rest + ","):
            depth += (character in "[{") - (character in "]}")
            if character == "," and depth == 0:
                values.append(rest[start:k].strip())
                start = k + 1
        if not key or not equals or not all(values) or depth:
            raise UserError(f"--vary {text}: expected KEY=VALUE,VALUE,..")
        return cls(key.strip(), tuple(values))


Case = tuple[tuple[str, str], ...]
"""One choice of key and value for each variation; empty: the scenario as it is."""


def cases(variations: Sequence[Variation]) -> list[Case]:
    """All combinations."""
    choices = [[(one.key, value) for value in one.values] for one in variations]
    return list(itertools.product(*choices))


def find_program(given: str | None) -> str:
    """The program dse-run: --bin (file or folder), $PATH, or the build beside this package."""
    name = "dse-run"
    if given is not None:
        path = Path(given) / name if Path(given).is_dir() else Path(given)
        if not os.access(path, os.X_OK) or path.is_dir():
            raise UserError(f"--bin {given}: there is no program {path}")
        return str(path)
    places = [os.environ.get("PATH", ""), BUILT, Path(__file__).resolve().parents[3] / BUILT]
    for place in places:
        found = shutil.which(name, path=str(place))
        if found:
            return found
    raise UserError(f"{name} is neither in $PATH nor in {BUILT}: give its place with --bin")


@dataclass(frozen=True)
class Job:
    """A run of the scenario."""

    scenario: str
    overrides: tuple[str, ...]
    """KEY=VALUE as dse-run --set takes them."""
    seed: int | None


def run_all(program: str, jobs: Sequence[Job], measure: Callable[[Run], T]) -> list[T]:
    """What `measure` makes of each run's log, in the order of the jobs."""
    with TemporaryDirectory(prefix="dse-tune-") as folder:

        def one(numbered: tuple[int, Job]) -> Path:
            log = Path(folder) / f"{numbered[0]}.lcm"
            _run(program, numbered[1], log)
            return log

        results = []
        with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
            # Logs are read here, one after the other, while others are written.
            for log in pool.map(one, enumerate(jobs)):
                results.append(measure(read(log)))
                log.unlink()
        return results


def _run(program: str, job: Job, log: Path) -> None:
    command = [program, job.scenario, "--inproc", "--quiet", "--log", str(log)]
    command += [word for override in job.overrides for word in ("--set", override)]
    if job.seed is not None:
        command += ["--seed", str(job.seed)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise UserError(f"{program}: {error.strerror}") from None
    if done.returncode != 0:
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        said = lines[-1] if lines else f"exit code {done.returncode}"
        what = " ".join(job.overrides)
        raise UserError(f"{said}{f' ({what})' if what and what not in said else ''}")


def settings(run: Run) -> dict[str, Any]:
    """The scenario of a run with its overrides applied."""
    import yaml

    tree: Any = yaml.safe_load(str(run.scenario.get("yaml") or "")) or {}
    for override in run.scenario.get("overrides") or []:
        key, _, value = str(override).partition("=")
        _put(tree, re.findall(r"[^.\[\]]+", key), yaml.safe_load(value))
    return tree if isinstance(tree, dict) else {}


def _put(tree: Any, steps: list[str], value: Any) -> None:  # noqa: ANN401 - YAML
    """Set what a key of dse-run --set leads to; entries of lists go by index or name."""
    for step in steps[:-1]:
        if isinstance(tree, list):
            tree = tree[_entry(tree, step)]
        else:
            tree = tree.setdefault(step, {})
    if isinstance(tree, list):
        tree[_entry(tree, steps[-1])] = value
    else:
        tree[steps[-1]] = value


def _entry(entries: list[Any], step: str) -> int:
    names = [entry.get("name") if isinstance(entry, dict) else None for entry in entries]
    return names.index(step) if step in names else int(step)
