"""What the scenarios of coordinated moving horizon estimation claim, checked on the logs of runs.

One row per claim: scenario, changes, what is claimed and the condition. Every row is checked with
two seeds, the second one under the label long. The numbers in the texts are those of an
independent implementation with other noise of the same kind.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness import Stage, inproc

from dse.evaluate import pooled_errors
from dse.log import read
from dse.run import HEALTH, Floats, Run

SEEDS = (1, pytest.param(2, marks=pytest.mark.long))
HMIN, HP = 3, 10
"""Shortest and full window; the first sample that is coordinated is HMIN - 1."""
CONVERGED, PREMATURE, SINGULAR, STARTING, DIVERGED = 1, 2, 3, 4, 6
"""Values of the coordinator's diagnostic `outcome`: enum dse_mhe_outcome."""
EQUAL = 1e-9
SEPARATOR = slice(6, 9)
"""Its states among the plant's."""


@dataclass
class Outcome:
    """A run of a scenario."""

    log: Path

    @cached_property
    def run(self) -> Run:
        """The run itself."""
        return read(self.log)

    def estimate(self, network: str) -> Floats:
        """Estimates of all states at all samples (K, n)."""
        value = np.full(self.run.truth.value.shape, np.nan)
        for node in self.run.network(network).nodes:
            value[np.ix_(node.estimates.sample, np.array(node.states, dtype=int))] = (
                node.estimates.value
            )
        return value

    def error(self, network: str, states: slice = slice(None)) -> Floats:
        """Euclidean norm of the error per sample (K,): the terms of the error sum."""
        error = pooled_errors(self.run, self.run.network(network))[:, states]
        norm: Floats = np.linalg.norm(error, axis=1)
        return norm

    def rmse(self, network: str) -> Floats:
        """Root mean square error per state."""
        error = pooled_errors(self.run, self.run.network(network))
        result: Floats = np.sqrt(np.mean(error**2, axis=0))
        return result

    def gap(self, one: str, other: str) -> Floats:
        """Largest difference of two networks' estimates per sample (K,)."""
        gap: Floats = np.abs(self.estimate(one) - self.estimate(other)).max(axis=1)
        return gap

    def gap_of_agents(self, network: str, outcome: int) -> Floats:
        """Difference to the decentralised estimates where a full window ends like this."""
        full = np.arange(len(self.run.truth.sample)) >= HP
        gap: Floats = self.gap(network, "decentralised")[full & (self.outcome(network) == outcome)]
        return gap

    def of_node(self, network: str, node: int, name: str) -> Floats:
        """A diagnostic of a node per sample (K,)."""
        found = self.run.network(network).nodes[node]
        names = [signal.name for signal in found.diagnostics]
        column: Floats = found.estimates.diagnostic[:, names.index(name)]
        return column

    def outcome(self, network: str) -> Floats:
        """What the coordinator says of its samples (K,)."""
        return self.of_node(network, -1, "outcome")

    def iterations(self, network: str) -> Floats:
        """Of all samples that are coordinated."""
        started = self.outcome(network) != STARTING
        counts: Floats = self.of_node(network, -1, "iterations")[started]
        return counts

    def uplinks(self, network: str) -> float:
        """Windows that reached the coordinator."""
        return float(self.of_node(network, -1, "windows received").sum())

    def health(self, network: str, node: int) -> set[str]:
        """What a node says of its estimates after the start."""
        estimates = self.run.network(network).nodes[node].estimates
        return {HEALTH[code] for code in estimates.health[HMIN - 1 :]}


@dataclass(frozen=True)
class Claim:
    """A row of the table."""

    scenario: str
    changes: tuple[str, ...]
    text: str
    holds: Callable[[Outcome], Any]


def converges_always(network: str) -> Callable[[Outcome], bool]:
    """Every sample ends because the agents agree."""
    return lambda run: bool(
        np.isin(run.outcome(network), (CONVERGED, STARTING)).all()
        and (run.outcome(network) == CONVERGED).sum() > 0
    )


def is_near_centralised(network: str) -> Callable[[Outcome], bool]:
    """Error sum at most 5 % above the centralised one, and below a quarter of decentralised."""
    return lambda run: bool(
        run.error(network).sum() <= 1.05 * run.error("centralised").sum()
        and run.error(network).sum() < run.error("decentralised").sum() / 4
    )


def separator_is_on_its_own(run: Outcome) -> bool:
    """Its estimate is the decentralised one, and says so."""
    gap = np.abs(run.estimate("case1") - run.estimate("decentralised"))[HMIN - 1 :, SEPARATOR]
    return bool((gap <= EQUAL).all()) and run.health("case1", 2) == {"alone"}


def others_are_better_off(run: Outcome) -> bool:
    """From k = 16 on the second reactor's error is far below the decentralised one."""
    second = slice(3, 6)
    mine, theirs = run.error("case1", second)[16:], run.error("decentralised", second)[16:]
    return bool(
        mine.sum() < 0.2 * theirs.sum()
        and run.error("case1").sum() < run.error("decentralised").sum()
    )


