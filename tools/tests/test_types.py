"""The generated types: the same contract in Python and in C."""

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import lcm
import numpy as np
import pytest

from dse import events, lcmtypes

ROOT = Path(__file__).resolve().parents[2]
NAMES = sorted(path.stem for path in (ROOT / "lcmtypes" / "dse").glob("*.lcm"))


def fingerprints(package: object) -> dict[str, int]:
    return {name: getattr(package, name)().get_hash() for name in NAMES}


def test_installed_types_are_those_of_the_lcm_files(tmp_path: Path) -> None:
    sources = [str(ROOT / "lcmtypes" / "dse" / f"{name}.lcm") for name in NAMES]
    generator = [sys.executable, "-c", "import lcm; lcm.run_gen()"]
    subprocess.run([*generator, "--python", "--ppath", str(tmp_path), *sources], check=True)
    code = f"import dse; print({{n: getattr(dse, n)().get_hash() for n in {NAMES}}})"
    fresh = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, check=True, capture_output=True, text=True
    )
    assert fresh.stdout.strip() == str(fingerprints(lcmtypes)), (
        "the .lcm files have changed: pip install -e tools"
    )


def test_fingerprints_are_those_of_the_c_types(tmp_path: Path) -> None:
    compiler = shutil.which("cc")
    headers = Path(importlib.util.find_spec("lcm").origin).parents[1] / "include"  # type: ignore
    if compiler is None or not headers.is_dir():
        pytest.skip("no C compiler or no LCM headers")
    sources = [str(ROOT / "lcmtypes" / "dse" / f"{name}.lcm") for name in NAMES]
    subprocess.run(
        [sys.executable, "-c", "import lcm; lcm.run_gen()", "--c", "--c-no-pubsub"]
        + ["--c-cpath", str(tmp_path), "--c-hpath", str(tmp_path), *sources],
        check=True,
    )
    lines = [f'printf("{n} %lld\\n", (long long)__dse_{n}_get_hash());' for n in NAMES]
    program = [f'#include "dse_{n}.h"' for n in NAMES] + ["#include <stdio.h>", "int main(void) {"]
    (tmp_path / "main.c").write_text("\n".join([*program, *lines, "return 0; }"]))
    subprocess.run(
        [compiler, "-w", f"-I{tmp_path}", f"-I{headers}", "-o", str(tmp_path / "main")]
        + [str(path) for path in tmp_path.glob("*.c")],
        check=True,
    )
    output = subprocess.run([tmp_path / "main"], check=True, capture_output=True, text=True).stdout
    in_c = {name: int(number) % 2**64 for name, number in map(str.split, output.splitlines())}
    assert in_c == fingerprints(lcmtypes)


def test_log_layout_agrees_with_the_generated_decoder() -> None:
    message = lcmtypes.estimate_t()
    message.header.run_id, message.header.sample, message.header.plant_time = 2**60 + 3, 7, 0.25
    message.header.sequence, message.header.round, message.header.network = 5, 4, 3
    message.header.role, message.header.node = 2, 1
    message.health, message.part, message.parts, message.count = 4, 1, 2, 30
    message.diagnostics = 16
    message.state = [float(i) for i in range(32)]
    message.variance = [1e-3 * i for i in range(32)]
    message.diagnostic = [-float(i) for i in range(16)]
    data = message.encode()
    decoded = np.frombuffer(data[8:], dtype=events.layout("estimate_t"))[0]
    for name in lcmtypes.header_t.__slots__:
        assert decoded["header"][name] == getattr(message.header, name)
    for name in lcmtypes.estimate_t.__slots__[1:]:
        np.testing.assert_array_equal(decoded[name], getattr(message, name))


@pytest.mark.parametrize("name", NAMES)
def test_log_layout_has_the_length_of_the_encoded_message(name: str) -> None:
    message = getattr(lcmtypes, name)()
    for member, kind, shape in zip(
        message.__slots__, message.__typenames__, message.__dimensions__, strict=True
    ):
        if kind == "byte" and shape:
            setattr(message, member, bytes(shape[0]))
    assert len(message.encode()) == 8 + events.layout(name).itemsize


def test_lcm_itself_reads_what_we_read(plain: Path) -> None:
    counts: dict[str, int] = {}
    for event in lcm.EventLog(plain, "r"):
        counts[event.channel] = counts.get(event.channel, 0) + 1
    assert counts == dict(events.read(plain).channels)
