"""Worst-case stack of the library's functions, computed and measured.

    stack.py --headers DIR --graph DIR [--graph DIR ..] --image IMAGE --machine MACHINE

Computed: gcc writes what each function takes and whom it calls (-fcallgraph-info=su, *.ci files);
the worst case of a function is its own frame and the deepest of its callees. A call through a
pointer counts as a call of every function of that kind: which kind is read from the source at the
place of the call (`model->f(..)`), which functions are of that kind from their parameters. The
right-hand side of a differential equation is handed down to the stepper that calls it: beneath the
functions of a file count the right-hand sides that this file names, and no others.
Runtime functions of the compiler and the C library are bounded from the image's disassembly.
Not counted: interrupts (an exception frame with floating point is 104 bytes, and its handler) and
what callbacks of one's own take beyond the shipped ones.

Measured: the image paints its stack, makes one step and looks how far the paint is gone; its lines
"stack NAME BYTES" are compared with the computed worst case of its function `step_NAME`.

Fails on recursion, on a frame without a bound, on a call that cannot be followed, and when more
was measured than computed.
"""

import argparse
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import run_image

# Kinds of functions that are called through pointers: by which members, with which parameters.
POINT = "dse_real, const dse_real *, const dse_real *, dse_real *"
DIRECTION = POINT.replace("dse_real,", "dse_real, const dse_real *,", 1)
KINDS = {
    "dse_model": ({"f", "h", "dfdx", "dhdx"}, f"const struct dse_model *, {POINT}"),
    "dse_model's f_many": (
        {"f_many"},
        "const struct dse_model *, dse_real, int, const dse_real *, const dse_real *, dse_real *",
    ),
    "dse_normal_form": (
        {"encode", "decode", "field", "field_jacobian"},
        f"const struct dse_normal_form *, {POINT}",
    ),
    "dse_normal_form's push": (
        {"push"},
        f"const struct dse_normal_form *, {DIRECTION}",
    ),
    "dse_normal_form's Jacobians": (
        {"jacobian", "map_jacobian"},
        f"const struct dse_normal_form *, int, {POINT}",
    ),
    "an active set's K": ({"apply"}, "void *, int, int, dse_real *"),
    "dse_window_qp_backend": (
        {"solve"},
        "void *, const struct dse_window_qp_problem *, dse_real *",
    ),
    "dse_plant's prepare": ({"prepare"}, "const dse_real *, dse_real *"),
    "dse_plant's model": ({"model"}, "const dse_real *, struct dse_model *"),
    "dse_plant's form": ({"normal_form"}, "const dse_real *, struct dse_normal_form *"),
}
# A parameter that is called, not a member: the right-hand side of a differential equation.
# It must not be kept from one call of the library to the next.
RIGHT_HAND_SIDE = "dse_ode_rhs"
KEPT = re.compile(rf"\b{RIGHT_HAND_SIDE} \w+;")
KINDS[RIGHT_HAND_SIDE] = (set(), "void *, dse_real, const dse_real *, dse_real *")
INDIRECT = "__indirect_call"
# A part of a plant calls the functions of the whole, of which it is not a part itself: those of
# their kind that are not defined here.
WRAPPER = "part.c"
OF_A_WHOLE = " of a whole"


