"""Runs an image under QEMU and, with --like, the same case on the host: outputs must be equal.

    run_image.py MACHINE IMAGE [--like HOST_PROGRAM]

Exits with 0 when the image exits with 0 (all its own checks held) and the outputs are the same.
"""

import argparse
import difflib
import shutil
import subprocess
import sys

TIMEOUT_S = 120
SKIPPED = 77
EMULATOR = "qemu-system-arm"


def run(command: list[str]) -> subprocess.CompletedProcess[str]:
    """Run a command to its end or to the time limit, which counts as a failure."""
    try:
        return subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=TIMEOUT_S
        )
    except subprocess.TimeoutExpired:
        sys.exit(f"{command[0]}: not finished after {TIMEOUT_S} s")


def emulate(machine: str, image: str) -> subprocess.CompletedProcess[str]:
    """Run an image; its semihosting output is the standard output."""
    return run(
        [EMULATOR, "-M", machine, "-nodefaults", "-display", "none"]
        + ["-chardev", "stdio,id=console"]
        + ["-semihosting-config", "enable=on,target=native,chardev=console"]
        + ["-kernel", image]
    )


def main() -> int:
    """Run, compare, and say what differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("machine")
    parser.add_argument("image")
    parser.add_argument("--like", metavar="HOST_PROGRAM")
    arguments = parser.parse_args()
    if shutil.which(EMULATOR) is None:
        print(f"{EMULATOR} is missing: tools/setup installs it")
        return SKIPPED

    target = emulate(arguments.machine, arguments.image)
    print(target.stdout, end="")
    if target.returncode != 0:
        print(target.stderr, end="")
        print(f"{arguments.machine}: exit code {target.returncode}")
        return 1
    if arguments.like is None:
        return 0

    host = run([arguments.like])
    difference = list(
        difflib.unified_diff(
            host.stdout.splitlines(), target.stdout.splitlines(), "host", arguments.machine, n=0
        )
    )
    for line in difference[:40]:
        print(line.rstrip("\n"))
    lines = len(target.stdout.splitlines())
    if host.returncode != 0 or difference or lines == 0:
        print(f"the target's output is not the host's (host exit code {host.returncode})")
        return 1
    print(f"{lines} lines equal to the host's, bit for bit")
    return 0


if __name__ == "__main__":
    sys.exit(main())
