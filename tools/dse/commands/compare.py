"""Compare the estimates of two logs bit for bit.

Nodes are matched by network name and node number, estimates by sample; run id and time of logging
do not matter. What is compared: states, variances, diagnostics and health. Exit code 0: all equal;
1: something differs, and the first difference is shown; 2: a log cannot be read.
"""

import argparse

from dse.commands import warn
from dse.compare import NodeComparison, compare
from dse.log import read
from dse.run import Run
from dse.tables import console, table

NAME = "compare"
HELP = "whether two logs hold the same estimates, bit for bit"


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("logs", metavar="LOG", nargs=2, help="the two event logs")
    parser.add_argument(
        "--run", dest="run_ids", metavar="ID", nargs=2, help="run ids, if the logs hold several"
    )


def run(options: argparse.Namespace) -> int:
    """Print the comparison; 1 if anything differs."""
    runs = [
        read(path, run_id)
        for path, run_id in zip(options.logs, options.run_ids or (None, None), strict=True)
    ]
    for path, found in zip(options.logs, runs, strict=True):
        warn([f"{path}: {warning}" for warning in found.warnings])
    nodes = compare(*runs)
    made = table("Estimates", *("network", "node", "samples", "hash", "result"), left=5)
    for one in nodes:
        first, second = one.samples
        count = str(first) if first == second else f"{first}, {second}"
        hashes = ", ".join(dict.fromkeys(map(_text, one.hashes)))
        made.add_row(one.network, one.node, count, hashes, "equal" if one.equal else "DIFFERENT")
    out = console()
    out.print(made)
    for one in nodes:
        if not one.equal:
            out.print(f"{one.network}/{one.node}: {_explain(one, runs[0], options.logs)}")
        for path, own, published in zip(options.logs, one.hashes, one.published, strict=True):
            if published is not None and own is not None and published != own:
                warn(
                    [
                        f"{path}: {one.network}/{one.node} published estimates with hash"
                        f" {_text(published)}: the log does not hold all of them"
                    ]
                )
    if not nodes:
        out.print("neither log has estimators")
    return 0 if all(one.equal for one in nodes) else 1


def _text(value: int | None) -> str:
    return f"{value:016x}" if value is not None else "none"


def _explain(node: NodeComparison, run: Run, logs: list[str]) -> str:
    if None in node.hashes:
        return f"only in {logs[node.hashes[0] is None]}"
    d = node.difference
    if d is None:
        only = [count - node.common for count in node.samples]
        return (
            f"the common samples are equal, but {only[0]} are only in {logs[0]} and"
            f" {only[1]} only in {logs[1]}"
        )
    if d.sample < 0:
        return "the nodes do not estimate the same quantities"
    unit = next((s.unit for s in run.states if s.name == d.largest_what), "")
    return (
        f"first difference at sample {d.sample} (t = {d.time:.6g} {run.time_unit}) in {d.what}:"
        f" {d.first!r} and {d.second!r}; {d.samples} samples differ, the states by at most"
        f" {d.largest:.3g} {unit} ({d.largest_what}, sample {d.largest_sample})"
    )
