"""What the library takes in a microcontroller's flash and RAM, per module and processor.

    sizes.py TARGET=LIBRARY [TARGET=LIBRARY ..]

Fails when the library has any variable of its own (.data, .bss): its memory is the caller's.
"""

import re
import subprocess
import sys

SECTIONS = ("text", "rodata", "data", "bss")


def module_sizes(library: str) -> dict[str, dict[str, int]]:
    """Bytes per object file and kind of section."""
    text = subprocess.run(
        ["arm-none-eabi-size", "-A", library], check=True, capture_output=True, text=True
    ).stdout
    sizes: dict[str, dict[str, int]] = {}
    current: dict[str, int] = {}
    for line in text.splitlines():
        if match := re.match(r"^(\S+)\.c\.obj\s+\(ex ", line):
            current = sizes.setdefault(match[1], dict.fromkeys(SECTIONS, 0))
        elif match := re.match(r"^\.(\w+)\S*\s+(\d+)\s", line):
            if match[1] in SECTIONS:
                current[match[1]] += int(match[2])
    return sizes


def main() -> int:
    """Print the table; any byte of data or bss is a failure."""
    tables = {}
    for argument in sys.argv[1:]:
        target, _, library = argument.partition("=")
        tables[target] = module_sizes(library)
    modules = sorted(set().union(*tables.values()))
    if not modules:
        print("no module found")
        return 1

    print(" " * 28 + "".join(f"{target:^28}" for target in tables))
    print(f"{'bytes':28}" + "".join(f"{s:>7}" for s in SECTIONS) * len(tables))
    totals = {target: dict.fromkeys(SECTIONS, 0) for target in tables}
    for module in modules:
        row = f"{module:28}"
        for target, sizes in tables.items():
            for section in SECTIONS:
                size = sizes.get(module, {}).get(section, 0)
                totals[target][section] += size
                row += f"{size:7d}"
        print(row)
    print(f"{'all':28}" + "".join(f"{t[s]:7d}" for t in totals.values() for s in SECTIONS))

    variables = sum(total["data"] + total["bss"] for total in totals.values())
    if variables:
        print(f"{variables} bytes of variables in the library: its memory has to be the caller's")
    return 1 if variables else 0


if __name__ == "__main__":
    sys.exit(main())