class Graph:
    """Functions with their frames in bytes and their callees."""

    def __init__(self) -> None:
        """Start with no function and no error."""
        self.frames: dict[str, int] = {}
        self.calls: dict[str, set[str]] = {}
        self.kinds: dict[str, str] = {}
        self.files: dict[str, str] = {}
        self.steppers: set[str] = set()
        self.errors: list[str] = []

    def read(self, folder: Path) -> None:
        """Take in every .ci file below a folder."""
        for file in sorted(folder.rglob("*.ci")):
            for line in file.read_text().splitlines():
                fields = dict(re.findall(r'(\w+): "((?:[^"\\]|\\.)*)"', line))
                if line.startswith("graph:") and not Path(fields["title"]).exists():
                    break  # left over in the build folder from a source that was moved
                if line.startswith("node:") and "bytes" in fields["label"]:
                    self.node(fields["title"], fields["label"].split("\\n"))
                elif line.startswith("edge:"):
                    self.edge(fields["sourcename"], fields["targetname"], fields.get("label", ""))

    def node(self, title: str, label: list[str]) -> None:
        """A function that is defined: its label holds name, place and stack usage."""
        usage = re.fullmatch(r"(\d+) bytes \((.*)\)", label[2])
        if usage is None or usage[2] not in ("static", "dynamic,bounded"):
            self.errors.append(f"{title}: its frame has no bound ({label[2]})")
            return
        self.frames[title] = int(usage[1])
        self.calls.setdefault(title, set())
        self.kinds[title] = defined_kind(label[1])
        self.files[title] = label[1].rsplit(":", 2)[0]
        if takes_right_hand_side(label[1]):
            self.steppers.add(title)

    def edge(self, caller: str, callee: str, place: str) -> None:
        """A call; a call through a pointer becomes a call of its kind."""
        if callee == INDIRECT:
            kind = called_kind(place)
            if kind is None:
                self.errors.append(f"{caller}: what is called through a pointer at {place}?")
                return
            callee = "any " + kind + (OF_A_WHOLE if is_wrapper(caller) else "")
        self.calls.setdefault(caller, set()).add(callee)

    def callees(self, function: str, handed: frozenset[str]) -> set[str]:
        """Whom a function may call when it is handed these right-hand sides."""
        if function == "any " + RIGHT_HAND_SIDE:
            return set(handed)
        if function.startswith("any "):
            kind = function.removeprefix("any ").removesuffix(OF_A_WHOLE)
            found = {title for title, k in self.kinds.items() if k == kind}
            return {f for f in found if not (function.endswith(OF_A_WHOLE) and is_wrapper(f))}
        return self.calls.get(function, set())

    def right_hand_sides(self) -> frozenset[str]:
        """All functions that are the right-hand side of a differential equation."""
        return frozenset(f for f, kind in self.kinds.items() if kind == RIGHT_HAND_SIDE)

    def named(self) -> dict[str, frozenset[str]]:
        """The right-hand sides that each file names: its own, and those of all that it passes on.

        By files, not by functions, for the compiler moves calls from function to function.
        """
        sides = self.right_hand_sides()
        found = {}
        for file in set(self.files.values()):
            words = set(re.findall(r"\w+", " ".join(source(file))))
            found[file] = frozenset(
                f
                for f in sides
                if self.files[f] == file or (":" not in f and f.partition(".")[0] in words)
            )
        return found

    def worst_cases(self, runtime: dict[str, int]) -> dict[str, int]:
        """Depth of every function; recursion is an error.

        Of a stepper: with the deepest of the right-hand sides that the library hands to it.
        """
        depth: dict[tuple[str, frozenset[str]], int] = {}
        path: list[str] = []
        named = self.named()

        def visit(function: str, handed: frozenset[str]) -> int:
            if function not in self.steppers:
                handed = named.get(self.files.get(function, ""), frozenset()) or handed
            if (function, handed) in depth:
                return depth[function, handed]
            if function in path:
                circle = path[path.index(function) :] + [function]
                self.errors.append("recursion: " + " -> ".join(circle))
                return 0
            known = function in self.frames or function.startswith("any ")
            if not known and function not in runtime:
                self.errors.append(f"{function}: nothing is known about its stack")
                return 0
            path.append(function)
            callees = self.callees(function, handed)
            if function.startswith("any ") and not callees:
                self.errors.append(f"{function}: nobody defines such a function")
            deepest = max((visit(callee, handed) for callee in callees), default=0)
            path.pop()
            depth[function, handed] = self.frames.get(function, runtime.get(function, 0)) + deepest
            return depth[function, handed]

        # From above, so that what is handed down is known; then what only users call.
        called = set().union(*self.calls.values())
        for function in sorted(set(self.frames) - called):
            visit(function, self.right_hand_sides())
        for function in sorted(set(self.frames) - {f for f, _ in depth}):
            visit(function, self.right_hand_sides())
        worst: dict[str, int] = {}
        for (function, _), size in depth.items():
            worst[function] = max(size, worst.get(function, 0))
        return worst


