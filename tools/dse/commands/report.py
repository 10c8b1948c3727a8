"""Accuracy and cost of every estimator: tables, and an HTML report with plots.

The report goes to -o, by default to a folder beside the log. With --json every number is printed
for machines instead, and a report is written only if -o is given.
"""

import argparse
import json
from pathlib import Path

from dse.commands import add_log, read_run
from dse.errors import UserError
from dse.evaluate import DEFINITIONS, evaluate, to_json
from dse.metrics import LATE
from dse.tables import console
from dse.tables import report as tables

NAME = "report"
HELP = "accuracy and cost as tables and as an HTML report"

KEYS = """
JSON: one object with the members
  schema                  1; grows when a key changes its meaning
  log                     file, bytes, events, cut_at, repeated, lost, refused, warnings
  run                     run_id, scenario, title, source, overrides, seed, version, pace, plant,
                          time_unit, period, samples, samples_in_log, ended
  late_fraction           see late_rmse
  networks.NAME           index, method, states, error_norm, error_sum, relative_norm,
                          messages, bytes, agreement, communication, nodes
    states.NAME           unit, rmse, late_rmse, max_error, settling_time, initial_error,
                          final_error, nees, band; of several nodes' errors the root mean square
    error_norm            rms, late, max, final
    relative_norm         mean, max
    agreement             nodes, samples, error_integral, late_error, disagreement_integral,
                          late_disagreement, final_disagreement, l2_norm; null unless all nodes
                          estimate the same states
    communication         links, frames, frame_bytes, messages, payload_bytes, wire_bytes
    nodes[]               node, name, method, estimates, missing, nonfinite, health, states,
                          error_norm, messages, bytes, rounds, step_s, exchange, diagnostics,
                          storage_bytes, status
      health.NAME         fraction of the estimates
      rounds, step_s      median, p99, max
      exchange            told, payload_bytes, withheld, repeats, wire_bytes
      diagnostics.NAME    unit, min, mean, max, final
      status              counters of the node's last status message
Numbers that do not exist or are not finite are null.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_log(parser)
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, help="folder of the report")
    parser.add_argument("--json", action="store_true", help="print all metrics as JSON")
    parser.add_argument(
        "--late", metavar="FRACTION", type=float, default=LATE, help=f"late part, default {LATE}"
    )
    parser.add_argument("--all-nodes", action="store_true", help="errors by node, however many")
    lines = "\n".join(f"  {name:<22}  {text}" for name, text in DEFINITIONS.items())
    parser.epilog = f"numbers:\n{lines}\n{KEYS}"


def run(options: argparse.Namespace) -> int:
    """Print the tables or JSON and write the report."""
    if not 0 < options.late <= 1:
        raise UserError(f"--late {options.late}: must be above 0 and at most 1")
    found = read_run(options)
    metrics = evaluate(found, options.late)
    if options.json:
        print(json.dumps(to_json(metrics), indent=2, allow_nan=False))
    else:
        out = console()
        for made in tables(found, metrics, options.all_nodes):
            out.print(made)
    directory = options.output
    if directory is None and not options.json:
        log = Path(options.log)
        directory = log.with_name(f"{log.stem if log.suffix == '.lcm' else log.name}_report")
    if directory is not None:
        from dse.report import write  # matplotlib takes a second to load

        written = write(found, metrics, directory)
        if not options.json:
            print(f"report: {written}")
    return 0
