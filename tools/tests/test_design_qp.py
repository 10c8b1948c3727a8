"""Generated OSQP workspaces: built with the library, run on the host and on a Cortex-M in QEMU."""

import shutil
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from compiled import COMPILER, ROOT
from conftest import Command
from test_design_mhe_check import model, write

from dse.design.qp import generate, window_qp
from dse.design.window import window
from dse.errors import UserError

EMBEDDED = ROOT / "tests" / "embedded"
ARM = shutil.which("arm-none-eabi-gcc")
EMULATOR = shutil.which("qemu-system-arm")
BASE = "-std=c11 -O1 -ffp-contract=off -fno-math-errno -ffunction-sections".split()
M4F = "-mthumb -mcpu=cortex-m4 -mfpu=fpv4-sp-d16 -mfloat-abi=hard".split()
BARE = (
    f"--specs=nano.specs -nostartfiles -T {EMBEDDED / 'target' / 'memory.ld'} -Wl,--gc-sections"
).split()
RUN = [sys.executable, str(EMBEDDED / "checks" / "run_image.py"), "mps2-an386"]
BOARD = pytest.mark.skipif(not (ARM and EMULATOR), reason="no ARM compiler or emulator")


def build(folder: Path, real: str, compiler: str | None, extra: list[str]) -> Path:
    """The probe, the generated code and what it needs of the library, as one program."""
    sources = [Path(__file__).with_name("qp_shim.c"), EMBEDDED / "cases" / "report.c"]
    sources += [p for room in ("core", "math", "linalg") for p in (ROOT / "lib" / room).glob("*.c")]
    names = "active_set active_set_dual active_set_solve active_set_swap window_qp"
    names += " window_qp_certificate window_qp_factor window_qp_solve window_qp_osqp"
    sources += [ROOT / "lib" / "mhe" / f"{name}.c" for name in names.split()]
    sources += [*folder.glob("*.c"), *(folder / "src").glob("*.c")]
    includes = [folder, folder / "inc" / "public", folder / "inc" / "private"]
    includes += [ROOT / "lib" / "include", EMBEDDED / "cases", EMBEDDED / "target"]
    program = folder / f"probe_{Path(compiler or 'none').name}"
    command = [str(compiler), *BASE, f"-DDSE_REAL_IS_{real}=1", *extra]
    command += [f"-I{one}" for one in includes] + [str(one) for one in sources]
    done = subprocess.run([*command, "-lm", "-o", str(program)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return program


def states(command: list[str]) -> dict[str, list[float]]:
    """What the probe reports: numbers by name, without index."""
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    found: dict[str, list[float]] = {}
    for line in done.stdout.splitlines():
        name, _, value = line.partition(" ")
        name = name.partition("[")[0]
        if name in ("own", "osqp"):
            found.setdefault(name, []).append(struct.unpack(">d", bytes.fromhex(value))[0])
        elif name in ("path", "active"):
            found.setdefault(name, []).append(float(value))
    return found


def generated(folder: Path, single: bool) -> Path:
    generate(window_qp(model("CSTR2"), 6), folder, "probe", single)
    return folder


@pytest.fixture(scope="module")
def host(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[float]]:
    """The probe's report on the host, in double precision."""
    if not COMPILER:
        pytest.skip("no C compiler")
    folder = generated(tmp_path_factory.mktemp("host") / "code", False)
    platform = EMBEDDED / "host" / "platform.c"
    return states([str(build(folder, "double", COMPILER, [str(platform)]))])


def test_the_active_set_of_a_generated_workspace_leads_to_the_solution(
    host: dict[str, list[float]],
) -> None:
    assert max(host["active"]) >= 3
    assert host["path"].count(2) >= 3  # the backend's set, not only the empty one
    np.testing.assert_allclose(host["osqp"], host["own"], rtol=1e-10, atol=1e-11)


@BOARD
@pytest.mark.parametrize("real, near", [("double", 1e-8), ("float", 1e-3)])
def test_a_32_bit_processor_gives_the_hosts_numbers(
    tmp_path: Path, host: dict[str, list[float]], real: str, near: float
) -> None:
    board = [str(EMBEDDED / "target" / name) for name in ("startup.c", "semihosting.c")]
    folder = generated(tmp_path / "code", real == "float")
    target = states([*RUN, str(build(folder, real, ARM, [*M4F, *BARE, *board]))])
    largest = max(abs(value) for value in host["own"])
    assert target["path"] == host["path"]
    for which in ("osqp", "own"):
        apart = np.max(np.abs(np.subtract(target[which], host[which]))) / largest
        print(f"{real}, {which}: {apart:.1e} of the largest")
        assert apart <= near


def test_blocks_are_those_of_the_stacked_window() -> None:
    whole = model("CSTR2")
    qp, stacked = window_qp(whole, 5), window(whole, 5)
    # the window is stacked by subsystem, the programme by sample
    order = [i * 10 + j * 2 + s for j in range(5) for i in range(2) for s in range(2)]
    np.testing.assert_allclose(qp.P(), stacked.Psi[np.ix_(order, order)], rtol=1e-12)


def test_windows_that_determine_nothing_are_refused() -> None:
    whole = model("SEP3_pred")
    with pytest.raises(UserError, match="two samples"):
        window_qp(whole, 1)
    whole.C = np.zeros_like(whole.C)
    with pytest.raises(UserError, match="do not determine"):
        window_qp(whole, 5)


def test_the_command_says_what_is_wrong(tmp_path: Path, dse: Command) -> None:
    file = str(write(tmp_path / "plant.yaml", "CSTR2", 6, 2))
    out = ("-o", str(tmp_path / "never"))
    good = dse("design", "qp", file, "-o", str(tmp_path / "one"), "--subsystem", "2", "--float")
    assert good.code == 0 and "12 unknowns, 10 rows" in good.out
    assert "window_qp_backend" in (tmp_path / "one" / "window_qp.h").read_text()
    for arguments, message in (
        (("--subsystem", "3"), "there are 2"),
        (("--name", "no name"), "not a name in C"),
        (("--network", "other"), "other"),
    ):
        done = dse("design", "qp", file, *out, *arguments)
        assert done.code == 2 and message in done.err
    assert not (tmp_path / "never").exists()