def is_wrapper(title: str) -> bool:
    """Whether a function is one of those through which a part of a plant is called."""
    return Path(title.partition(":")[0]).name == WRAPPER


@cache
def source(file: str) -> list[str]:
    """Lines of a source file."""
    return Path(file).read_text().splitlines()


def text_from(place: str) -> str:
    """The source from file:line:column on, some lines of it."""
    file, line, column = place.rsplit(":", 2)
    return " ".join(source(file)[int(line) - 1 : int(line) + 5])[int(column) - 1 :]


def defined_kind(place: str) -> str:
    """The kind of the function defined at a place, by its parameters; "": none that is called."""
    match = re.match(r"\w+\(([^()]*)\)", text_from(place))
    if match is None:
        return ""
    types = [re.sub(r"\s*\b\w+$", "", p.strip()).replace(" *", "*") for p in match[1].split(",")]
    signature = ", ".join(types).replace("*", " *")
    return next((kind for kind, (_, s) in KINDS.items() if s == signature), "")


def takes_right_hand_side(place: str) -> bool:
    """Whether the function defined at a place is handed a right-hand side."""
    match = re.match(r"\w+\(([^()]*)\)", text_from(place))
    return match is not None and RIGHT_HAND_SIDE in match[1]


def called_kind(place: str) -> str | None:
    """The kind of function called through a pointer at a place; None: not understood."""
    match = re.search(r"((?:\w+(?:->|\.))*)(\w+)\(", text_from(place))
    if match is None:
        return None
    if not match[1]:
        return RIGHT_HAND_SIDE
    return next((kind for kind, (members, _) in KINDS.items() if match[2] in members), None)


# What an instruction of a runtime function takes from the stack.
REGISTERS = re.compile(r"^(?:push|stmdb|stmfd|vpush)\S*\s+(?:sp!, )?\{(.*)\}")
SUBTRACT = re.compile(r"^sub\S*\s+sp, (?:sp, )?#(\d+)")
STORE = re.compile(r"^str\S*\s.*\[sp, #-(\d+)\]!")
BRANCH = re.compile(
    r"^(?:bl?|cbn?z)(?:eq|ne|cs|cc|mi|pl|vs|vc|hi|ls|ge|lt|gt|le)?(?:\.\w)?\s.*<([^>+]+)"
)
END = re.compile(r"^(?:b(?:\.\w)?\s|bx\s|pop\S*\s.*pc|ldm\S*\s.*pc|ldr\S*\s+pc)")


def pushed(instruction: str) -> int:
    """Bytes of stack that an instruction takes."""
    if match := REGISTERS.match(instruction):
        total = 0
        for part in match[1].split(","):
            first, _, last = part.strip().partition("-")
            count = int(last[1:]) - int(first[1:]) + 1 if last else 1
            total += count * (8 if first.startswith("d") else 4)
        return total
    match = SUBTRACT.match(instruction) or STORE.match(instruction)
    return int(match[1]) if match else 0


def disassemble(image: str) -> dict[str, list[str]]:
    """Instructions of every function of an image, in the order of their addresses."""
    command = ["arm-none-eabi-objdump", "-d", "--no-show-raw-insn", image]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    functions: dict[str, list[str]] = {}
    current: list[str] = []
    for line in text.splitlines():
        if match := re.match(r"^[0-9a-f]+ <(.+)>:$", line):
            current = functions.setdefault(match[1], [])
        elif match := re.match(r"^\s*[0-9a-f]+:\t(.*)$", line):
            current.append(match[1].strip())
    return functions


