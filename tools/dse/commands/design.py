"""Work out on a desk what a run needs: plants from equations, tuning, bounds."""

import argparse

from dse import design

NAME = "design"
HELP = "offline design: plants, tuning, bounds"


def configure(parser: argparse.ArgumentParser) -> None:
    """One parser per module of dse/design."""
    commands = parser.add_subparsers(dest="design", required=True, metavar="WHAT")
    for module in design.COMMANDS:
        sub = commands.add_parser(
            module.NAME,
            help=module.HELP,
            description=module.__doc__,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.configure(sub)
        # command is what an error message begins with
        sub.set_defaults(design_run=module.run, command=f"{NAME} {module.NAME}")


def run(options: argparse.Namespace) -> int:
    """Run the sub-command."""
    code: int = options.design_run(options)
    return code
