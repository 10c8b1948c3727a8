"""Fields of a flow behind the coefficients that a run's plant and estimators have.

The reduced flow models' modes are not in a log: they are made anew from the benchmark (dse.flow).
Where a run's truth is the simulated flow itself, it is simulated anew, too, so that the true fields
are whole and not only what the modes show of them.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dse.design.pod_model import Reduced, reduce
from dse.errors import UserError
from dse.flow import DT, TEST, TRAIN, Flow
from dse.run import Floats, Node, Run

PLANTS = {"cavity_free": False, "cavity_forced": True}
"""Plants that are reduced flow models; whether the flow is driven."""
SETS = {"test": TEST, **{f"train{i}": run for i, run in enumerate(TRAIN, 1)}}
"""Runs of the flow by the plant's parameter sets."""
SAME = 1e-6
"""Truth and projected simulation are the same run when they are nearer than this."""

Fields = tuple[Floats, Floats, Floats]
"""Velocity on the faces, contaminant and temperature in the cells."""


def shows_flow(run: Run) -> bool:
    """Whether the plant of a run is a reduced flow model, and the log has its truth."""
    return (run.info.get("plant") or {}).get("name") in PLANTS and len(run.truth.sample) > 0


@dataclass(frozen=True)
class FlowRun:
    """A run whose plant is a reduced flow model."""

    run: Run
    model: Reduced
    simulated: dict[int, Floats]
    """State of the flow by sample where the truth is the flow; empty where it is the model."""

    def nearest(self, time: float) -> int:
        """The sample whose truth is nearest to a time."""
        return int(self.run.truth.sample[np.argmin(np.abs(self.run.truth.time - time))])

    def time(self, sample: int) -> float:
        """When a sample is."""
        return float(self.run.truth.time[self._row(sample)])

    def _row(self, sample: int) -> int:
        return int(np.flatnonzero(self.run.truth.sample == sample)[0])

    def truth(self, sample: int) -> Fields:
        """The true fields; of the model, what its coefficients say."""
        if sample in self.simulated:
            return self.model.flow.fields(self.simulated[sample])
        return self.model.fields(self.run.truth.value[self._row(sample)])

    def sensors(self, node: Node) -> list[int]:
        """Which sensors a node reads itself: three outputs each."""
        groups = (self.run.info.get("plant") or {}).get("groups") or []
        outputs = [i for g in node.groups if g < len(groups) for i in groups[g]["outputs"]]
        return sorted({i // 3 for i in outputs})

    def estimate(self, node: Node, sample: int) -> Fields | None:
        """A node's fields; None where it has no estimate of that sample."""
        found = np.flatnonzero(node.estimates.sample == sample)
        if not len(found) or not np.all(np.isfinite(node.estimates.value[found[0]])):
            return None
        x = np.zeros(len(self.model.A))
        x[node.states] = node.estimates.value[found[0]]
        return self.model.fields(x)


def open_run(run: Run, library: Path | None = None) -> FlowRun:
    """The flow of a run; UserError where its plant is none."""
    plant = run.info.get("plant") or {}
    if plant.get("name") not in PLANTS:
        known = " and ".join(PLANTS)
        raise UserError(f"the plant {plant.get('name')} has no fields; {known} have")
    if not len(run.truth.sample):
        raise UserError("the log has no truth")
    flow = Flow(PLANTS[str(plant["name"])], library=library)
    model = reduce(flow)
    return FlowRun(run, model, _simulate(run, model, SETS.get(str(plant.get("set")), TEST)))


def _simulate(run: Run, model: Reduced, number: int) -> dict[int, Floats]:
    """The states of the flow by sample, when its projections are the run's truth."""
    first = int(run.truth.sample[0])
    if first != 0 or np.abs(model.starts[number] - run.truth.value[0]).max() > SAME:
        return {}
    period = float((run.info.get("time") or {}).get("period") or np.nan)
    if not period > 0:
        return {}
    count = int(run.truth.sample[-1]) + 1
    steps = max(1, int(period / DT + 0.999999))  # as sim/flow_modes.c
    states = model.flow.advance(model.flow.start(number), count, period, period / steps)
    last = model.project(states[-1])
    if np.abs(last - run.truth.value[-1]).max() > SAME:
        return {}
    return {int(k): states[k] for k in run.truth.sample}


def moments(run: Run) -> list[float]:
    """Times worth a picture: the start, a tenth, the end."""
    times = run.truth.time
    return [float(times[0]), float(times[(len(times) - 1) // 10]), float(times[-1])]


def relative(found: Floats, wanted: Floats) -> float:
    """Distance of two fields relative to the second one's size."""
    size = float(np.linalg.norm(wanted))
    return float(np.linalg.norm(found - wanted)) / size if size > 0 else float("nan")
