"""Compiles generated plants together with the library and calls their functions."""

import ctypes
import shutil
import subprocess
from functools import cache
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
FLAGS = (
    "-std=c11 -O1 -fPIC -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wvla -Werror"
    " -ffp-contract=off -fno-math-errno"
).split()
ROOMS = ("core", "math", "linalg", "ode", "model", "plants")
COMPILER = shutil.which("cc") or shutil.which("gcc")


def compile_c(arguments: list[str], where: Path) -> None:
    """Run the C compiler; its messages are in the exception."""
    include = ["-I", str(ROOT / "lib" / "include")]
    done = subprocess.run(
        [str(COMPILER), *FLAGS, *include, *arguments], cwd=where, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


@cache
def library(where: Path) -> list[str]:
    """Object files of the library's rooms that plants need."""
    where.mkdir()
    sources = [str(p) for room in ROOMS for p in sorted((ROOT / "lib" / room).glob("*.c"))]
    compile_c(["-c", *sources], where)
    return [str(path) for path in sorted(where.glob("*.o"))]


class Compiled:
    """A generated plant (shipped = None) beside the shipped ones."""

    def __init__(self, plant: Path, name: str, objects: Path) -> None:
        target = plant.with_suffix(".so")
        # the name of a shipped plant must not clash
        made = f"-Ddse_plant_{name}=made_plant"
        shim = [str(Path(__file__).with_name("plant_shim.c")), "-DMADE=made_plant"]
        arguments = ["-shared", made, *shim, str(plant), *library(objects), "-o", str(target)]
        compile_c(arguments, plant.parent)
        self.library = ctypes.CDLL(str(target))

    def sizes(self, shipped: str | None = None) -> list[int]:
        """nx, nu, ny, blocks, parameters, sets."""
        found = (ctypes.c_int * 6)()
        assert self.library.shim_sizes(shipped.encode() if shipped else None, found)
        return list(found)

    def status(self, what: str, *arguments, **options) -> int:  # noqa: ANN002, ANN003
        """Only the status of a call."""
        return self.call(what, *arguments, **options)[0]

    def value(self, what: str, *arguments, **options) -> np.ndarray:  # noqa: ANN002, ANN003
        """The result of a call that must succeed."""
        status, out = self.call(what, *arguments, **options)
        assert status == 0, f"{what}: status {status}"
        return out

    def call(
        self,
        what: str,
        x: np.ndarray,
        u: np.ndarray | None,
        i: int = 0,
        *,
        set_: int = 0,
        shipped: str | None = None,
        values: np.ndarray | None = None,
        dx: np.ndarray | None = None,
        t: float = 0.0,
        length: int = 400,
    ) -> tuple[int, np.ndarray]:
        """Status and what was written; the length is found from what stays untouched."""
        out = np.full(length, -7.25e77)
        pointers = [
            None if v is None else np.ascontiguousarray(v, float) for v in (values, x, u, dx, out)
        ]
        raw = [
            None if v is None else v.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
            for v in pointers
        ]
        status = self.library.shim_call(
            shipped.encode() if shipped else None,
            set_,
            raw[0],
            what.encode(),
            i,
            ctypes.c_double(t),
            *raw[1:4],
            out.ctypes.data_as(ctypes.POINTER(ctypes.c_double)),
        )
        return status, out[out != -7.25e77]
