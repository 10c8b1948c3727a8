"""Derive a plant's normal form and write it as C.

MODEL.py writes the plant in CasADi: f, h, names, units, parameters, sets and subsystems; what the
file must define is listed below. Coordinates are the outputs and their derivatives along the plant,

    z_i = Phi_i(chi) = [h_i, L_f h_i, ..], one more per state of subsystem i,
    z_i' = A_i z_i + b_i(z, u)

taken by algorithmic differentiation, as are all Jacobians. The inverse is found in closed form
where the equations can be solved one after the other, otherwise the C file iterates (Newton, at
most 50 steps, DSE_EMODEL when it does not converge). Its Jacobians then take two matrices of all
states from the stack: more than 2048 bytes have to be asked for with -DDSE_PLANT_STACK=8192.

The C file needs nothing but the library: put it into lib/plants/, add its dse_plant_NAME to
lib/plants/registry.c, build. Without -o the plant is only examined.
"""

import argparse
from pathlib import Path

from dse.errors import UserError
from dse.tables import console, table

NAME = "normal-form"
HELP = "a plant written in CasADi as C, in high-gain coordinates"


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from dse.design import plant_file

    parser.add_argument("model", metavar="MODEL.py", type=Path, help="the plant, see below")
    parser.add_argument("-o", "--output", metavar="PLANT.c", type=Path, help="C file to write")
    parser.add_argument(
        "--check",
        action="store_true",
        help="compare all derivatives with differences around the operating points; exit code 1 if"
        " one is wrong",
    )
    parser.epilog = f"{plant_file.__doc__}\nExamples: {Path(__file__).parent / 'examples'}"


def run(options: argparse.Namespace) -> int:
    """Derive, examine, write."""
    try:
        import casadi  # noqa: F401 - optional, and the modules below need it
    except ImportError:
        raise UserError(
            "needs the Python package casadi: pip install 'dse-tools[native]'"
        ) from None
    from dse.design import lie, operating, plant_c, plant_file

    form = lie.derive(plant_file.load(options.model))
    text = plant_c.generate(form, str(options.output or f"{form.plant.name}.c"))
    out = console()
    made = table("Inverse", "state", "from", "how", left=3)
    for states, rows, way in plant_c.inverse(form):
        made.add_row(states, rows, way)
    out.print(made)
    made = table("Operating points", "point", "rank", "singular values", "least seen", left=4)
    for one in operating.check_observability(form):
        values = "  ".join(f"{value:.3g}" for value in one.singular)
        made.add_row(one.point, f"{one.rank} of {one.n}", values, ", ".join(one.weakest))
        for blind in one.blind:
            out.print(f"at '{one.point}' {blind} is seen through neighbours only: no `mapped` form")
    out.print(made)
    code = 0
    if options.check:
        made = table("Check", "what", "worst deviation", "", left=1)
        for what, value in operating.check_derivatives(form).items():
            right = value <= operating.TOLERANCE
            made.add_row(what, f"{value:.1e}", "ok" if right else "WRONG")
            code = code if right else 1
        out.print(made)
    if options.output and code == 0:
        options.output.write_text(text)
        print(options.output)
    return code
