"""Fixtures shared by the tests."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest
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
