"""`python -m tests.rules.gate_proof`: puts defects into a copy of this checkout, one at a time, and shows that tests of
the gate fail for each.

Each lies where the contact, or what a person learns of an alarm, depends on one line. Of the tests only those run that
should notice it, so that the whole takes minutes; all of them pass on the copy without a defect, which is tried first.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from probewatch.tools.shared.interruption import said_when_interrupted
from tests.rules.third import CHOSEN

ROOT = Path(__file__).parents[2]
_OF_EVERY_GATE = "not thorough and not slow and not cart and not deb"
_PASSED, _FAILED = 0, 1
"""Exit codes of pytest where tests ran."""


@dataclass(frozen=True)
class Defect:
    """In file, right becomes wrong. tests: those that should notice, as pytest takes them."""

    what: str
    file: str
    right: str
    wrong: str
    tests: tuple[str, ...]


_LEDGER = "appliance/supervision/ledger.py"
_SUPERVISOR = tuple(
    f"tests/appliance/supervision/test_supervisor{part}.py" for part in ("", "_devices", "_latched", "_recalibration")
)
DEFECTS = (
    Defect(
        "the contact stays closed when the estimator dies",
        "appliance/service/tick.py",
        "heartbeat_ns=self._supervision.heard_ns,",
        "heartbeat_ns=now_ns,",
        ("tests/appliance/service/test_daemon.py::test_a_killed_estimator_alarms_and_recovers_by_itself",),
    ),
    Defect(
        "the age of a verification counts from its arrival",
        _LEDGER,
        "self.verified_ns = shown_ns if stands else None",
        "self.verified_ns = self.now_ns if stands else None",
        _SUPERVISOR,
    ),
    Defect(
        "a latched state is lost at a restart",
        "appliance/service/control/supervision.py",
        "    if latch is None:\n        return Supervisor(durations)",
        "    if latch is None or True:\n        return Supervisor(durations)",
        ("tests/appliance/service/host/test_recorder.py",),
    ),
    Defect(
        "a reload leaves the line the old limits",
        "appliance/service/control/live_configuration.py",
        "self._estimator.set_limits(self.config.limits, ",
        "self._estimator.set_limits(before.limits, ",
        ("tests/appliance/service/control/test_live_configuration.py",),
    ),
    Defect(
        "the watchdog is fed without a write to an output",
        "appliance/service/tick.py",
        "if writes > self._fed_writes:",
        "if writes >= self._fed_writes:",
        ("tests/appliance/service/test_daemon.py::test_a_killed_relay_board_is_an_output_failure_and_comes_back",),
    ),
    Defect(
        "the ring hands out a picture that was overwritten while it was copied",
        "appliance/service/estimator/ring.py",
        "for index, copy in copies if newest - index < self._shape.slots]",
        "for index, copy in copies if newest >= 0]",
        ("tests/appliance/service/estimator/test_ring.py",),
    ),
    Defect(
        "an acknowledged fault stays silent for good",
        _LEDGER,
        "if not self.calibration.active:\n                self._acknowledge_none()",
        "if False:\n                self._acknowledge_none()",
        _SUPERVISOR,
    ),
    Defect(
        "an acknowledged alarm never reminds of itself",
        "appliance/supervision/audio.py",
        "and quiet_ns >= REMINDER_NS",
        "and quiet_ns < 0",
        ("tests/appliance/supervision/test_alarms.py",),
    ),
    Defect(
        "a reference comes in force without an entry in the log",
        "appliance/service/control/recalibration.py",
        "        self._estimator.set_reference(reference.calibration, reference.relative_pose)\n"
        "        self._took(reference)",
        "        self._estimator.set_reference(reference.calibration, reference.relative_pose)",
        ("tests/appliance/service/control/test_reference.py",),
    ),
    Defect(
        "a verification expires a minute late",
        _LEDGER,
        "<= self.durations.max_verification_age_ns",
        "<= self.durations.max_verification_age_ns + 60_000_000_000",
        _SUPERVISOR,
    ),
    Defect(
        "of two alarms at once, of a device and of the line, one is lost",
        _LEDGER,
        "self._note_hazards(failing + self._of_the_line(newest))",
        "self._note_hazards(failing or self._of_the_line(newest))",
        _SUPERVISOR,
    ),
)


class DefectUnfitError(Exception):
    """The code that a defect changes has been changed: it needs another one."""


def put_in(defect: Defect, copy: Path) -> str:
    """Into the copy; returns the file's text without it. Raises DefectUnfitError."""
    file = copy / defect.file
    text = file.read_text() if file.exists() else ""
    if text.count(defect.right) != 1:
        raise DefectUnfitError(
            f"{defect.what}: {defect.file} has {text.count(defect.right)} times, not once: {defect.right.strip()!r}. "
            f"Change the defect in {Path(__file__).name}"
        )
    file.write_text(text.replace(defect.right, defect.wrong))
    return text


