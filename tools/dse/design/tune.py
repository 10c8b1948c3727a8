"""Tune a high-gain filter by simulation, step by step as in the source's flowchart.

SCENARIO is run for every combination of the values and for every seed, in one process
(dse-run --inproc). KEY is a key of the scenario as dse-run --set takes it; a key of high_gain_ekf
alone, such as theta_m, stands for that key in all its networks (or those of --network).

  1. gain=one: tune Q and R as for any EKF.          --vary gain=one --vary R=[1,1],[4,4]
  2. gain=permanent: raise theta_m until the error falls fast, not until noise dominates.
                                                     --vary gain=permanent --vary theta_m=5,10,20
  3. choose the horizon d of the innovation.         --vary d=0.005,0.01,0.02
  4. choose m above the J that noise alone makes, J_noise ~ d sigma_v^2 + q d^2/2, and below the J
     of a wrong estimate; then beta, DeltaT, lambda. --vary m=0.1,1,4

When theta then oscillates or the error falls slowly, go back to 3. After a large change of the
operating point identify the plant again (dse design identify) and begin anew.

All errors are in units of the states' scales; "noise" is the standard deviation of the late error
about its moving mean over 1/30 of the run; "reached" is when the error norm, as its root mean
square over 1/50 of the run, is first below a tenth of its first value. Of several seeds the mean is
shown, and the longest such time.

"theta under noise" is where theta comes to rest when J = J_noise, with the m and beta of the row;
"beta from" is the smallest beta with which that is below 1.01.
"""

import argparse
import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dse.design.flowchart import SECTION, STEPS, Innovation, Measured, measure, step_of
from dse.design.sweep import Case, Job, Variation, cases, find_program, run_all, settings
from dse.errors import UserError
from dse.run import Run
from dse.tables import console, number, percent, table

