"""`python -m tests.rules.retried OPTIONS OF PYTEST`: a module in real time in which tests fail is run once more, alone.

A machine that is short of time for a moment fails such a test too; a fault of the program fails it again. The whole
module runs again, as its tests share a simulated cart: what one of them leaves behind is found again, and failures
that follow from one another count as one. Both results are printed; what fails again fails the run.
"""

import json
import subprocess
import sys
import tempfile
from itertools import groupby
from pathlib import Path

MOST = 4
"""So many modules may fail by chance in one run; more are no chance, and none of them is run again."""
_FAILED = 1
"""pytest's exit code where tests ran and some failed; every other one but 0 is no result at all."""
_WORKERS = "-n"
"""The option by which a whole run shares the processors; a module alone has them to itself."""


def main(options: list[str]) -> int:
    """Exit code: that of pytest; 0 where everything passed at last."""
    with tempfile.TemporaryDirectory() as folder:
        code = _pytest(options, folder)
        failed = _failed(Path(folder)) if code == _FAILED else {}
    if not failed:
        return code
    if len(failed) > MOST:
        print(f"\ntests failed in {len(failed)} modules: too many for chance, so none is run again", flush=True)
        return code
    results = [_again(module, tests, _alone(options)) for module, tests in failed.items()]
    print("", *(said for _, said in results), sep="\n", flush=True)
    return int(not all(passed for passed, _ in results))


def _again(module: str, tests: list[str], options: list[str]) -> tuple[bool, str]:
    """(whether it passes, what to say of it) of a module with the machine to itself."""
    names = ", ".join(test.removeprefix(f"{module}::") for test in tests)
    print(f"\n{module}: failed in the whole run, once more alone: {names}", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        code = _pytest([*options, module], folder)
    return code == 0, f"{module}: failed in the whole run ({names}), {'failed' if code else 'passed'} alone"


def _alone(options: list[str]) -> list[str]:
    """Which tests are asked for stays; who shares the processors does not."""
    at = options.index(_WORKERS) if _WORKERS in options else len(options)
    return options[:at] + options[at + 2 :]


def _pytest(options: list[str], cache: str) -> int:
    command = [sys.executable, "-m", "pytest", "-o", f"cache_dir={cache}", *options]
    return subprocess.run(command, check=False).returncode


def _failed(cache: Path) -> dict[str, list[str]]:
    """Module → its tests that failed, as pytest remembers them of the last run."""
    remembered: dict[str, bool] = json.loads((cache / "v/cache/lastfailed").read_text())
    by_module = groupby(sorted(remembered), key=lambda test: test.split("::", maxsplit=1)[0])
    return {module: list(tests) for module, tests in by_module}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
