"""CasADi expressions to plain C over dse/math.h.

Expressions go into one graph with equal nodes stored once, whatever function they come from. A
function's C is then the part of the graph that its results need: what is used once is written in
place, what is used more often or gets too long becomes a constant of its own. What depends on
parameters only is computed once, in the plant's `prepare`.

The order of operations is CasADi's; no identity is applied that could change a bit.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from dse.errors import UserError

SX = Any
LONGEST = 64
"""Characters of an expression that are written in one line."""

CALLS = {
    ca.OP_EXP: "dse_exp",
    ca.OP_LOG: "dse_log",
    ca.OP_SQRT: "dse_sqrt",
    ca.OP_SIN: "dse_sin",
    ca.OP_COS: "dse_cos",
    ca.OP_TANH: "dse_tanh",
    ca.OP_FABS: "dse_abs",
    ca.OP_POW: "dse_pow",
    ca.OP_FMIN: "dse_min",
    ca.OP_FMAX: "dse_max",
}
COMPARE = {ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "!="}
LOGIC = {ca.OP_AND: "&&", ca.OP_OR: "||"}
INFIX = {ca.OP_ADD: ("+", 1), ca.OP_SUB: ("-", 1), ca.OP_MUL: ("*", 2), ca.OP_DIV: ("/", 2)}
NAMES = {
    getattr(ca, name): name[3:].lower()
    for name in dir(ca)
    if name.startswith("OP_") and isinstance(getattr(ca, name), int)
}
LEAF, CONSTANT = -1, -2
# how tightly a piece of C binds; INFIX has 1 and 2
COMPARISON, SUM, CALL, ATOM = 0, 1, 3, 4


@dataclass(frozen=True)
class Node:
    """An operation on earlier nodes, a leaf (family, index) or a constant."""

    op: int
    arguments: tuple[int, ...] = ()
    leaf: tuple[str, int] = ("", 0)
    value: float = 0.0


@dataclass
class Assignment:
    """Lines to write before, and what is to be assigned to what."""

    before: list[str]
    targets: list[str]
    roots: list[int]


@dataclass
class Graph:
    """All expressions of a plant."""

    families: Mapping[str, SX]
    """Columns of symbols by the letter that stands for them: x, u, p, z, t."""
    nodes: list[Node] = field(default_factory=list)
    index: dict[Node, int] = field(default_factory=dict)
    fixed: list[bool] = field(default_factory=list)
    """Depends on parameters and constants only."""
    prepared: list[int] = field(default_factory=list)
    """Fixed nodes that functions need, in the order of their places in `prepared`."""

    def add(self, expressions: SX) -> list[int]:
        """Nodes of a column of expressions."""
        names = list(self.families)
        column = ca.densify(ca.vertcat(expressions))
        function = ca.Function("e", [self.families[name] for name in names], [column])
        work: dict[int, int] = {}
        results = [self._put(Node(CONSTANT))] * column.numel()
        for k in range(function.n_instructions()):
            op = function.instruction_id(k)
            source, target = function.instruction_input(k), function.instruction_output(k)
            if op == ca.OP_OUTPUT:
                results[target[1]] = work[source[0]]
            elif op == ca.OP_INPUT:
                leaf = (names[source[0]], source[1])
                work[target[0]] = self._put(Node(LEAF, leaf=leaf))
            elif op == ca.OP_CONST:
                value = function.instruction_constant(k)
                work[target[0]] = self._constant(value)
            else:
                work[target[0]] = self._operation(op, [work[i] for i in source])
        return results

    def _put(self, node: Node) -> int:
        if node not in self.index:
            self.index[node] = len(self.nodes)
            self.nodes.append(node)
            own = node.op == CONSTANT or (node.op == LEAF and node.leaf[0] == "p")
            whole = bool(node.arguments) and all(self.fixed[a] for a in node.arguments)
            self.fixed.append(own or whole)
        return self.index[node]

    def _constant(self, value: float) -> int:
        return self._put(Node(CONSTANT, value=value))

    def _operation(self, op: int, a: Sequence[int]) -> int:
        """An operation in terms of those that C and dse/math.h have."""
        put = self._put
        if op == ca.OP_SQ:
            return put(Node(ca.OP_MUL, (a[0], a[0])))
        if op == ca.OP_TWICE:
            return put(Node(ca.OP_MUL, (self._constant(2.0), a[0])))
        if op == ca.OP_INV:
            return put(Node(ca.OP_DIV, (self._constant(1.0), a[0])))
        if op == ca.OP_CONSTPOW:
            return put(Node(ca.OP_POW, tuple(a)))
        if op == ca.OP_TAN:
            sine, cosine = put(Node(ca.OP_SIN, tuple(a))), put(Node(ca.OP_COS, tuple(a)))
            return put(Node(ca.OP_DIV, (sine, cosine)))
        if op == ca.OP_SIGN:  # (0 < a) - (a < 0)
            zero = self._constant(0.0)
            above, below = put(Node(ca.OP_LT, (zero, a[0]))), put(Node(ca.OP_LT, (a[0], zero)))
            return put(Node(ca.OP_SUB, (above, below)))
        known = {ca.OP_NEG, ca.OP_NOT, ca.OP_IF_ELSE_ZERO, *CALLS, *COMPARE, *LOGIC, *INFIX}
        if op not in known:
            raise UserError(
                f"{NAMES[op]} has no counterpart in dse/math.h: write it with exp, log, pow, sqrt,"
                " sin, cos or tanh"
            )
        return put(Node(op, tuple(a)))

    def place(self, node: int) -> int:
        """Index of a fixed node in `prepared`."""
        if node not in self.prepared:
            self.prepared.append(node)
        return self.prepared.index(node)


class Writer:
    """Writes one C function's body.

    names: C name of each family, e.g. x: "chi"; t stands for itself. preparing: inside `prepare`,
    where parameters are leaves and nothing is taken from `prepared`.
    """

    def __init__(
        self, graph: Graph, names: Mapping[str, str], roots: Iterable[int], preparing: bool = False
    ) -> None:
        self.graph, self.names, self.preparing = graph, names, preparing
        self.lines: list[str] = []
        self.text: dict[int, tuple[str, int]] = {}
        """C of the nodes so far, and how tightly it binds."""
        self.uses: Counter[int] = Counter(roots)
        self.temporaries = 0
        for node in self._needed(list(self.uses)):
            self.uses.update(self._arguments(node))

    def assign(self, targets: Sequence[str], roots: Sequence[int]) -> None:
        """Lines that compute the roots and assign them."""
        self._write(roots)
        for target, root in zip(targets, roots, strict=True):
            self.lines.append(f"{target} = {self.text[root][0]};")

    def refuse(self, conditions: Sequence[int], answer: str) -> None:
        """Lines that return `answer` unless all conditions are positive."""
        if not conditions:
            return
        self._write(conditions)
        tests = [f"{self._operand(node, COMPARISON)} > 0" for node in conditions]
        for line in _joined([f"!({test})" for test in tests], " || "):
            self.lines += [f"if ({line}) {{", f"    return {answer};", "}"]

    def _arguments(self, node: int) -> tuple[int, ...]:
        return () if self._taken(node) else self.graph.nodes[node].arguments

    def _taken(self, node: int) -> bool:
        """Comes from `prepared`."""
        constant = self.graph.nodes[node].op == CONSTANT
        return not self.preparing and self.graph.fixed[node] and not constant

    def _needed(self, roots: list[int]) -> list[int]:
        """The nodes that roots need, operands first: they were stored in that order."""
        seen: set[int] = set()
        waiting = list(roots)
        while waiting:
            node = waiting.pop()
            if node not in seen:
                seen.add(node)
                waiting += self._arguments(node)
        return sorted(seen)

    def _write(self, roots: Sequence[int]) -> None:
        for node in self._needed(list(roots)):
            if node not in self.text:
                self.text[node] = self._compose(node)
                constant = self.graph.nodes[node].op == CONSTANT
                if self.uses[node] > 1 and self.text[node][1] < ATOM and not constant:
                    self._name(node)

    def _name(self, node: int) -> None:
        """Give a node a constant of its own."""
        name = f"a{self.temporaries}"
        self.temporaries += 1
        self.lines.append(f"const dse_real {name} = {self.text[node][0]};")
        self.text[node] = (name, ATOM)

    def _compose(self, node: int) -> tuple[str, int]:
        what = self.graph.nodes[node]
        if self._taken(node):
            return f"q[{self.graph.place(node)}]", ATOM
        if what.op == CONSTANT:
            return number(what.value), ATOM if what.value >= 0 else SUM
        if what.op == LEAF:
            family, index = what.leaf
            return ("t" if family == "t" else f"{self.names[family]}[{index}]"), ATOM
        text = self._operation(what)
        while len(text[0]) > LONGEST:
            inline = [a for a in what.arguments if self.text[a][1] < ATOM]
            if not inline:
                break
            self._name(max(inline, key=lambda a: len(self.text[a][0])))
            text = self._operation(what)
        return text

    def _operation(self, what: Node) -> tuple[str, int]:
        a, op = what.arguments, what.op
        if op in INFIX:
            sign, level = INFIX[op]
            # the right operand keeps its brackets at the same level: no reassociation
            return f"{self._operand(a[0], level)} {sign} {self._operand(a[1], level + 1)}", level
        if op in CALLS:
            return f"{CALLS[op]}({', '.join(self.text[k][0] for k in a)})", CALL
        if op == ca.OP_NEG:
            return f"-{self._operand(a[0], CALL)}", SUM
        if op == ca.OP_IF_ELSE_ZERO:
            return f"({self._truth(a[0])} ? {self.text[a[1]][0]} : 0)", CALL
        truth = self._condition(what)
        return f"(dse_real)({truth})", CALL

    def _condition(self, what: Node) -> str:
        a, op = what.arguments, what.op
        if op == ca.OP_NOT:
            return f"!({self._truth(a[0])})"
        if op in LOGIC:
            return f"({self._truth(a[0])}) {LOGIC[op]} ({self._truth(a[1])})"
        return f"{self._operand(a[0], SUM)} {COMPARE[op]} {self._operand(a[1], SUM)}"

    def _truth(self, node: int) -> str:
        """A node as a condition: a comparison that is written in place needs no number."""
        text, prefix = self.text[node][0], "(dse_real)("
        is_comparison = text.startswith(prefix) and self.text[node][1] == CALL
        return text[len(prefix) : -1] if is_comparison else f"{self._operand(node, SUM)} > 0"

    def _operand(self, node: int, level: int) -> str:
        text, own = self.text[node]
        return text if own >= level else f"({text})"


def number(value: float) -> str:
    """A C constant of type dse_real, or a small whole number, which is exact in any type."""
    if value == int(value) and abs(value) < 1000:
        return str(int(value))
    exact, short = repr(float(value)), f"{value:g}".replace("e+0", "e").replace("e-0", "e-")
    short = short.replace("e+", "e")
    return f"DSE_REAL({short if float(short) == value and len(short) < len(exact) else exact})"


def matrix(name: str, rows: int, columns: int, graph: Graph, nodes: Sequence[int]) -> Assignment:
    """What is to be assigned for a row-major matrix: zeros by a loop when most entries are zero."""
    zero = [_is_zero(graph.nodes[node]) for node in nodes]
    targets = [f"{name}[{k}]" for k in range(rows * columns)]
    if sum(zero) < 8 or 2 * sum(zero) < len(zero):
        return Assignment([], targets, list(nodes))
    return Assignment(
        [f"for (int k = 0; k < {rows * columns}; k++) {{", f"    {name}[k] = 0;", "}"],
        [target for target, z in zip(targets, zero, strict=True) if not z],
        [node for node, z in zip(nodes, zero, strict=True) if not z],
    )


def _is_zero(node: Node) -> bool:
    return node.op == CONSTANT and node.value == 0


def _joined(parts: Sequence[str], separator: str) -> list[str]:
    """Parts joined into lines of bearable length."""
    lines: list[str] = []
    for part in parts:
        if lines and len(lines[-1]) + len(separator) + len(part) <= LONGEST:
            lines[-1] += separator + part
        else:
            lines.append(part)
    return lines
