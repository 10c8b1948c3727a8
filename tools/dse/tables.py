"""Tables for the terminal."""

import math
from collections.abc import Iterator

from rich import box
from rich.console import Console
from rich.table import Table

from dse.evaluate import Metrics, StateMetrics
from dse.run import Run


def console() -> Console:
    """Standard output; into a file or pipe, lines are as long as they need to be."""
    # Units stand in brackets, which rich would take for its markup.
    found = Console(highlight=False, markup=False, emoji=False)
    if not found.is_terminal:
        found.width = 200
    return found


def number(value: float | None, never: str = "-") -> str:
    """Four significant digits; `never` for None, - for NaN."""
    if value is None:
        return never
    if math.isnan(value):
        return "-"
    return f"{value:.4g}"


def percent(fraction: float) -> str:
    """Percent; neither 0 nor 100 unless it is exactly that. Errors may be beyond 100."""
    if fraction == 0.0 or fraction >= 1.0:
        return f"{100 * fraction:.0f} %"
    return f"{min(max(100 * fraction, 0.01), 99.99):.2f} %"


def table(title: str, *columns: str, left: int = 1) -> Table:
    """A table with the first `left` columns aligned to the left and numbers to the right."""
    made = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, title_style="bold")
    for i, column in enumerate(columns):
        made.add_column(column, justify="left" if i < left else "right", no_wrap=i >= left)
    return made


def report(run: Run, metrics: Metrics, all_nodes: bool = False) -> Iterator[Table]:
    """The tables of `dse report`: accuracy by state and network, cost by node, health."""
    yield accuracy(run, metrics)
    yield norms(metrics)
    nodes = sum(len(network.nodes) for network in metrics.networks.values())
    if nodes > len(metrics.networks) and (nodes <= 16 or all_nodes):
        yield accuracy_by_node(run, metrics)
    if together := agreement_table(run, metrics):
        yield together
    yield communication_table(metrics)
    yield cost(metrics)
    if diagnostics := diagnostic_table(metrics):
        yield diagnostics


def accuracy(run: Run, metrics: Metrics) -> Table:
    """Errors per state and network."""
    percent = f"{100 * metrics.late_fraction:.0f} %"
    made = table(
        f"Accuracy (late: the last {percent}; settling in {run.time_unit or 'plant time'})",
        *("state", "unit", "network", "RMSE", "late RMSE", "max |error|", "settling", "NEES"),
        left=3,
    )
    for state in run.states:
        rows = [
            (name, network.states[state.name])
            for name, network in metrics.networks.items()
            if state.name in network.states
        ]
        for i, (name, m) in enumerate(rows):
            first = (state.name, state.unit) if i == 0 else ("", "")
            made.add_row(*first, name, *_errors(m), end_section=i == len(rows) - 1)
    return made


def _errors(m: StateMetrics) -> tuple[str, ...]:
    return (
        number(m.rmse),
        number(m.late_rmse),
        number(m.max_error),
        # An infinite or absent error has no settling time; a finite one may never settle.
        number(m.settling_time, "never" if math.isfinite(m.rmse) else "-"),
        number(m.nees),
    )


def accuracy_by_node(run: Run, metrics: Metrics) -> Table:
    """Errors per network, node and state."""
    made = table(
        "Accuracy by node",
        *("network", "node", "state", "unit"),
        *("RMSE", "late RMSE", "max |error|", "settling", "NEES"),
        left=4,
    )
    for name, network in metrics.networks.items():
        for node in network.nodes:
            for i, (state, m) in enumerate(node.states.items()):
                first = (name, node.name) if i == 0 else ("", "")
                made.add_row(*first, state, m.unit, *_errors(m))
    return made


def norms(metrics: Metrics) -> Table:
    """Error norms per network."""
    made = table(
        "Error norms (scaled by run_info; relative to the largest error of any network)",
        *("network", "method", "scaled rms", "late", "max", "final"),
        *("relative mean", "max", "error sum"),
        left=2,
    )
    for name, m in metrics.networks.items():
        norm = m.error_norm
        values = (norm.rms, norm.late, norm.max, norm.final, *m.relative_norm.values(), m.error_sum)
        made.add_row(name, m.method, *map(number, values))
    return made


def agreement_table(run: Run, metrics: Metrics) -> Table | None:
    """How well nodes that estimate the same states do together; None where there are none."""
    made = table(
        f"Nodes together (integrals over time in {run.time_unit or 'plant time'})",
        *("network", "nodes", "int node-average error", "late"),
        *("int disagreement", "late", "final", "L2 norm of all errors"),
    )
    for name, network in metrics.networks.items():
        if (m := network.agreement) is not None:
            errors = map(number, (m.error_integral, m.late_error))
            apart = (m.disagreement_integral, m.late_disagreement, m.final_disagreement)
            made.add_row(name, str(m.nodes), *errors, *map(number, apart), number(m.l2_norm))
    return made if made.row_count else None


def communication_table(metrics: Metrics) -> Table:
    """Frames of the model beside what the log shows."""
    made = table(
        "Communication per sample (model: a frame per link, 7 bytes and 4 per value)",
        *("network", "links", "frames", "frame bytes"),
        *("messages", "payload bytes", "bytes in the log"),
    )
    for name, network in metrics.networks.items():
        m = network.communication
        made.add_row(
            name,
            str(m.links),
            *("-" if count is None else str(count) for count in (m.frames, m.frame_bytes)),
            *map(number, (m.messages, m.payload_bytes, m.wire_bytes)),
        )
    return made


def cost(metrics: Metrics) -> Table:
    """Communication, time and health per node."""
    made = table(
        "Cost and health",
        *("network", "node", "samples", "missing", "messages", "bytes", "repeats", "rounds"),
        *("step median [us]", "p99", "max", "tracking", "otherwise"),
        left=2,
    )
    for name, network in metrics.networks.items():
        for i, node in enumerate(network.nodes):
            others = [
                f"{health} {percent(fraction)}"
                for health, fraction in node.health.items()
                if fraction > 0 and health != "tracking"
            ]
            made.add_row(
                name if i == 0 else "",
                node.name,
                str(node.estimates),
                str(node.missing),
                str(node.messages),
                str(node.bytes),
                str(node.exchange["repeats"]),
                number(node.rounds.median),
                *(number(1e6 * s) for s in vars(node.step_s).values()),
                percent(node.health["tracking"]),
                ", ".join(others),
            )
    return made


def diagnostic_table(metrics: Metrics) -> Table | None:
    """Range of the methods' own quantities, None if there are none."""
    made = table(
        "Diagnostics",
        *("network", "node", "quantity", "unit", "min", "mean", "max", "final"),
        left=4,
    )
    for name, network in metrics.networks.items():
        for node in network.nodes[:16]:
            for i, (quantity, values) in enumerate(node.diagnostics.items()):
                first = (name, node.name) if i == 0 else ("", "")
                numbers = (values[key] for key in ("min", "mean", "max", "final"))
                made.add_row(
                    *first, quantity, str(values["unit"]), *(number(float(v)) for v in numbers)
                )
    return made if made.row_count else None
