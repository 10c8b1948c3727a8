"""A recorded run of the adaptive high-gain EKF as a C header, for an image without a file system.

    high_gain_table.py RUN.json TICKS OUTPUT.h

The configuration of the run and, for every recorded tick below TICKS, its expected values.
"""

import json
import sys
from pathlib import Path
from typing import TypeAlias

Nested: TypeAlias = "float | list[Nested]"


def flat(values: Nested) -> list[float]:
    """All numbers of nested lists in their order."""
    if isinstance(values, list):
        return [number for value in values for number in flat(value)]
    return [float(values)]


def array(name: str, values: Nested) -> str:
    """A C array; hexadecimal literals keep every bit."""
    numbers = ", ".join(f"DSE_REAL({number.hex()})" for number in flat(values))
    return f"static const dse_real golden_{name}[] = {{{numbers}}};"


def table(name: str, kind: str, rows: list[Nested]) -> str:
    """One row per recorded tick."""
    width = len(flat(rows[0]))
    literal = "DSE_REAL({})" if kind == "dse_real" else "{}"
    lines = [
        "{"
        + ", ".join(literal.format(v.hex() if kind == "dse_real" else int(v)) for v in flat(row))
        + "},"
        for row in rows
    ]
    head = f"static const {kind} golden_{name}[][{width}] = {{"
    return "\n".join([head, *lines, "};"])


def diagonal(entries: list[float]) -> Nested:
    """A diagonal matrix."""
    return [[e if i == j else 0.0 for j in range(len(entries))] for i, e in enumerate(entries)]


def main() -> None:
    """Write the header."""
    run = json.loads(Path(sys.argv[1]).read_text())
    ticks = int(sys.argv[2])
    config, record = run["config"], run["record"]
    kept = [r for r, k in enumerate(record["k"]) if k < ticks]
    scalars = {
        "period": "Ts_h", "sharpness": "beta", "threshold": "m", "relaxation": "lam",
        "rise_time": "dT", "theta_m": "theta_m",
    }  # fmt: skip
    lines = [
        f"/* Made by high_gain_table.py from {Path(sys.argv[1]).name}. */",
        '#include "dse/real.h"',
        f"#define GOLDEN_TICKS {ticks}",
        f"#define GOLDEN_ROWS {len(kept)}",
        f"#define GOLDEN_HORIZON {config['Nd']}",
        *(
            f"#define GOLDEN_{name.upper()} DSE_REAL({float(config[key]).hex()})"
            for name, key in scalars.items()
        ),
        array("plant_x0", run["plant_x0"]),
        array("guess", config["x0_filter_guess"]),
        array("R", config["R"]),
        table("Q", "dse_real", [diagonal(q) for q in config["Q_diag"]]),
        table("P0", "dse_real", config["P0"]),
        table("tick", "int", [[record["k"][r]] for r in kept]),
        *(
            table(name, "dse_real", [record[name][r] for r in kept])
            for name in ("xhat", "theta", "J", "z", "P")
        ),
    ]
    Path(sys.argv[3]).write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