def ordered_by_what_is_known(run: Outcome) -> bool:
    """Over k = 16 .. 40: centralised < link lost < decentralised, by factors."""
    window = slice(16, 41)
    centralised, lost, none = (
        run.error(name)[window].sum() for name in ("centralised", "case2", "decentralised")
    )
    return bool(1.5 * centralised < lost < none / 4)


E1, E2, E3 = "cdm-e1", "cdm-e2", "cdm-e3"
MISSING = ("noise.missing=0.2",)
FINE = "networks.{}.coordinated_mhe.eps={}"
CLAIMS = [
    Claim(E1, (), "two iterations at every sample", lambda run: run.iterations("price") == 2),
    Claim(E1, ("networks.price.coordinated_mhe.price_start=zero",),
          "two iterations from any price", lambda run: run.iterations("price") == 2),
    Claim(E1, (), "the centralised estimate with the same cost of interactions (1e-11)",
          lambda run: run.gap("price", "centralised_D") <= EQUAL),
    Claim(E1, ("networks.price.coordinated_mhe.price_start=zero",),
          "the same from any price", lambda run: run.gap("price", "centralised_D") <= EQUAL),
    Claim(E1, (), "without D the scheme is singular, says so, and gives decentralised estimates",
          lambda run: (run.outcome("standard")[HMIN - 1 :] == SINGULAR).all()
          and run.health("standard", 0) == {"unobservable"}
          and (run.gap("standard", "decentralised")[HMIN - 1 :] == 0).all()),
    Claim(E1, (), "near the centralised error sum, below a quarter of the decentralised (5.4 x)",
          is_near_centralised("price")),
    Claim(E1, (), "without the first two samples even below a tenth (23 x)",
          lambda run: run.error("price")[2:].sum() < run.error("decentralised")[2:].sum() / 10),
    Claim(E2, (), "more than two iterations now and then: median 3, at most 30",
          lambda run: np.median(run.iterations("price")) == 3
          and 3 < run.iterations("price").max() <= 30),
    Claim(E2, (), "from the previous price about 11 iterations, at most 60",
          lambda run: 6 <= np.median(run.iterations("price_previous")) <= 16
          and run.iterations("price_previous").max() <= 60),
    Claim(E2, (FINE.format("price", 1e-9),),
          "the centralised estimate within the bounds, with the same cost of interactions",
          lambda run: run.gap("price", "centralised_D") <= EQUAL),
    Claim(E2, (), "bounds make the decentralised estimates worse (114.9 against 97.9)",
          lambda run: run.error("decentralised").sum() > 1.1 * run.error("unbounded").sum()),
    Claim(E2, (), "near the centralised error sum, below a quarter of the decentralised (6.8 x)",
          is_near_centralised("price")),
    Claim(E2, (), "every sample converges", converges_always("price")),
    Claim(E3, (), "the centralised estimate (1.3e-5 with eps = 1e-4)",
          lambda run: run.gap("prediction", "centralised") <= 1e-4),
    Claim(E3, (FINE.format("prediction", 1e-10),), "exactly so when iterated further; shorter "
          "windows hardly determine the concentrations: to 1e-8",
          lambda run: (run.gap("prediction", "centralised")[HP:] <= EQUAL).all()
          and (run.gap("prediction", "centralised") <= 1e-8).all()),
    Claim(E3, (), "7 to 19 iterations",
          lambda run: (run.iterations("prediction") >= 7) & (run.iterations("prediction") <= 19)),
    Claim(E3, (), "error sum below 0.7 of the decentralised one (0.37 to 0.55)",
          lambda run: run.error("prediction").sum() < 0.7 * run.error("decentralised").sum()),
    Claim(E3, (), "the concentrations are poor, whoever estimates them",
          lambda run: np.array([run.rmse(name)[[1, 3]] > 10
                                for name in ("prediction", "centralised", "decentralised")])),
    Claim("cdm-e4", (), "hard bounds: every sample converges, median 12 iterations, at most 60",
          lambda run: converges_always("hard")(run)
          and 9 <= np.median(run.iterations("hard")) <= 15
          and run.iterations("hard").max() <= 60),
    Claim("cdm-e4", (), "near the centralised error sum, below a quarter of the decentralised",
          is_near_centralised("hard")),
    Claim("cdm-e4", (), "barrier: the plain iteration cycles in some windows (23 of 99)",
          lambda run: 60 <= (run.outcome("barrier") == CONVERGED).sum() < 99),
    Claim("cdm-e4", (), "near the centralised error sum all the same (6.6 x)",
          is_near_centralised("barrier")),
    Claim("cdm-e4", (FINE.format("hard", 1e-9),),
          "with full windows the centralised estimate within the bounds",
          lambda run: run.gap("hard", "centralised")[HP:] <= EQUAL),
    Claim("cdm-e5", (), "6 to 20 iterations, every sample converges",
          lambda run: converges_always("prediction")(run)
          and (run.iterations("prediction") >= 6).all()
          and (run.iterations("prediction") <= 20).all()),
    Claim("cdm-e5", (FINE.format("prediction", 1e-11),),
          "the prediction-driven estimate is the centralised one",
          lambda run: run.gap("prediction", "centralised") <= EQUAL),
    Claim("cdm-e5", (), "triggers save a tenth of the uplinks (20 %)",
          lambda run: run.uplinks("triggered") < 0.9 * run.uplinks("prediction")),
    Claim("cdm-e5", (), "and change the error sum by less than 0.1 %",
          lambda run: abs(run.error("triggered").sum() / run.error("prediction").sum() - 1) < 1e-3),
    Claim("cdm-e5", (), "and iterations become slightly fewer (12.8 against 13.6)",
          lambda run: run.iterations("triggered").mean() < run.iterations("prediction").mean()),
    Claim("cdm-e5", MISSING, "a fifth of the values missing: rounds that move apart are given up",
          lambda run: len(run.gap_of_agents("prediction", DIVERGED)) > 0
          and (run.gap_of_agents("prediction", DIVERGED) == 0).all()
          and run.error("prediction").sum() < 1.3 * run.error("centralised").sum()),
    Claim("cdm-e5", (*MISSING, "networks.prediction.coordinated_mhe.anderson=8"),
          "which Anderson acceleration makes meet",
          lambda run: not (run.outcome("prediction") == DIVERGED).any()
          and run.error("prediction").sum() < 1.3 * run.error("centralised").sum()),
    Claim("cdm-e6", (), "the separator gives its decentralised estimate", separator_is_on_its_own),
    Claim("cdm-e6", (), "reactor 2 still profits from reactor 1, and so does the whole",
          others_are_better_off),
    Claim("cdm-e6", (), "with full windows 3 or 4 iterations",
          lambda run: run.iterations("case1")[HP:] <= 4),
    Claim("cdm-e7", (), "nothing changes up to k = 15",
          lambda run: run.gap("case2", "prediction")[:16] == 0),
    Claim("cdm-e7", (), "then the estimates drift away, but stay better than decentralised ones",
          ordered_by_what_is_known),
    Claim("cdm-e7", (), "much later frozen data are worse than none; aged ones are given up",
          lambda run: run.error("case2")[75:].sum() > run.error("aged")[75:].sum()),
    Claim("cdm-e8", (), "seven iterations always",
          lambda run: run.iterations("seven") == 7),
    Claim("cdm-e8", (), "they say that they are premature",
          lambda run: run.outcome("seven")[HMIN - 1 :] == PREMATURE),
    Claim("cdm-e8", (), "after k = 10 within 5e-3 of the centralised estimates",
          lambda run: run.gap("seven", "centralised")[11:] <= 5e-3),
    Claim("cdm-e8", (), "near the centralised error sum", is_near_centralised("seven")),
    Claim("cdm-e8", (), "so are three iterations", is_near_centralised("three")),
    Claim("cdm-x1", (), "on the nonlinear plant, too, a tenth of the decentralised error sum",
          lambda run: run.error("prediction")[3:].sum()
          < run.error("decentralised")[3:].sum() / 10),
    Claim("cdm-x1", (), "and the centralised estimates",
          lambda run: run.gap("prediction", "centralised") <= 1e-3),
    Claim("cdm-x2", (), "every tenth message lost: within 2e-3 when answers must be fresh",
          lambda run: run.gap("fresh", "centralised") <= 2e-3),
    Claim("cdm-x2", (), "ten times further off when they need not be (2.3e-2)",
          lambda run: run.gap("any", "centralised").max()
          > 10 * run.gap("fresh", "centralised").max()),
    Claim("cdm-x2", (), "for two or three iterations less (16.3 and 12.4)",
          lambda run: run.iterations("any").mean() < run.iterations("fresh").mean() - 1.5),
]  # fmt: skip


@pytest.fixture(scope="module")
def outcomes(shared: Stage) -> Callable[[str, tuple[str, ...]], Outcome]:
    """Runs a scenario with changes once and remembers the outcome."""
    made: dict[tuple[str, tuple[str, ...]], Outcome] = {}

    def get(scenario: str, changes: tuple[str, ...]) -> Outcome:
        key = scenario, changes
        if key not in made:
            log = shared.folder / f"{len(made)}.lcm"
            options = [word for change in changes for word in ("--set", change)]
            made[key] = Outcome(inproc(shared, log, *options, scenario=scenario))
        return made[key]

    return get


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: f"{claim.scenario}: {claim.text}")
def test_claim(
    claim: Claim, seed: int, outcomes: Callable[[str, tuple[str, ...]], Outcome]
) -> None:
    assert np.all(claim.holds(outcomes(claim.scenario, (*claim.changes, f"seed={seed}"))))
