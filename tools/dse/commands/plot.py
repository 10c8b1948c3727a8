"""Plot states: truth and estimates of every network, with their errors.

Without -o the file is called after the states and is written to the current folder; the ending
of the file's name decides on its format (png, pdf, svg).
"""

import argparse
from pathlib import Path

from dse.commands import add_log, read_run
from dse.errors import UserError, unknown

NAME = "plot"
HELP = "truth and estimates of states or diagnostics"


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_log(parser)
    parser.add_argument(
        "--state", metavar="NAME", action="append", default=[], help="a state; may be repeated"
    )
    parser.add_argument(
        "--diagnostic", metavar="NAME", help="a method's own quantity, instead of states"
    )
    parser.add_argument(
        "--network", metavar="NAME", action="append", default=[], help="this network only"
    )
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, help="picture to write")


def run(options: argparse.Namespace) -> int:
    """Write the picture and print its path."""
    found = read_run(options)
    networks = [found.network(name) for name in options.network] or found.networks
    if bool(options.state) == bool(options.diagnostic):
        names = ", ".join(state.name for state in found.states)
        raise UserError(f"give --state (one of {names}) or --diagnostic")
    known = [signal.name for _, node in found.nodes for signal in node.diagnostics]
    if options.diagnostic and options.diagnostic not in known:
        raise unknown("diagnostic", options.diagnostic, known)
    states = [found.state(name) for name in options.state]

    from dse import plots  # matplotlib takes a second to load

    style = plots.colours(found)
    if len(states) == 1:
        figure = plots.state(found, states[0], networks, style)
    elif states:
        figure = plots.overview(found, states, networks, style)
    else:
        figure = plots.diagnostic(found, options.diagnostic, networks, style)
    names = "_".join(options.state) or options.diagnostic
    path = options.output or Path(f"{Path(options.log).stem}_{names}.png".replace("/", "_"))
    try:
        plots.save(figure, path)
    except ValueError as error:  # an ending that matplotlib does not know
        raise UserError(f"{path}: {error}") from None
    print(path)
    return 0
