"""Say what a log holds: run, scenario, plant, estimators, channels, and what is wrong with it."""

import argparse
import math
from collections import Counter
from datetime import UTC, datetime

from rich.table import Table

from dse.commands import add_log, read_run
from dse.run import Run
from dse.tables import console, table

NAME = "info"
HELP = "what a log holds"


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_log(parser)
    parser.add_argument("--yaml", action="store_true", help="print the scenario as it was read")


def run(options: argparse.Namespace) -> int:
    """Print the tables."""
    found = read_run(options)
    out = console()
    if options.yaml:
        print(found.scenario.get("yaml") or "", end="")
        return 0
    for made in (_run(found), _networks(found), _channels(found)):
        out.print(made)
    return 0


def _run(run: Run) -> Table:
    made = table("Run", "", "", left=2)
    for name, value in facts(run).items():
        made.add_row(name, value)
    made.show_header = False
    return made


def facts(run: Run) -> dict[str, str]:
    """What there is to say about a run, in words."""
    log, time, plant = run.log, run.info.get("time") or {}, run.info.get("plant") or {}
    scenario = run.scenario
    start = datetime.fromtimestamp(log.first_us / 1e6, UTC)
    found = {
        "log": f"{log.path}, {log.size} bytes, {log.events} events",
        "logged": f"{start:%Y-%m-%d %H:%M:%S} UTC, for {(log.last_us - log.first_us) / 1e6:.3f} s",
        "run id": f"{run.run_id:#x}",
        "scenario": f"{scenario.get('name')}: {scenario.get('title') or ''}",
        "source": str(scenario.get("source") or ""),
        "overrides": ", ".join(map(str, scenario.get("overrides") or [])),
        "seed": str(run.info.get("seed")),
        "version": str(run.info.get("dse_version")),
        "plant": f"{plant.get('name')}: {plant.get('title') or ''} ({plant.get('set')})",
        "states": ", ".join(state.label for state in run.states),
        "inputs": ", ".join(signal.label for signal in run.inputs),
        "outputs": ", ".join(signal.label for signal in run.outputs),
        "samples": f"{len(run.truth.sample)} of {time.get('samples')}",
        "period": f"{time.get('period') or math.nan:.10g} {run.time_unit}",
        "pace": str(run.info.get("pace")),
        "end": run.ended,
        "other runs": ", ".join(f"{i:#x} ({n} estimates)" for i, n in run.other_runs.items()),
        "lost": ", ".join(f"{count} {what}" for what, count in run.lost.items()),
        "repeated": str(run.repeated or ""),
    }
    return {name: value for name, value in found.items() if value}


def _networks(run: Run) -> Table:
    made = table(
        "Estimators",
        *("network", "node", "method", "states", "hears", "estimates", "storage [bytes]"),
        left=5,
    )
    for network, node in run.nodes:
        names = [run.states[i].name for i in node.states]
        states = ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
        made.add_row(
            network.name,
            node.name,
            node.method_title or node.method,
            states,
            ", ".join(map(str, node.neighbours)),
            str(len(node.estimates.sample)),
            str(node.storage_bytes if node.storage_bytes is not None else "-"),
        )
    return made


def _channels(run: Run) -> Table:
    made = table("Channels", "channel", "not used", "events", left=2)
    for channel, count in sorted(run.log.channels.items()):
        reasons = run.log.refused.get(channel, Counter())
        made.add_row(channel, ", ".join(f"{n} {why}" for why, n in reasons.items()), str(count))
    return made
