"""Record the network of a run, so that other runs have the same trouble.

    dse network record LOG --network ahg -o mine.csv

writes how late each packet came and which ones were lost. A scenario replays it with

    networks:
      - name: ahg
        link: {D: 3, file: mine.csv}

Of a run whose network had a link, the delays are those that its receivers saw. Of a run at pace
realtime without one they are those at the logger's host; with receivers on several machines, run
lcm-logger on each, name its nodes with --to, and put the files together with cat.
"""

import argparse
from pathlib import Path

from dse.commands import add_log, read_run
from dse.errors import UserError
from dse.link import LOST
from dse.network_record import Record, record

NAME = "network"
HELP = "a run's delays and losses as a file that scenarios replay"


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="WHAT")
    sub = verbs.add_parser(
        "record",
        help="write the delays and losses of a log's network",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_log(sub)
    sub.add_argument("--network", metavar="NAME", help="default: the scenario's only one")
    sub.add_argument(
        "--to",
        metavar="NODE",
        type=int,
        action="append",
        help="only this receiver; may be repeated",
    )
    sub.add_argument("--library", metavar="FILE", help="libdse_plants.so, if not below build/")
    sub.add_argument("-o", "--output", metavar="FILE", type=Path, required=True, help="CSV")


def run(options: argparse.Namespace) -> int:
    """Write the file and say what is in it."""
    source = read_run(options)
    names = [network.name for network in source.networks]
    if options.network is None and len(names) != 1:
        raise UserError(f"--network: which one of {', '.join(names)}?")
    network = source.network(options.network or names[0])
    found = record(source, network, options.to, options.library)
    with options.output.open("w", encoding="utf-8") as file:
        found.write(file, f"network {network.name} of {source.scenario.get('name')}")
    print(_summary(found))
    keys = f"{{D: {found.largest}, file: {options.output.name}}}"
    print(f"{options.output}: replay it with link: {keys}")
    return 0


def _summary(found: Record) -> str:
    """One line for each receiver and sender."""
    lines = []
    for (to, sender), delay in sorted(found.delays.items()):
        came = delay[delay != LOST]
        share = 100 * (1 - len(came) / len(delay)) if len(delay) else 0.0
        mean = came.mean() if len(came) else float("nan")
        lines.append(
            f"node {to} from node {sender}: {len(delay)} packets, {share:.1f} % lost, the others"
            f" {mean:.2f} instants late on average, {came.max(initial=0)} at most"
        )
    return "\n".join(lines)
