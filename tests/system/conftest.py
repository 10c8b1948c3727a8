"""Fixtures of the system tests."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

if "DSE_BIN" not in os.environ:
    pytest.exit("DSE_BIN must name the folder of the built programs: run them with ctest", 2)

from harness import Stage, free_port, nobody_left, url_of


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    """A stage for what all tests of a module need."""
    made = Stage(tmp_path_factory.mktemp("shared"))
    yield made
    made.close()


@pytest.fixture
def url() -> Iterator[str]:
    """A bus of the test's own; no process may stay behind on it."""
    made = url_of(free_port())
    yield made
    nobody_left(made)


@pytest.fixture
def stage(tmp_path: Path, url: str) -> Iterator[Stage]:
    """Starts processes and ends those that a test leaves, before the bus is looked at."""
    assert url
    made = Stage(tmp_path)
    yield made
    made.close()
