"""The HTML report: one folder with report.html and its pictures."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from dse import __version__, agreement_plots, field_plots, fields, plots
from dse.commands.info import facts
from dse.errors import UserError
from dse.evaluate import DEFINITIONS, Metrics
from dse.run import Run
from dse.tables import number, percent

OVERVIEW_STATES = 12
"""More panels do not fit a picture; further states have their own."""


FIELD_NETWORKS = 4
"""Columns of estimated fields beside the true ones."""


@dataclass
class Picture:
    """A file in the report's folder."""

    file: str
    title: str
    anchor: str = ""


def write(run: Run, metrics: Metrics, directory: Path) -> Path:
    """Write the report into a folder; the path of its page."""
    directory.mkdir(parents=True, exist_ok=True)
    style = plots.colours(run)
    states = sorted({i for _, node in run.nodes for i in node.states})
    title = str(run.scenario.get("title") or run.scenario.get("name") or run.log.path.name)
    pictures: dict[str, list[Picture]] = {"overview": [], "states": [], "diagnostics": []}

    def add(section: str, figure: Figure, file: str, caption: str, anchor: str = "") -> None:
        plots.save(figure, directory / file)
        pictures[section].append(Picture(file, caption, anchor))

    if states:
        shown = states[:OVERVIEW_STATES]
        add("overview", plots.overview(run, shown, run.networks, style), "overview.png", title)
    if (figure := agreement_plots.figure(run, run.networks, style)) is not None:
        add("overview", figure, "together.png", "nodes together: error and disagreement")
    for file, figure, caption in _fields(run):
        add("overview", figure, file, caption)
    if not plots.always_tracking(run.networks):
        add("overview", plots.health(run, run.networks), "health.png", "health of the estimates")
    for i in states:
        signal = run.states[i]
        figure = plots.state(run, i, run.networks, style)
        file = f"state_{_word(signal.name)}.png"
        add("states", figure, file, signal.title or signal.name, f"state-{signal.name}")
    for name in dict.fromkeys(d.name for _, node in run.nodes for d in node.diagnostics):
        figure = plots.diagnostic(run, name, run.networks, style)
        add("diagnostics", figure, f"diagnostic_{_word(name)}.png", name)

    page = directory / "report.html"
    page.write_text(_page(run, metrics, title, style, pictures), encoding="utf-8")
    return page


def _fields(run: Run) -> Iterator[tuple[str, Figure, str]]:
    """Pictures of a flow, truth and the first node of the first networks; a warning if not."""
    if not fields.shows_flow(run):
        return
    try:
        flow_run = fields.open_run(run)
    except UserError as error:
        run.warnings.append(f"fields are not drawn: {error}")
        return
    nodes = [(n, n.nodes[0]) for n in run.networks[:FIELD_NETWORKS] if n.nodes]
    for sample in dict.fromkeys(flow_run.nearest(time) for time in fields.moments(run)):
        caption = f"fields at t = {flow_run.time(sample):.4g} {run.time_unit}"
        yield f"fields_{sample}.png", field_plots.figure(flow_run, sample, nodes), caption


def _page(
    run: Run,
    metrics: Metrics,
    title: str,
    style: plots.Colours,
    pictures: dict[str, list[Picture]],
) -> str:
    environment = Environment(
        loader=PackageLoader("dse"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "percent": percent}
    return environment.get_template("report.html.j2").render(
        title=title,
        run=run,
        metrics=metrics,
        facts=facts(run),
        colours=style,
        pictures=pictures,
        definitions=DEFINITIONS,
        best=_best(run, metrics),
        node_count=sum(len(network.nodes) for network in run.networks),
        version=__version__,
    )


def _best(run: Run, metrics: Metrics) -> dict[tuple[str, str], str]:
    """The network with the smallest value, by state and metric, where there is a choice."""
    best = {}
    for state in run.states:
        rows = {
            n: m.states[state.name] for n, m in metrics.networks.items() if state.name in m.states
        }
        for key in ("rmse", "late_rmse", "max_error", "settling_time"):
            values = {n: getattr(m, key) for n, m in rows.items()}
            known = {n: value for n, value in values.items() if value is not None}
            if len(rows) > 1 and known:
                best[state.name, key] = min(known, key=lambda n: known[n])
    return best


def _word(name: str) -> str:
    """A name as part of a file name."""
    return re.sub(r"[^\w.-]+", "_", name)
