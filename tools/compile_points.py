"""Build hook of hatchling: compiles `appliance/core/points.c` with the C compiler that Zig's wheel from PyPI carries.

So a machine needs no compiler of its own, and one machine builds for another: PROBEWATCH_MACHINE names it (x86_64,
aarch64), where it is not this one.
"""

import os
import platform
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SOURCE, LIBRARY = "appliance/core/points.c", "appliance/core/_points.so"
OLDEST = {"x86_64": "x86_64_v2", "aarch64": "generic"}
"""Machine → the least processor it runs on. x86-64-v2 is what NumPy itself asks for."""
GLIBC = "2.28"
FLAGS = [
    "-std=c11", "-O3", "-fassociative-math", "-fno-signed-zeros", "-fno-trapping-math", "-fno-math-errno",
    "-ffp-contract=off", "-Wall", "-Wextra", "-Werror",
]  # fmt: skip
"""Sums may be taken in any order; nothing else about floating point is relaxed."""


class CompilePoints(BuildHookInterface):  # type: ignore[misc]
    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """A wheel carries the library; an editable installation finds it beside its source."""
        machine = os.environ.get("PROBEWATCH_MACHINE", platform.machine())
        if version == "editable":
            library = Path(self.root) / LIBRARY
        else:
            library = Path(self.directory) / f"points-{machine}.so"
            build_data["force_include"][str(library)] = LIBRARY
        compiled(Path(self.root) / SOURCE, library, machine)
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-linux_{machine}"


def compiled(source: Path, library: Path, machine: str) -> None:
    """Raises SystemExit for a machine that is not in the table, CalledProcessError where the compiler fails."""
    if machine not in OLDEST:
        sys.exit(
            f"probewatch is built for {' and '.join(OLDEST)}; this is '{machine}': add it to {Path(__file__).name}"
        )
    library.parent.mkdir(parents=True, exist_ok=True)
    target = ["-target", f"{machine}-linux-gnu.{GLIBC}", f"-mcpu={OLDEST[machine]}", "-shared", "-fPIC"]
    with tempfile.TemporaryDirectory() as cache:
        places = {"ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache}
        new = Path(cache) / library.name
        command = [sys.executable, "-m", "ziglang", "cc", *FLAGS, *target, "-s"]
        subprocess.run([*command, "-o", str(new), str(source)], check=True, env=os.environ | places)
        library.with_suffix(".new").write_bytes(new.read_bytes())
    library.with_suffix(".new").replace(library)
