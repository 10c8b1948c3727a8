"""Reduced models of flows from snapshots: modes (POD), Galerkin coefficients, what they are worth.

WHAT is `free` or `forced`, the cases of the flow benchmark in the unit square (sim/flow.h), whose
snapshots are simulated here, or a file .npz of snapshots of another run of it: u (m, n+1, n) and
v (m, n, n+1) on the faces of n x n cells, c and T (m, n, n) in their centres, zero on the walls.

Printed are the energy that the modes hold, the certificate of stability - the linear part
dissipates, the quadratic part loses nothing -, how far the model is from the simulated flow, and
how well every sensor alone sees the state: the rank and the smallest singular value of the
observability matrix along the test run. With -o the model is written as YAML; --write DIR writes
the C data of both cases where the shipped plants and the simulator have it.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from dse.errors import UserError, unknown
from dse.tables import console, number, percent, table

if TYPE_CHECKING:
    from dse.design.pod_model import Reduced

NAME = "pod"
HELP = "reduced flow models: modes, Galerkin coefficients, certificate, observability"
CASES = ("free", "forced")
COMMAND = "dse design pod --write ."


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("what", metavar="WHAT", nargs="?", default="free", help="a case or a file")
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--modes", metavar="V,C,T", help="how many modes of each field (4,3,3)")
    size.add_argument("--energy", metavar="V,C,T", help="share of the energy to hold: .995,.97,.99")
    parser.add_argument("-o", metavar="FILE", type=Path, dest="output", help="write the model")
    parser.add_argument("--snapshots", metavar="FILE", type=Path, help="write the snapshots (.npz)")
    parser.add_argument("--write", metavar="DIR", type=Path, help="write the shipped C data")
    parser.add_argument("--forced", action="store_true", help="a file's flow has the sources")
    parser.add_argument("--library", metavar="FILE", type=Path, help="libdse_plants.so")


def run(options: argparse.Namespace) -> int:
    """Make, describe, write."""
    from dse.design import pod_emit, pod_model
    from dse.flow import Flow

    if options.write is not None:
        for case in CASES:
            made = pod_model.reduce(Flow(case == "forced", library=options.library))
            for path, text in pod_emit.files(case, made, COMMAND).items():
                pod_emit.write(options.write / path, text)
                console().print(f"written: {options.write / path}")
        return 0
    if options.what in CASES:
        flow = Flow(options.what == "forced", library=options.library)
        fields = pod_model.snapshots(flow)
    elif Path(options.what).is_file():
        flow, fields = pod_emit.load(Path(options.what), options.forced, options.library)
    else:
        raise UserError(f"{options.what}: no such file; {unknown('case', options.what, CASES)}")
    if options.snapshots is not None:
        pod_emit.save(options.snapshots, flow, fields)
    counts = _three(options.modes, "--modes") if options.modes else None
    energies = _three(options.energy, "--energy") if options.energy else None
    made = pod_model.reduce(flow, counts, energies, fields)
    describe(options.what, made)
    if options.output is not None:
        pod_emit.write(options.output, pod_emit.text(made, f"dse design pod {options.what}"))
    return 0


def _three(text: str, option: str) -> tuple[float, float, float]:
    try:
        one, two, three = (float(word) for word in text.split(","))
    except ValueError:
        raise UserError(f"{option} {text}: three numbers, for velocity, c and T") from None
    return one, two, three


def describe(name: str, made: "Reduced") -> None:
    """Print what the model is like."""
    from dse.design import pod_checks

    out = console()
    head = table(f"Modes of {name}", "field", "modes", "energy", "eigenvalues")
    for field, basis in zip(("velocity", "contaminant", "temperature"), made.bases, strict=True):
        values = "  ".join(number(v) for v in basis.eigenvalues[: basis.count + 2])
        head.add_row(field, str(basis.count), percent(basis.energy[basis.count - 1]), values)
    out.print(head)

    found = pod_checks.certify(made)
    checks = table("Certificate", "property", "value")
    low, high = number(found.rates[0]), number(found.rates[-1])
    checks.add_row("eigenvalues of (A + A')/2", f"{low} .. {high}")
    checks.add_row("the linear part dissipates", "yes" if found.dissipative else "NO")
    checks.add_row("largest coefficient of x'q(x), relative", number(found.cubic))
    checks.add_row("the quadratic part is lossless", "yes" if found.lossless else "NO")
    out.print(checks)

    fit = table("Against the simulated test run, relative rms", "field", "model", "projection")
    for field, model, best in zip(
        ("velocity", "contaminant", "temperature"), *pod_checks.fit(made), strict=True
    ):
        fit.add_row(field, percent(model), percent(best))
    out.print(fit)

    seen = table("Observability of one sensor", "sensor", "at x", "rank", "smallest singular value")
    for row in pod_checks.observability(made):
        seen.add_row(
            str(row.sensor + 1), row.where, f"{row.rank} of {len(made.A)}", number(row.least)
        )
    out.print(seen)
