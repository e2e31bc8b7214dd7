"""`python -m tests.rules.retried ARGUMENTS OF PYTEST`: a test in real time that fails is run once more, alone.

A machine that is short of time for a moment fails such a test too; a fault of the program fails it again. Both results
are printed, so that neither is hidden. Only a test that fails twice fails the run.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

MOST = 4
"""So many tests may fail by chance in one run; more are no chance, and are not run again."""
_FAILED = 1
"""pytest's exit code where tests ran and some failed; every other one but 0 is no result at all."""


def main(arguments: list[str]) -> int:
    """Exit code: that of pytest; 0 where everything passed at last."""
    with tempfile.TemporaryDirectory() as folder:
        code = _pytest(arguments, folder)
        failed = _failed(Path(folder)) if code == _FAILED else []
    if not failed:
        return code
    if len(failed) > MOST:
        print(f"\n{len(failed)} tests failed: too many for chance, so none is run again", flush=True)
        return code
    passed = [_again(test) for test in failed]
    return int(not all(passed))


def _again(test: str) -> bool:
    """Whether it passes with the machine to itself."""
    print(f"\nfailed in the whole run, once more alone: {test}", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        passed = _pytest([test], folder) == 0
    print(f"{test}: failed in the whole run, {'passed' if passed else 'failed'} alone", flush=True)
    return passed


def _pytest(arguments: list[str], cache: str) -> int:
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-o", f"cache_dir={cache}", *arguments], check=False
    ).returncode


def _failed(cache: Path) -> list[str]:
    """What pytest remembers of the last run."""
    remembered: dict[str, bool] = json.loads((cache / "v/cache/lastfailed").read_text())
    return list(remembered)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
