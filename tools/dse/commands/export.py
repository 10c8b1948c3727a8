"""Write the signals of a log as tables: CSV, Parquet or one MATLAB file.

One table per source, one row per sample: truth, inputs, measurement_<group>, and per node
estimate_<network>_<node> and done_<network>_<node>. Beside them run.json: the log's run_info with
names and units. Columns: sample, time, then the signals by name; estimates also have health,
variance_<state> and the method's diagnostics.
"""

import argparse
from pathlib import Path

from dse.commands import add_log, read_run
from dse.export import FORMATS, write

NAME = "export"
HELP = "signals as CSV, Parquet or MATLAB tables"


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_log(parser)
    parser.add_argument("--format", choices=FORMATS, default="csv", help="default csv")
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, required=True, help="folder")


def run(options: argparse.Namespace) -> int:
    """Write the tables and say where."""
    for path in write(read_run(options), options.format, options.output):
        print(path)
    return 0
