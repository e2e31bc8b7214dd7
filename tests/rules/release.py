"""`python -m tests.rules.release`: every target that judges, one after the other, whatever fails, and a table of them.

Where this user may not run one, the table says so. Exit code 1 where one failed.
"""

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from probewatch.tools.shared.interruption import said_when_interrupted

ROOT = Path(__file__).parents[2]
PARTS = (
    *(("test",), ("demo",), ("thorough",), ("slow",), ("invariant", "FRAMES=100000"), ("mutation",), ("live",)),
    *(("gate-proof",), ("pythons",), ("test-deb",), ("igtl-soak",), ("vulnerabilities",)),
)
"""Targets of make with their variables. `live` walks docs/failures.md too, and `test-deb` builds for every suite."""
OF_A_MACHINE = (("test-cart",), ("soak",))
"""They mount, and start a machine: root alone may."""


def main(make: Sequence[str] = ("make", "-C", str(ROOT)), root: bool = os.geteuid() == 0) -> int:
    table: list[tuple[str, str, str]] = []
    for part in (*PARTS, *OF_A_MACHINE):
        if part in OF_A_MACHINE and not root:
            table.append((" ".join(part), "", "LEFT OUT: needs root"))
            continue
        code, passed_s = _run([*make, *part])
        table.append((" ".join(part), f"{passed_s:.0f}", "passed" if code == 0 else f"FAILED, exit code {code}"))
    print("\n| make | s | |\n|---|---|---|")
    for row in table:
        print(f"| {' | '.join(row)} |")
    return int(any(result.startswith("FAILED") for _, _, result in table))


def _run(command: list[str]) -> tuple[int, float]:
    """(exit code, s). Broken off, it ends the part first."""
    print(f"\n=== {' '.join(command)}", flush=True)
    began_s = time.monotonic()
    with (
        subprocess.Popen(command, stdin=subprocess.DEVNULL) as process,
        said_when_interrupted(f"release-check, in {' '.join(command)}"),
    ):
        try:
            code = process.wait()
        finally:
            process.terminate()
    return code, time.monotonic() - began_s


if __name__ == "__main__":
    sys.exit(main())
