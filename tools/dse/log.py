"""Reading a run from a log."""

from collections import Counter
from pathlib import Path

import numpy as np

from dse import events
from dse.assemble import Assembly
from dse.errors import UserError
from dse.events import EventLog
from dse.run import Run


def read(path: str | Path, run: str | None = None) -> Run:
    """Read one run of a log. `run`: its id, None: the one with most estimates."""
    log = events.read(path)
    estimates = runs(log)
    run_id = _choose(log, estimates, run)
    warnings = list(log.warnings)
    if len(estimates) > 1 and run is None:
        warnings.append(
            f"{len(estimates)} runs in the log; this is run {run_id:#x} with the most estimates"
            " (choose another with --run)"
        )
    for channel, reasons in log.refused.items():
        for reason, count in reasons.items():
            if reason != "foreign channel":
                warnings.append(f"{count} events on {channel} are not used: {reason}")
    others = {other: count for other, count in estimates.items() if other != run_id}
    return Assembly(log, run_id, warnings).run(others)


def runs(log: EventLog) -> dict[int, int]:
    """Ids of the runs in a log with their numbers of estimates (parts counted apart)."""
    count: Counter[int] = Counter()
    for name, messages in log.messages.items():
        ids, times = np.unique(messages["header"]["run_id"], return_counts=True)
        for run_id, number in zip(ids.tolist(), times.tolist(), strict=True):
            # Agents that have not joined a run yet say 0.
            if run_id != 0:
                count[run_id] += number if name == "estimate_t" else 0
    return dict(count)


def _choose(log: EventLog, estimates: dict[int, int], wanted: str | None) -> int:
    if not estimates:
        reasons = sorted({reason for counts in log.refused.values() for reason in counts})
        why = f" ({', '.join(reasons)})" if reasons else ""
        raise UserError(f"{log.path}: no run of dse in the log{why}")
    if wanted is None:
        described = set()
        if (infos := log.messages.get("run_info_t")) is not None:
            described = set(infos["header"]["run_id"].tolist())
        # Of equals the later: a log of a replay holds the recorded run and the new one.
        return max(estimates, key=lambda one: (one in described, estimates[one], _begins(log, one)))
    try:
        run_id = int(wanted, 0)
    except ValueError:
        raise UserError(f"--run {wanted}: not a number (decimal, or hexadecimal with 0x)") from None
    if run_id not in estimates:
        known = ", ".join(f"{other:#x}" for other in estimates)
        raise UserError(f"{log.path}: no run {wanted} in the log: there are {known}")
    return run_id


def _begins(log: EventLog, run_id: int) -> int:
    """Place of a run's first estimate among all estimates."""
    if (estimates := log.messages.get("estimate_t")) is None:
        return 0
    return int(np.argmax(estimates["header"]["run_id"] == run_id))
