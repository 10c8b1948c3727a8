"""The C file of a plant: its functions' bodies, put into templates/plant.c.j2."""

import json
from importlib import metadata
from pathlib import Path

import casadi as ca
import jinja2

import dse
from dse.design import newton_c
from dse.design.c_function import Builder, CFunction, case, finite, form_function, unused
from dse.design.emit import Graph, Writer, number
from dse.design.lie import SX, NormalForm


def generate(form: NormalForm, target: str) -> str:
    """The text of the C file; target: its name, for the header comment."""
    plant, s = form.plant, form.symbols
    graph = Graph({"t": s.t, "x": s.x, "u": s.u, "p": s.p, "z": s.z, "d": s.d})
    functions = _model(form, graph) + _normal_form(form, graph)
    prepare = Writer(graph, {"p": "p"}, graph.prepared, preparing=True)
    prepare.assign([f"q[{k}]" for k in range(len(graph.prepared))], graph.prepared)
    names = {
        "states": [v.name for v in plant.states],
        "outputs": [v.name for v in plant.outputs],
    }
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("dse"), trim_blocks=True, lstrip_blocks=True, autoescape=False
    )
    environment.filters["comment"] = lambda text: text.replace("*/", "* /")
    environment.filters["c"] = lambda text: json.dumps(text, ensure_ascii=False)
    environment.filters["real"] = number
    return (
        environment.get_template("plant.c.j2")
        .render(
            plant=plant,
            name=plant.name,
            title=plant.title,
            source=plant.source,
            version=dse.__version__,
            casadi=metadata.version("casadi"),
            file=plant.path.name,
            digest=plant.digest,
            target=Path(target).name,
            coordinates=_coordinates(form),
            inverse=[f"{what} from {source}, {way}" for what, source, way in inverse(form)],
            newton=form.chi is None,
            nx=len(plant.states),
            nu=len(plant.inputs),
            ny=len(plant.outputs),
            np=len(plant.parameters),
            prepared_size=max(1, len(graph.prepared)),
            prepare=prepare.lines if graph.prepared else ["q[0] = 0;"],
            rates=plant.rate_index if plant.rates else [],
            chains=[len(chain) for chain in plant.chains],
            several=any(len(one.outputs) > 1 for one in plant.subsystems),
            blocks=[
                {
                    "name": one.name,
                    "states": [names["states"].index(n) for n in one.states],
                    "outputs": [names["outputs"].index(n) for n in one.outputs],
                }
                for one in plant.subsystems
            ],
            functions=functions,
        )
        .rstrip()
        + "\n"
    )


def _coordinates(form: NormalForm) -> list[str]:
    plant, names = form.plant, row_names(form)
    way = "total time derivatives" if plant.inputs_in_map else "Lie derivatives along f at u = 0"
    return [
        *(
            f"z_{i + 1} = ({', '.join(names[k] for k in block)})"
            for i, block in enumerate(plant.blocks)
        ),
        f"({way})",
    ]


def inverse(form: NormalForm) -> list[tuple[str, str, str]]:
    """How each state is recovered: states, from which coordinates, in which way."""
    states, rows = [v.name for v in form.plant.states], row_names(form)
    lines = []
    for step in form.steps:
        what, source = (
            ", ".join(names[k] for k in part)
            for names, part in ((states, step.unknowns), (rows, step.rows))
        )
        way = "closed form" if step.solution is not None else "Newton iteration"
        lines.append((what, source, way))
    return lines


def row_names(form: NormalForm) -> list[str]:
    """The coordinates: y1, y1', y1'' .."""
    plant = form.plant
    return [
        output.name + ("'" * k if k < 4 else f"^({k})")
        for output, chain in zip(plant.outputs, plant.chains, strict=True)
        for k in range(len(chain))
    ]