def runtime_bounds(image: str, known: set[str]) -> dict[str, int]:
    """A bound for every function that gcc wrote no .ci file for.

    All that it pushes anywhere, and all that everything it can branch or fall into pushes: more
    than any one path takes.
    """
    functions = disassemble(image)
    order = list(functions)
    takes = {name: sum(map(pushed, body)) for name, body in functions.items()}
    goes = {
        name: {match[1] for i in body if (match := BRANCH.match(i))}
        for name, body in functions.items()
    }
    for name, following in zip(order, order[1:], strict=False):
        body = [i for i in functions[name] if not i.startswith((".", "nop"))]
        if body and not END.match(body[-1]):
            goes[name].add(following)

    def reachable(name: str) -> set[str]:
        seen: set[str] = set()
        new = {name}
        while new:
            seen |= new
            new = {to for n in new for to in goes.get(n, set()) if to in functions} - seen
        return seen

    names = [name for name in order if name not in known]
    bounds = {name: sum(takes[n] for n in reachable(name)) for name in names}
    # Two names of one address: the disassembly shows one of them.
    symbols = subprocess.run(
        ["arm-none-eabi-nm", image], check=True, capture_output=True, text=True
    ).stdout
    addresses: dict[str, list[str]] = {}
    for line in symbols.splitlines():
        address, kind, name = line.split(maxsplit=2)
        if kind in "tTwW":
            addresses.setdefault(address, []).append(name)
    for names in addresses.values():
        shared = [bounds[name] for name in names if name in bounds]
        for name in names:
            if shared and name not in known:
                bounds.setdefault(name, max(shared))
    return bounds


def show(graph: Graph, worst: dict[str, int], runtime: dict[str, int], headers: Path) -> None:
    """The table of all public functions and of the callbacks."""
    declared = set()
    for header in headers.glob("*.h"):
        declared |= set(re.findall(r"\b(dse_\w+)\(", header.read_text()))
    public = sorted(
        (f for f in worst if f in graph.frames and f in declared), key=lambda f: -worst[f]
    )
    print("worst-case stack in bytes, the function's own frame in brackets")
    for function in public:
        if worst[function]:
            print(f"  {worst[function]:5d}  ({graph.frames[function]:4d})  {function}")
    print(f"  {0:5d}          {sum(not worst[f] for f in public)} others")
    for kind in sorted(f for f in worst if f.startswith("any ")):
        print(f"  {worst[kind]:5d}          deepest callback: {kind.removeprefix('any ')}")
    used = [size for name, size in runtime.items() if name in worst]
    print(f"  {max(used, default=0):5d}          deepest of {len(used)} runtime functions")


def measure(machine: str, image: str) -> dict[str, int]:
    """What the image says about its stack."""
    result = run_image.emulate(machine, image)
    if result.returncode != 0:
        sys.exit(f"{image}: exit code {result.returncode}\n{result.stdout}{result.stderr}")
    print(result.stdout, end="")
    return {m[1]: int(m[2]) for m in re.finditer(r"^stack (\w+) (\d+)$", result.stdout, re.M)}


def compare(measured: dict[str, int], worst: dict[str, int]) -> list[str]:
    """Print measured beside computed; return the steps where the computed one is too small."""
    wrong = [] if measured else ["the image measured nothing"]
    print("high-water mark of one step, measured and computed, in bytes")
    for name, bytes_used in measured.items():
        titles = [f for f in worst if f.rsplit(":", 1)[-1] == f"step_{name}"]
        if not titles:
            wrong.append(f"step_{name} is not in the call graph")
            continue
        print(f"  {bytes_used:5d} <= {worst[titles[0]]:5d}  {name}")
        if not 0 < bytes_used <= worst[titles[0]]:
            wrong.append(f"{name}: measured {bytes_used}, computed {worst[titles[0]]}")
    return wrong


def main() -> int:
    """Compute, measure, compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--headers", type=Path, required=True)
    parser.add_argument("--graph", type=Path, action="append", required=True)
    parser.add_argument("--image", required=True)
    parser.add_argument("--machine", required=True)
    arguments = parser.parse_args()

    graph = Graph()
    for folder in arguments.graph:
        graph.read(folder)
    if not graph.frames:
        print("no call graph found")
        return 1
    plain = {title.rsplit(":", 1)[-1] for title in graph.frames}
    runtime = runtime_bounds(arguments.image, plain)
    worst = graph.worst_cases(runtime)
    for header in arguments.headers.glob("*.h"):
        if KEPT.search(header.read_text()):
            graph.errors.append(f"{header}: keeps a right-hand side")
    show(graph, worst, runtime, arguments.headers)
    wrong = graph.errors + compare(measure(arguments.machine, arguments.image), worst)
    for line in wrong:
        print(f"WRONG: {line}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
