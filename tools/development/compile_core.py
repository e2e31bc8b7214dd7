"""Compiles `appliance/core/registration/*.c` as hatchling's build hook, with the C compiler of Zig's wheel from PyPI.

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

CORE = "appliance/core/registration"
PACKAGE = "tools/development/package/probewatch/__init__.py"
BUILDS = {
    "x86_64": {"_compiled.so": "x86_64_v2", "_compiled_avx2.so": "x86_64_v2+avx2"},
    "aarch64": {"_compiled.so": "generic"},
}
"""Machine → library → the least processor on which it runs. x86-64-v2 is what NumPy itself requires; AVX2 takes two
thirds of the time."""
GLIBC = "2.28"
FLAGS = [
    "-std=c11", "-O3", "-fassociative-math", "-fno-signed-zeros", "-fno-trapping-math", "-fno-math-errno",
    "-ffp-contract=off", "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror",
]  # fmt: skip
"""Sums may be taken in any order; nothing else about floating point is relaxed."""


class CompileCore(BuildHookInterface):  # type: ignore[misc]
    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compiles the libraries. A wheel carries libraries and package; an editable installation finds both beside
        their source.
        """
        machine = os.environ.get("PROBEWATCH_MACHINE", platform.machine())
        if machine not in BUILDS:
            sys.exit(
                f"probewatch is built for {' and '.join(BUILDS)}; this is '{machine}': add it to {Path(__file__).name}"
            )
        core = Path(self.root) / CORE
        place = core if version == "editable" else Path(self.directory) / machine
        for name, processor in BUILDS[machine].items():
            compiled(sorted(core.glob("*.c")), place / name, f"{machine}-linux-gnu.{GLIBC}", processor)
            if version != "editable":
                build_data["force_include"][str(place / name)] = f"probewatch/{CORE}/{name}"
        if version != "editable":
            build_data["force_include"][str(Path(self.root) / PACKAGE)] = "probewatch/__init__.py"
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-linux_{machine}"


def compiled(sources: list[Path], library: Path, target: str, processor: str) -> None:
    """Compiles the sources to a library. Raises CalledProcessError where the compiler fails."""
    library.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as cache:
        places = {"ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache}
        new = Path(cache) / library.name
        command = [sys.executable, "-m", "ziglang", "cc", *FLAGS, "-target", target, f"-mcpu={processor}", "-s"]
        subprocess.run([*command, "-o", str(new), *map(str, sources), "-lm"], check=True, env=os.environ | places)
        library.with_suffix(".new").write_bytes(new.read_bytes())
    library.with_suffix(".new").replace(library)
