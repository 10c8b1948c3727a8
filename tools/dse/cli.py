"""The command dse: each sub-command is a module in dse/commands."""

import argparse
import signal
import sys
from collections.abc import Sequence

from dse import __version__
from dse.commands import compare, design, export, fields, info, network, plot, report, sweep
from dse.errors import UserError

# To add a sub-command: one module with NAME, HELP, configure(parser) and run(arguments), and its
# name here.
COMMANDS = (info, report, plot, fields, export, compare, sweep, network, design)


def main() -> int:
    """Entry point: as `run`, and quiet when the reader of a pipe goes away."""
    if hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    return run(sys.argv[1:])


def run(arguments: Sequence[str]) -> int:
    """Run a command line; its exit code: 0, 1 (compare: different), 2 (the user's mistake)."""
    options = parser().parse_args(arguments)
    try:
        code: int = options.run(options)
        return code
    except UserError as error:
        print(f"dse {options.command}: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        # Reading turns its own errors into UserError: this is a result that cannot be written.
        print(f"dse {options.command}: {error.filename}: {error.strerror}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def parser() -> argparse.ArgumentParser:
    """The parser of the whole command line."""
    top = argparse.ArgumentParser(
        prog="dse", description="Reads the LCM event logs of distributed state estimation runs."
    )
    top.add_argument("--version", action="version", version=f"dse {__version__}")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for module in COMMANDS:
        sub = commands.add_parser(
            module.NAME,
            help=module.HELP,
            description=module.__doc__,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.configure(sub)
        sub.set_defaults(run=module.run)
    return top