def _model(form: NormalForm, graph: Graph) -> list[CFunction]:
    s, build = form.symbols, Builder(form, graph)
    kinds = (
        ("derivative", "dx", form.f, "x' = f(t, x, u)", "STATES"),
        ("output", "y", form.h, "y = h(t, x, u)", "OUTPUTS"),
        ("derivative_jacobian", "F", ca.jacobian(form.f, s.x), "df/dx", "STATES * STATES"),
        ("output_jacobian", "H", ca.jacobian(form.h, s.x), "dh/dx", "OUTPUTS * STATES"),
    )
    functions = []
    for name, out, e, comment, size in kinds:
        lines = build.body([(out, e)], conditions=form.domain)
        lines = [*build.entry("model", "x", lines), *lines, finite(out, size)]
        head = (
            f"static enum dse_status {name}(const struct dse_model *model, dse_real t,\n"
            f"    const dse_real *x, const dse_real *u, dse_real *{out})"
        )
        lines = unused(lines, ("model", "t", "x", "u")) + lines
        functions.append(CFunction(head, lines, [f"/* {comment} */"]))
    functions[0].section = "the model"
    return functions


def _normal_form(form: NormalForm, graph: Graph) -> list[CFunction]:
    build = Builder(form, graph)
    chi = form.chi
    functions = [_encode(form, build)]
    if chi is None:
        functions += newton_c.functions(form, build)
    else:
        functions += _closed(form, build, chi)
    functions += [_map_jacobian(form, build), _push(form, build)]
    functions[0].section = "the normal form"
    return functions


def _encode(form: NormalForm, build: Builder) -> CFunction:
    lines = build.body([("z", form.phi)], state="chi", conditions=form.domain)
    lines.append(finite("z", "STATES"))
    return form_function(build, "encode", "chi z", lines, "z = Phi(chi)")


def _map_jacobian(form: NormalForm, build: Builder) -> CFunction:
    lines = ["switch (i) {"]
    for i, block in enumerate(form.plant.blocks):
        rows = list(block)
        e = ca.jacobian(form.phi[rows], form.symbols.x[rows])
        body = build.body([("M", e)], state="chi", conditions=form.domain)
        lines += case(i, [*body, finite("M", str(len(rows) ** 2))])
    lines += ["default:", "    return DSE_EINVAL;", "}"]
    return form_function(build, "map_jacobian", "chi M", lines, "M = dPhi_i/dchi_i")


def _push(form: NormalForm, build: Builder) -> CFunction:
    s = form.symbols
    lines = build.body([("dz", ca.jtimes(form.phi, s.x, s.d))], state="chi", conditions=form.domain)
    lines.append(finite("dz", "STATES"))
    return form_function(build, "push", "chi dz", lines, "dz = dPhi/dchi dchi")


def _closed(form: NormalForm, build: Builder, chi: SX) -> list[CFunction]:
    """decode, field and jacobian where chi is known as an expression in z."""
    s, plant = form.symbols, form.plant
    conditions = closed_conditions(form, chi)
    decode = build.body([("chi", chi)], conditions=conditions)
    # rows that only move up are copied, so that they are equal bit for bit
    field_z = form.field(chi)
    field_lines = build.body([("dz", field_z)], conditions=conditions)
    whole = build.body([("F", ca.jacobian(field_z, s.z))], conditions=conditions)
    lines = ["switch (i) {"]
    for i, block in enumerate(plant.blocks):
        rows = list(block)
        e = ca.jacobian(field_z[rows], s.z[rows])
        body = build.body([("F", e)], conditions=conditions)
        lines += case(i, [*body, finite("F", str(len(rows) ** 2))])
    lines += ["default:", "    return DSE_EINVAL;", "}"]
    return [
        form_function(
            build, "decode", "z chi", [*decode, finite("chi", "STATES")], "chi = Phi^-1(z)"
        ),
        form_function(
            build, "field", "z dz", [*field_lines, finite("dz", "STATES")], "z' = A z + b(z, u)"
        ),
        form_function(build, "jacobian", "z F", lines, "F = A_i + db_i/dz_i, all other z_j frozen"),
        form_function(
            build,
            "field_jacobian",
            "z F",
            [*whole, finite("F", "STATES * STATES")],
            "F = A + db/dz",
        ),
    ]


def closed_conditions(form: NormalForm, chi: SX) -> list[SX]:
    """What must be positive for chi(z) to be the state of z, in t, z, u, p."""
    needs = [condition for step in form.steps for condition in step.conditions]
    return [form.in_z(condition, chi) for condition in [*needs, *form.domain]]
