"""Fixtures shared by the tests."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from compiled import ROOMS, ROOT, compile_c
from synthetic import Plan, write

from dse import cli


class Outcome(NamedTuple):
    """What a command did."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:  # noqa: ANN401 - JSON
        """The output as JSON."""
        return json.loads(self.out)


Command = Callable[..., Outcome]


@pytest.fixture
def dse(capsys: pytest.CaptureFixture[str]) -> Command:
    """Runs the command dse in this process."""

    def run(*arguments: object) -> Outcome:
        capsys.readouterr()
        words: Sequence[str] = [str(argument) for argument in arguments]
        try:
            code = cli.run(words)
        except SystemExit as stop:  # argparse
            code = int(stop.code or 0)
        return Outcome(code, *capsys.readouterr())

    return run


@pytest.fixture(scope="session")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log without faults."""
    return write(tmp_path_factory.mktemp("plain") / "plain.lcm", Plan())


@pytest.fixture(scope="session")
def native(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Libdse_plants.so, compiled here."""
    where = tmp_path_factory.mktemp("native")
    sources = [ROOT / "tools" / "native" / name for name in ("plants.c", "flow.c")]
    sources += [ROOT / "sim" / f"{name}.c" for name in ("flow", "flow_operators", "flow_runs")]
    for room in ROOMS:
        sources += sorted((ROOT / "lib" / room).glob("*.c"))
    target = where / "libdse_plants.so"
    include = ["-I", str(ROOT)]
    compile_c(
        ["-DDSE_REAL_IS_double=1", "-shared", *include, *map(str, sources), "-o", str(target)],
        where,
    )
    return target


@pytest.fixture
def library(native: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same, found by the tools."""
    monkeypatch.setenv("DSE_PLANTS", str(native))
    return native
