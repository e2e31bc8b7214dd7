"""`python -m tests.rules.retried OPTIONS OF PYTEST`: a module in real time in which tests fail is run once more, alone.

A machine that is short of time for a moment fails such a test too; a fault of the program fails it again. The whole
module runs again, as its tests share a simulated cart: what one of them leaves behind is found again, and failures
that follow from one another count as one. Both results are printed, so that neither is hidden.

Where this computer was too busy with other programs during the second run as well (machine_load.py), the module is
printed as NOT JUDGED, with the figures, and fails nothing; what was not judged is listed at the end.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from itertools import groupby
from pathlib import Path

from tests.rules.deadline import UNTIL
from tests.rules.machine_load import Load, LoadMeter

MOST = 4
"""So many modules may fail by chance in one run on a quiet machine; more are no chance, and are not run again. Where
the workers were too many for the machine, each module that failed is: alone it has to pass.
"""
_FAILED = 1
"""pytest's exit code where tests ran and some failed; every other one but 0 is no result at all."""
_WORKERS = "-n"
"""The option by which a whole run shares the processors; a module alone has them to itself."""


def main(
    options: list[str],
    too_busy: Callable[[Load], bool] = Load.too_busy,
    too_slow: Callable[[Load], bool] = Load.too_slow,
) -> int:
    """Exit code: that of pytest; 0 where everything passed at last or could not be judged."""
    with tempfile.TemporaryDirectory() as folder:
        code, load = _pytest(options, folder)
        failed = _failed(Path(folder)) if code == _FAILED else {}
    print(f"\nin the whole run {load}", flush=True)
    if not failed:
        return code
    if len(failed) > MOST and not (too_busy(load) or too_slow(load)):
        print(f"tests failed in {len(failed)} modules: too many for chance, so none is run again", flush=True)
        return code
    os.environ.pop(UNTIL, None)  # what is left out the second time would pass for what passed
    results = {module: _again(module, tests, _alone(options), too_busy) for module, tests in failed.items()}
    print("", *(said for _, said in results.values()), sep="\n", flush=True)
    return int(not all(good for good, _ in results.values()))


def _again(module: str, tests: list[str], options: list[str], too_busy: Callable[[Load], bool]) -> tuple[bool, str]:
    """(whether it fails nothing, what to say of it) of a module with the machine to itself."""
    names = ", ".join(test.removeprefix(f"{module}::") for test in tests)
    print(f"\n{module}: failed in the whole run, once more alone: {names}", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        code, load = _pytest([*options, module], folder)
    good, alone = second_result(code, load, too_busy(load))
    said = f"{module}: failed in the whole run ({names}), {alone}"
    print(said, flush=True)
    return good, said


def second_result(code: int, load: Load, busy: bool) -> tuple[bool, str]:
    """(whether it fails nothing, what to say of it) of a run alone, by pytest's exit code. Only tests that ran and
    failed may be left unjudged: what could not even run did not fail for want of time.
    """
    if code == 0:
        return True, "passed alone"
    if code == _FAILED and busy:
        return True, f"NOT JUDGED: this computer was too busy ({load})"
    return False, f"failed alone ({load})"


def _alone(options: list[str]) -> list[str]:
    """Which tests are asked for stays; who shares the processors does not."""
    at = options.index(_WORKERS) if _WORKERS in options else len(options)
    return options[:at] + options[at + 2 :]


def _pytest(options: list[str], cache: str) -> tuple[int, Load]:
    command = [sys.executable, "-m", "pytest", "-o", f"cache_dir={cache}", *options]
    with LoadMeter() as meter:
        code = subprocess.run(command, check=False).returncode
    return code, meter.load


def _failed(cache: Path) -> dict[str, list[str]]:
    """Module → its tests that failed, as pytest remembers them of the last run."""
    remembered: dict[str, bool] = json.loads((cache / "v/cache/lastfailed").read_text())
    by_module = groupby(sorted(remembered), key=lambda test: test.split("::", maxsplit=1)[0])
    return {module: list(tests) for module, tests in by_module}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
