"""What the scenarios of the adaptive high-gain EKF claim, checked on the logs of their runs.

One row per claim: scenario, changes, what is claimed and the condition, on the numbers that
`dse report --json` prints and, where the course in time matters, on the logged diagnostics. The
numbers in the rows are those of an independent implementation with the same tuning.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness import Stage, inproc, tool

from dse.log import read
from dse.run import Floats, Run

QUIET = ("noise.process.distribution=none", "noise.measurement.distribution=none")
NOISY: tuple[str, ...] = ()
"""As the scenario says."""
LATE = 0.4
"""The late part: the last 0.2 h of 0.5 h."""
TOLERANCE = 0.02
"""For the numbers of the independent implementation, which are given with two or three digits."""


@dataclass
class Outcome:
    """A run of a scenario: its log and what `dse report --json` says of it."""

    log: Path
    report: dict[str, Any]

    @cached_property
    def run(self) -> Run:
        """The run itself, for courses in time."""
        return read(self.log)

    def rmse(self, network: str, *states: str) -> Floats:
        """Root mean square error of the whole run per state; no names: all states."""
        return self._numbers("rmse", network, states)

    def late(self, network: str, *states: str) -> Floats:
        """Root mean square error of the late part per state."""
        return self._numbers("late_rmse", network, states)

    def _numbers(self, what: str, network: str, states: tuple[str, ...]) -> Floats:
        known = self.report["networks"][network]["states"]
        return np.array([known[name][what] for name in states or known])

    def course(self, network: str, diagnostic: str) -> tuple[Floats, Floats]:
        """Times (K,) in the plant's unit and a diagnostic of all nodes (K, nodes)."""
        nodes = self.run.network(network).nodes
        columns = []
        for node in nodes:
            names = [signal.name for signal in node.diagnostics]
            columns.append(node.estimates.diagnostic[:, names.index(diagnostic)])
        return nodes[0].estimates.time, np.stack(columns, axis=1)


@dataclass(frozen=True)
class Claim:
    """A row of the table."""

    scenario: str
    changes: tuple[str, ...]
    text: str
    holds: Callable[[Outcome], Any]


def near(found: Floats, *expected: float) -> bool:
    """Whether these are the numbers of the independent implementation."""
    return bool(np.allclose(found, expected, rtol=TOLERANCE))


def rises_within_15_s(run: Outcome) -> bool:
    """Theta of every filter comes close to 2 theta_m = 40 in the first 15 s."""
    hours, theta = run.course("ahg", "theta")
    return bool((theta[hours <= 15 / 3600].max(axis=0) > 39).all())


def returns_after_250_s(run: Outcome) -> bool:
    """Theta of every filter stays near 1 once the estimates are right, from 0.07 h on."""
    hours, theta = run.course("ahg", "theta")
    return bool((theta[hours > 0.07] < 2).all())


def innovation_peaks_at_the_horizon(run: Outcome) -> bool:
    """J grows as long as its horizon, 0.02 h, still begins at the wrong initial guess: to 47.0."""
    hours, innovation = run.course("ahg", "J driving theta")
    peak = innovation.argmax(axis=0)
    return bool(
        np.allclose(hours[peak], 0.02, atol=2 / 3600)
        and np.allclose(innovation.max(axis=0), 47.0, rtol=TOLERANCE)
    )


def is_permanently(value: float) -> Callable[[Outcome], bool]:
    """Theta of the network `permanent` never changes."""
    return lambda run: bool((run.course("permanent", "theta")[1] == value).all())


