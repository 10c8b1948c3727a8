r"""Run a scenario over values and seeds, and plot what one costs in terms of the other.

SCENARIO is run for every combination of the values and for every seed, in one process
(dse-run --inproc). KEY is a key of the scenario as dse-run --set takes it. Of each run the metrics
are taken: a table, and with -o a figure (sweep.png) and the numbers (sweep.csv). With two metrics
the figure also draws one against the other.

    dse sweep ahg-58 --metric sent --metric U --weight 'C*=200' -o threshold \
        --vary networks.ahg.high_gain_ekf.communication.trigger.L=0,0.02,0.05,0.1

Metrics are of all states, errors in units of the states' scales, or with :STATE of one state, in
its unit. `dse design tune` reads sweeps of a high-gain filter's own parameters.
"""

import argparse
import csv
from pathlib import Path

import numpy as np

from dse.design.sweep import Job, Variation, cases, find_program, run_all
from dse.errors import UserError
from dse.metrics import LATE
from dse.run import Run
from dse.tables import console, number, table
from dse.tradeoff import KINDS, Metric, Results, measure, short

NAME = "sweep"
HELP = "run a scenario over values and seeds: tables and plots of trade-offs"


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("scenario", metavar="SCENARIO", help="as for dse-run: file or name")
    parser.add_argument(
        "--vary", metavar="KEY=V1,V2,..", action="append", default=[], help="may be repeated"
    )
    parser.add_argument(
        "--metric",
        metavar="NAME[:STATE]",
        action="append",
        default=[],
        help="may be repeated; default: rmse and late. "
        + "; ".join(f"{kind}: {text}" for kind, text in KINDS.items()),
    )
    parser.add_argument(
        "--weight", metavar="STATES=G", action="append", default=[], help="of U, as in 'C*=200'"
    )
    parser.add_argument(
        "--late", metavar="PART", type=float, default=LATE, help=f"late part, default {LATE}"
    )
    parser.add_argument("--seeds", metavar="N", type=int, help="seeds 1 to N; default: its own")
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], help="as for dse-run"
    )
    parser.add_argument(
        "--network", metavar="NAME", action="append", default=[], help="this network only"
    )
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, help="for sweep.png and .csv")
    parser.add_argument("--bin", metavar="PATH", help="dse-run, or the folder that it is in")


def run(options: argparse.Namespace) -> int:
    """Run, print the table, write figure and numbers."""
    if options.seeds is not None and options.seeds < 1:
        raise UserError(f"--seeds {options.seeds}: must be at least 1")
    if not 0 < options.late <= 1:
        raise UserError(f"--late {options.late:g}: must be above 0 and at most 1")
    variations = [Variation.parse(text) for text in options.vary]
    if not variations:
        raise UserError("give at least one --vary KEY=V1,V2,..")
    metrics = [Metric.parse(text) for text in options.metric or ("rmse", "late")]
    weights = _weights(options.weight)
    seeds = list(range(1, options.seeds + 1)) if options.seeds else [None]
    combinations = cases(variations)
    jobs = [
        Job(
            options.scenario,
            (*options.set, *(f"{key}={value}" for key, value in case)),
            seed,
        )
        for case in combinations
        for seed in seeds
    ]
    labels: list[str] = []

    def of(run: Run) -> dict[str, list[float]]:
        for name in options.network:
            run.network(name)
        labels[:] = [metric.name(run) for metric in metrics]
        return measure(run, metrics, weights, options.late)

    measured = iter(run_all(find_program(options.bin), jobs, of))
    results: Results = {case: [next(measured) for _ in seeds] for case in combinations}
    networks = options.network or list(results[combinations[0]][0])
    _print(results, networks, labels)
    if options.output:
        _write(results, networks, labels, options.output)
    return 0


def _weights(texts: list[str]) -> dict[str, float]:
    weights = {}
    for text in texts:
        pattern, _, value = text.partition("=")
        try:
            weights[pattern] = float(value)
        except ValueError:
            raise UserError(f"--weight {text}: expected STATES=NUMBER, as in 'C*=200'") from None
    return weights


def _print(results: Results, networks: list[str], labels: list[str]) -> None:
    keys = short([key for key, _ in next(iter(results))])
    seeds = len(next(iter(results.values())))
    title = f"Mean of {seeds} seeds" if seeds > 1 else "Sweep"
    made = table(title, *(*keys, "network", *labels), left=len(keys) + 1)
    for case, runs in results.items():
        for name in networks:
            values = np.mean([one[name] for one in runs], axis=0)
            made.add_row(*(value for _, value in case), name, *(number(v) for v in values))
    console().print(made)


def _write(results: Results, networks: list[str], labels: list[str], folder: Path) -> None:
    from dse import plots, tradeoff_plots  # matplotlib takes a second to load

    folder.mkdir(parents=True, exist_ok=True)
    plots.save(tradeoff_plots.figure(results, networks, labels), folder / "sweep.png")
    print(folder / "sweep.png")
    with (folder / "sweep.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*(key for key, _ in next(iter(results))), "run", "network", *labels])
        for case, runs in results.items():
            for k, one in enumerate(runs):
                for name in networks:
                    writer.writerow([*(value for _, value in case), k + 1, name, *one[name]])
    print(folder / "sweep.csv")