def copied(target: Path) -> Path:
    """What git knows and does not ignore of this checkout, as it is now, with what was compiled."""
    listed = ["git", "-C", str(ROOT), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listed, capture_output=True, check=True).stdout.decode().split("\0")
    compiled = [str(path.relative_to(ROOT)) for path in (ROOT / "appliance/core/registration").glob("_compiled*.so")]
    for name in (*names, *compiled):
        if name and (ROOT / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target / name)
    return target


def judged(copy: Path, tests: Sequence[str]) -> tuple[int, list[str], str]:
    """(pytest's exit code, tests that failed, all that it said) in the copy; -1 where it did not test the copy."""
    path = f"{copy / 'tools/development/package'}{os.pathsep}{copy}"
    environment = os.environ | {"PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1", "CI": "", CHOSEN: ""}
    ask = [sys.executable, "-c", "import probewatch.appliance as one; print(one.__file__)"]
    where = subprocess.run(ask, cwd=copy, env=environment, capture_output=True, text=True, check=False).stdout
    if not Path(where.strip()).is_relative_to(copy):
        return -1, [], f"tests would import {where.strip()}, which is not of the copy"
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-m", _OF_EVERY_GATE, *tests]
    done = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True, check=False)
    failed = re.findall(r"^FAILED (\S+::.*?)(?: - .*)?$", done.stdout, re.M)
    return done.returncode, failed, done.stdout + done.stderr


def main(defects: Sequence[Defect] = DEFECTS) -> int:
    """Exit code: 0 where all are noticed, 1 where one is not, 2 where that cannot be told."""
    with tempfile.TemporaryDirectory(prefix="probewatch-gate-proof-") as folder:
        copy = copied(Path(folder).resolve())
        every = list(dict.fromkeys(test for defect in defects for test in defect.tests))
        print(f"gate-proof: without a defect, {len(every)} modules and tests", flush=True)
        code, failed, text = judged(copy, every)
        if code != _PASSED:
            print(f"{text}\nnothing is proved: without a defect these fail: {failed}", file=sys.stderr)
            return 2
        rows = []
        for defect in defects:
            began_s = time.monotonic()
            text = put_in(defect, copy)
            code, failed, _ = judged(copy, defect.tests)
            (copy / defect.file).write_text(text)
            noticed = f"red: {failed[0]}" if code == _FAILED and failed else f"NOT NOTICED (pytest's exit code {code})"
            rows.append(f"| {defect.what} | {defect.file} | {noticed} | {time.monotonic() - began_s:.0f} |")
            print(f"{defect.what}: {noticed}", flush=True)
    print("\n| defect | in | | s |\n|---|---|---|---|")
    print("\n".join(rows))
    lost = sum("NOT NOTICED" in row for row in rows)
    print(f"{len(defects) - lost} of {len(defects)} red")
    return int(lost > 0)


if __name__ == "__main__":
    with said_when_interrupted("gate-proof"):
        sys.exit(main())