C, T = ("C1", "C2"), ("T1", "T2")
CLAIMS = [
    Claim("ahg-43", QUIET, "the adaptive filter's error is below half of the EKF's, every state",
          lambda run: run.rmse("ahg") < 0.5 * run.rmse("ekf")),
    Claim("ahg-43", QUIET, "theta is above 39 within 15 s", rises_within_15_s),
    Claim("ahg-43", QUIET, "theta is below 2 after 0.07 h", returns_after_250_s),
    Claim("ahg-43", QUIET, "J peaks where its horizon ends", innovation_peaks_at_the_horizon),
    Claim("ahg-43", QUIET, "the numbers of the independent implementation",
          lambda run: near(run.rmse("ahg", *T), 3.5, 3.1)
          and near(run.rmse("ahg", *C), 2.09, 1.77)
          and near(run.rmse("ekf", *T), 15.5, 12.8)
          and near(run.rmse("ekf", *C), 7.54, 5.56)),
    Claim("ahg-43", NOISY, "below half of the EKF's error under noise as well",
          lambda run: run.rmse("ahg") < 0.5 * run.rmse("ekf")),
    Claim("ahg-43", NOISY, "theta is above 39 within 15 s under noise", rises_within_15_s),
    Claim("ahg-44", NOISY, "a 36 s hold is worse in the late concentrations than continuous",
          lambda run: run.late("hold36", *C) > run.late("continuous", *C)),
    Claim("ahg-44", NOISY, "a hold still tracks: late temperatures below a fifth of before",
          lambda run: run.late("hold36", *T) < 0.2 * np.array([36, 32])),
    Claim("ahg-44", NOISY, "the loss is above all in the concentrations",
          lambda run: (run.late("hold36", *C) / run.late("continuous", *C)).min()
          > (run.late("hold36", *T) / run.late("continuous", *T)).max()),
    Claim("ahg-44", NOISY, "a predictor gives back most of what the hold costs",
          lambda run: run.late("predictor36", *C) < 0.25 * run.late("hold36", *C)),
    Claim("ahg-44", NOISY, "the numbers of the independent implementation",
          lambda run: near(run.late("hold36", *C), 13.8, 11.1)
          and near(run.late("continuous", *C), 0.67, 0.52)
          and near(run.late("predictor36", *C), 2.5, 2.0)),
    Claim("ahg-44", NOISY, "one exchange per tick takes a quarter of the messages of four stages",
          lambda run: run.report["networks"]["tick"]["messages"]
          <= 0.26 * run.report["networks"]["continuous"]["messages"]),
    Claim("ahg-45", NOISY, "theta is 16 throughout", is_permanently(16)),
    Claim("ahg-45", NOISY, "a permanent gain more than doubles the late error of concentrations",
          lambda run: run.late("permanent", *C) > 2 * run.late("ahg", *C)),
    Claim("ahg-45", NOISY, "a permanent gain is better in the late temperatures",
          lambda run: run.late("permanent", *T) < run.late("ahg", *T)),
]  # fmt: skip


@pytest.fixture(scope="module")
def outcomes(shared: Stage) -> Callable[[Claim], Outcome]:
    """Each run that the claims need, once."""
    known: dict[tuple[str, tuple[str, ...]], Outcome] = {}

    def of(claim: Claim) -> Outcome:
        key = claim.scenario, claim.changes
        if key not in known:
            changes = [word for change in claim.changes for word in ("--set", change)]
            log = shared.folder / f"{len(known)}-{claim.scenario}.lcm"
            inproc(shared, log, *changes, scenario=claim.scenario)
            told = shared.run(tool("dse"), "report", log, "--json", "--late", LATE).with_code(0)
            known[key] = Outcome(log, json.loads(told.out))
        return known[key]

    return of


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: f"{claim.scenario}: {claim.text}")
def test_claim(claim: Claim, outcomes: Callable[[Claim], Outcome]) -> None:
    outcome = outcomes(claim)
    numbers = {
        name: {
            state: (round(found["rmse"], 3), round(found["late_rmse"], 3))
            for state, found in network["states"].items()
        }
        for name, network in outcome.report["networks"].items()
    }
    assert np.all(claim.holds(outcome)), f"(rmse, late rmse): {numbers}"


def test_the_claims_judge_whole_runs(outcomes: Callable[[Claim], Outcome]) -> None:
    """1800 samples, none missing, every estimate healthy: the numbers are of what they say."""
    for claim in CLAIMS:
        outcome = outcomes(claim)
        assert outcome.report["run"]["samples"] == 1800
        assert not outcome.report["log"]["lost"]
        for network in outcome.report["networks"].values():
            for node in network["nodes"]:
                assert node["estimates"] == 1800
                assert node["missing"] == node["nonfinite"] == 0
                assert node["health"]["diverged"] == 0
