"""Sub-commands of dse, and what they have in common."""

import argparse
import sys

from dse.log import read
from dse.run import Run


def add_log(parser: argparse.ArgumentParser) -> None:
    """The arguments that say which run of which log."""
    parser.add_argument("log", metavar="LOG", help="LCM event log, as lcm-logger writes it")
    parser.add_argument(
        "--run", dest="run_id", metavar="ID", help="run id, if the log holds several runs"
    )


def read_run(options: argparse.Namespace) -> Run:
    """The run that the arguments of add_log name; warnings go to stderr."""
    run = read(options.log, options.run_id)
    warn(run.warnings)
    return run


def warn(warnings: list[str], most: int = 20) -> None:
    """Print warnings on stderr, the first `most` of them."""
    for warning in warnings[:most]:
        print(f"dse: warning: {warning}", file=sys.stderr)
    if len(warnings) > most:
        print(f"dse: warning: {len(warnings) - most} more warnings", file=sys.stderr)
