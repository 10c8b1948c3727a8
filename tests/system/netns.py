"""Network namespaces: hosts of a test's own, with routes, cables and losses of its own."""

import ctypes
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from typing import IO

import pytest

_number = count()


def run(*arguments: object, inside: str | None = None) -> None:
    """Run a command that must succeed; `inside`: in that namespace."""
    words = [str(argument) for argument in arguments]
    if inside is not None:
        words = ["ip", "netns", "exec", inside, *words]
    subprocess.run(words, check=True, capture_output=True, text=True, timeout=60)


def _why_not() -> str | None:
    """Why namespaces cannot be made here; None if they can."""
    name = f"dse-try-{os.getpid()}"
    try:
        run("ip", "netns", "add", name)
        run("ip", "netns", "del", name)
        run("nft", "--version")
    except FileNotFoundError as error:
        return f"{error.filename} is not installed"
    except subprocess.CalledProcessError as error:
        return f"network namespaces need root: {error.stderr.strip()}"
    return None


_reason = _why_not()
needs_namespaces = pytest.mark.skipif(_reason is not None, reason=_reason or "")


@contextmanager
def namespaces(how_many: int) -> Iterator[list[str]]:
    """So many namespaces without any network."""
    names = [f"dse-{os.getpid()}-{next(_number)}" for _ in range(how_many)]
    made = []
    try:
        for name in names:
            run("ip", "netns", "add", name)
            made.append(name)
        yield names
    finally:
        for name in made:
            run("ip", "netns", "del", name)


@contextmanager
def entered(name: str) -> Iterator[None]:
    """Sockets that this thread makes in the block belong to the namespace."""
    libc = ctypes.CDLL(None, use_errno=True)

    def enter(place: IO[str]) -> None:
        if libc.setns(place.fileno(), 0) != 0:
            raise OSError(ctypes.get_errno(), f"cannot enter {place.name}")

    with open("/proc/thread-self/ns/net") as home, open(f"/run/netns/{name}") as there:
        enter(there)
        try:
            yield
        finally:
            enter(home)


def bring_up_loopback(name: str) -> None:
    """Loopback with multicast."""
    run("ip", "link", "set", "lo", "up", "multicast", "on", inside=name)
    run("ip", "route", "add", "224.0.0.0/4", "dev", "lo", inside=name)


def lose(name: str, percent: int) -> None:
    """Drop that share of the arriving UDP datagrams at random."""
    run("nft", "add", "table", "inet", "trouble", inside=name)
    hook = "{ type filter hook input priority 0; }"
    run("nft", "add", "chain", "inet", "trouble", "in", hook, inside=name)
    rule = f"meta l4proto udp numgen random mod 100 < {percent} counter drop"
    run("nft", "add", "rule", "inet", "trouble", "in", *rule.split(), inside=name)


def lost(name: str) -> int:
    """How many datagrams were dropped so far."""
    words = ["ip", "netns", "exec", name, "nft", "list", "table", "inet", "trouble"]
    told = subprocess.run(words, check=True, capture_output=True, text=True, timeout=60).stdout
    return int(told.partition("counter packets ")[2].split()[0])


def join_with_cable(first: str, second: str) -> None:
    """Two hosts on one Ethernet, multicast over it."""
    run("ip", "link", "add", "cable", "netns", first, "type", "veth", "peer", "name", "cable",
        "netns", second)  # fmt: skip
    for number, name in enumerate((first, second), 1):
        run("ip", "link", "set", "lo", "up", inside=name)
        run("ip", "addr", "add", f"10.9.8.{number}/24", "dev", "cable", inside=name)
        run("ip", "link", "set", "cable", "up", inside=name)
        run("ip", "route", "add", "224.0.0.0/4", "dev", "cable", inside=name)