NAME = "tune"
HELP = "what a high-gain filter's parameters do, over values and seeds"
KEYS = (
    *("coordinates", "scaling", "gain", "gains", "innovation", "d", "DeltaT", "beta", "m"),
    *("lambda", "theta_m", "Q", "R", "P0", "communication"),
)
"""Keys of high_gain_ekf that may be given without the path to it."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("scenario", metavar="SCENARIO", help="as for dse-run: file or name")
    parser.add_argument(
        "--vary", metavar="KEY=V1,V2,..", action="append", default=[], help="may be repeated"
    )
    parser.add_argument("--seeds", metavar="N", type=int, help="seeds 1 to N; default: its own")
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], help="as for dse-run"
    )
    parser.add_argument(
        "--network", metavar="NAME", action="append", default=[], help="this network only"
    )
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, help="for plots and tune.csv")
    parser.add_argument("--bin", metavar="PATH", help="dse-run, or the folder that it is in")


Results = dict[Case, list[list[Measured]]]
"""By case and seed: the networks."""


def run(options: argparse.Namespace) -> int:
    """Run, print the tables, write the plots."""
    if options.seeds is not None and options.seeds < 1:
        raise UserError(f"--seeds {options.seeds}: must be at least 1")
    variations = [Variation.parse(text) for text in options.vary]
    if not variations:
        raise UserError("give at least one --vary KEY=V1,V2,..")
    program = find_program(options.bin)
    seeds = list(range(1, options.seeds + 1)) if options.seeds else [None]

    fixed = tuple(options.set)
    first = Job(options.scenario, fixed, seeds[0])
    names, unit = run_all(program, [first], lambda run: _about(run, options.network))[0]
    combinations = cases(variations)
    jobs = [
        Job(options.scenario, fixed + overrides(case, names), seed)
        for case in combinations
        for seed in seeds
    ]
    measured = iter(run_all(program, jobs, measure))
    results = {case: [next(measured) for _ in seeds] for case in combinations}

    wanted = options.network or [one.network for one in results[combinations[0]][0]]
    _print(results, wanted, unit)
    if options.output:
        _write(results, wanted, unit, options.output)
    return 0


def _about(run: Run, wanted: Sequence[str]) -> tuple[list[str], str]:
    """Names of the networks that short keys mean, and the unit of time."""
    for name in wanted:
        run.network(name)
    networks = [one for one in settings(run).get("networks") or [] if SECTION in one]
    names = [str(one["name"]) for one in networks if not wanted or one["name"] in wanted]
    if not names:
        raise UserError(f"no network of this scenario has {SECTION}")
    return names, run.time_unit


def overrides(case: Case, networks: Sequence[str]) -> tuple[str, ...]:
    """KEY=VALUE of a case for dse-run."""
    return tuple(
        f"{full}={value}"
        for key, value in case
        for full in (
            [f"networks[{name}].{SECTION}.{key}" for name in networks]
            if key.partition(".")[0] in KEYS
            else [key]
        )
    )


def _print(results: Results, wanted: Sequence[str], unit: str) -> None:
    out = console()
    keys = [key for key, _ in next(iter(results))]
    for name in wanted:
        steps = {_step(seeds, name, keys) for seeds in results.values()}
        for step in sorted(steps, key=lambda one: one or 0):
            title = f"{name}: {STEPS[step]}" if step else name
            made = table(
                title,
                *(*keys, "error", "late error", f"reached [{unit}]", "noise", "theta high"),
                left=len(keys),
            )
            for case, seeds in results.items():
                if _step(seeds, name, keys) == step:
                    made.add_row(*(value for _, value in case), *_row(seeds, name))
            out.print(made)
        _print_innovation(results, name, keys)


def _step(seeds: list[list[Measured]], name: str, keys: Sequence[str]) -> int | None:
    return step_of(_of(seeds[0], name).gain, keys)


def _of(networks: list[Measured], name: str) -> Measured:
    return next(one for one in networks if one.network == name)


def _row(seeds: list[list[Measured]], name: str) -> list[str]:
    found = [_of(networks, name) for networks in seeds]
    mean = [float(np.mean([getattr(one, what) for one in found])) for what in COLUMNS]
    reached = max(one.reached for one in found)
    return [
        *(number(value) for value in mean[:2]),
        "never" if math.isinf(reached) else number(reached),
        number(mean[2]),
        "-" if math.isnan(mean[3]) else percent(mean[3]),
    ]


COLUMNS = ("rms", "late", "noise", "high")


def _print_innovation(results: Results, name: str, keys: Sequence[str]) -> None:
    """J of noise, of the run, and where m stands between them."""
    made = table(
        f"{name}: J that drives theta, and m between noise and a wrong estimate",
        *(
            *keys,
            "J_noise",
            "late J (99 %)",
            "largest J",
            "m",
            "m may be",
            "beta from",
            "theta under noise",
        ),
        left=len(keys),
    )
    for case, seeds in results.items():
        found = [_of(networks, name).innovation for networks in seeds]
        known = [one for one in found if one is not None]
        if known:
            made.add_row(*(value for _, value in case), *_innovation_row(known))
    if made.row_count:
        console().print(made)


def _innovation_row(found: list[Innovation]) -> list[str]:
    one = Innovation(
        found[0].noise,
        max(i.late for i in found),
        float(np.mean([i.peak for i in found])),
        found[0].m,
        found[0].rest,
        found[0].beta,
    )
    room = one.suggested
    return [
        *(number(value) for value in (one.noise, one.late, one.peak, one.m)),
        f"{number(room[0])} to {number(room[1])}" if room else "no room",
        number(one.beta),
        "stays high" if math.isinf(one.rest) else number(one.rest),
    ]


def _write(results: Results, wanted: Sequence[str], unit: str, folder: Path) -> None:
    from dse import plots  # matplotlib takes a second to load
    from dse.design import tune_plots

    folder.mkdir(parents=True, exist_ok=True)
    plots.save(tune_plots.numbers(results, wanted, unit), folder / "tune.png")
    print(folder / "tune.png")
    gains = tune_plots.gains(results, wanted, unit)
    if gains is not None:
        plots.save(gains, folder / "gain.png")
        print(folder / "gain.png")
    keys = [key for key, _ in next(iter(results))]
    with (folder / "tune.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            [*keys, "seed", "network", "gain", "state", "rms", "late", "reached", "noise"]
        )
        for case, seeds in results.items():
            for networks in seeds:
                for one in networks:
                    if one.network in wanted:
                        head = [*(value for _, value in case), one.seed, one.network, one.gain]
                        norm = (one.rms, one.late, one.reached, one.noise)
                        writer.writerow([*head, "error norm", *norm])
                        writer.writerows([*head, s, *values] for s, values in one.states.items())
    print(folder / "tune.csv")
