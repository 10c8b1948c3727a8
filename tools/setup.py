"""Generates dse.lcmtypes with lcm-gen from ../lcmtypes/dse/*.lcm; all else is in pyproject.toml."""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

TOOLS = Path(__file__).resolve().parent
TYPES = TOOLS.parent / "lcmtypes" / "dse"


def generate(types: Path, destination: Path) -> None:
    """Write the Python codecs of types/*.lcm into destination/dse/lcmtypes.

    The LCM package is called dse, as ours is. So lcm-gen reads copies whose package line says
    dse.lcmtypes; fingerprints do not depend on it.
    """
    sources = sorted(types.glob("*.lcm"))
    if not sources:
        raise SystemExit(f"{types}: no .lcm files; install from a checkout of the whole repository")
    with tempfile.TemporaryDirectory() as work:
        for source in sources:
            text, count = re.subn(
                r"^package dse;", "package dse.lcmtypes;", source.read_text(), flags=re.MULTILINE
            )
            if count != 1:
                raise SystemExit(f"{source}: needs the line 'package dse;' exactly once")
            (Path(work) / source.name).write_text(text)
        subprocess.run(
            [sys.executable, "-c", "import lcm; lcm.run_gen()", "--python", "--ppath", work]
            + [str(Path(work) / source.name) for source in sources],
            check=True,
        )
        package = destination / "dse" / "lcmtypes"
        package.mkdir(parents=True, exist_ok=True)
        for old in package.glob("*.py"):
            old.unlink()
        for made in (Path(work) / "dse" / "lcmtypes").glob("*.py"):
            (package / made.name).write_text(made.read_text())


class BuildPy(build_py):
    """build_py that also generates: into the build, or into the source for an editable install."""

    def run(self) -> None:
        """Copy the package, then add the generated types."""
        super().run()
        generate(TYPES, TOOLS if self.editable_mode else Path(self.build_lib).resolve())


if __name__ == "__main__":
    setup(cmdclass={"build_py": BuildPy})
