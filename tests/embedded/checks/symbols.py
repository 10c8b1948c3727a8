"""Which symbols of others the library needs: nothing that allocates, prints or does I/O.

symbols.py LIBRARY
"""

import re
import subprocess
import sys

# The C language's own block operations, and the compiler's arithmetic runtime.
ALLOWED = [r"memcpy", r"memmove", r"memset", r"__aeabi_\w+", r"__gnu_\w+"]


def names(library: str, kind: str) -> set[str]:
    """Names of the library's defined or undefined symbols."""
    output = subprocess.run(
        ["arm-none-eabi-nm", f"--{kind}-only", library], check=True, capture_output=True, text=True
    ).stdout
    return {line.split()[-1] for line in output.splitlines() if len(line.split()) >= 2}


def main() -> int:
    """Print what is needed and fail on what is not allowed."""
    (library,) = sys.argv[1:]
    defined = names(library, "defined")
    needed = names(library, "undefined") - defined
    if not defined:
        print(f"{library} defines nothing: this is not the library")
        return 1
    refused = {name for name in needed if not any(re.fullmatch(a, name) for a in ALLOWED)}
    for name in sorted(needed):
        print(f"{'NOT ALLOWED' if name in refused else 'allowed'}  {name}")
    print(f"{len(defined)} symbols defined, {len(needed)} needed, {len(refused)} not allowed")
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main())
