"""Bodies of C functions from the expressions of a normal form."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca

from dse.design.emit import Assignment, Graph, Writer, matrix
from dse.design.lie import SX, NormalForm

REFUSE = "DSE_EMODEL"


@dataclass
class CFunction:
    """A function of the file."""

    head: str
    lines: list[str]
    comment: list[str] = field(default_factory=list)
    section: str = ""
    raw: str = ""
    """Text to be written instead: not a function."""


class Builder:
    """Makes functions of one form over one graph."""

    def __init__(self, form: NormalForm, graph: Graph) -> None:
        self.form, self.graph = form, graph

    def body(
        self,
        outputs: Sequence[tuple[str, SX]],
        state: str = "x",
        conditions: Sequence[SX] = (),
        before: Sequence[str] = (),
        indices: Sequence[int] | None = None,
    ) -> list[str]:
        """Lines that compute outputs: (C name, expression); a matrix is written row by row.

        state: C name of the physical state. conditions: positive, or the function refuses.
        indices: places of a single column's entries, if not 0, 1, 2 ...
        """
        nodes = self.graph.add(ca.vertcat(*conditions)) if len(conditions) else []
        assignments = [self._assignment(name, e, indices) for name, e in outputs]
        roots = [*nodes, *(root for a in assignments for root in a.roots)]
        writer = Writer(self.graph, {"x": state, "u": "u", "z": "z", "d": "dchi"}, roots)
        writer.refuse(nodes, REFUSE)
        for assignment in assignments:
            writer.lines += assignment.before
            writer.assign(assignment.targets, assignment.roots)
        return [*before, *writer.lines]

    def _assignment(self, name: str, e: SX, indices: Sequence[int] | None) -> Assignment:
        nodes = self.graph.add(ca.vec(e.T))
        if indices is not None:
            return Assignment([], [f"{name}[{k}]" for k in indices], nodes)
        return matrix(name, e.shape[0], e.shape[1], self.graph, nodes)

    def entry(self, source: str, state: str, lines: Sequence[str]) -> list[str]:
        """Lines before a body: where q comes from, what must be there and be finite."""
        prelude = []
        if any("q[" in line or "(q," in line for line in lines):
            prelude.append(f"const dse_real *q = {source}->parameters;")
        if self.form.plant.inputs:
            prelude += ["if (u == NULL) {", "    return DSE_EINVAL;", "}"]
        check = f"if (!dse_all_finite({state}, STATES)) {{"
        return [*prelude, check, f"    return {REFUSE};", "}"]


def unused(lines: Sequence[str], names: Sequence[str]) -> list[str]:
    """`(void)name;` for parameters that no line mentions."""
    text = " ".join(lines)
    words = set("".join(c if c.isalnum() or c == "_" else " " for c in text).split())
    return [f"(void){name};" for name in names if name not in words]


def finite(name: str, size: str) -> str:
    """The last line of a function: what is not finite is no result."""
    return f"return dse_all_finite({name}, {size}) ? DSE_OK : {REFUSE};"


def form_function(
    build: Builder, name: str, arguments: str, lines: Sequence[str], comment: str
) -> CFunction:
    """A function of struct dse_normal_form; arguments: state and output, "z dz"."""
    state, out = arguments.split()
    block = "int i, " if name in ("jacobian", "map_jacobian") else ""
    change = "const dse_real *dchi, " if name == "push" else ""
    lines = [*build.entry("form", state, lines), *lines]
    names = ["form", *(["i"] if block else []), "t", state, "u"]
    head = (
        f"static enum dse_status {name}(const struct dse_normal_form *form, {block}dse_real t,\n"
        f"    const dse_real *{state}, const dse_real *u, {change}dse_real *{out})"
    )
    return CFunction(head, unused(lines, names) + list(lines), [f"/* {comment} */"])


def case(i: int, lines: Sequence[str]) -> list[str]:
    """One case of a switch over blocks."""
    return [f"case {i}: {{", *(f"    {line}" for line in lines), "}"]
