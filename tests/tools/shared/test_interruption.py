"""Long computations that somebody breaks off, as real processes: no worker is left, and it is said what was run."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.polling import until
from tests.support.signals import processes

ROOT = Path(__file__).parents[3]
INVARIANT = (
    ("tests.invariant", "1000000", "7"),
    "invariant, 1,000,000 frames from seed 7; again: make invariant SEED=7 ",
)
FALSE_ALARMS = (
    ("probewatch.tools.development.false_alarms", "--jobs", "2"),
    "false alarms, --seeds 4; what is played is kept in ",
)


def at_work(session: int) -> int:
    """How many of its processes are workers that have begun: Ctrl-C is not for them. multiprocessing's own helper, for
    which it is not either, is none of them.
    """
    ignoring = 0
    for pid in processes(session):
        ignored = re.search(r"^SigIgn:\s*(\w+)$", Path(f"/proc/{pid}/status").read_text(), re.M)
        ignoring += int(ignored[1], 16) >> (signal.SIGINT - 1) & 1 if ignored else 0
    return ignoring - 1


def broken_off(folder: Path, number: signal.Signals, *command: str) -> tuple[int, str]:
    """(exit code, stderr) of what had two workers. SIGINT goes to all of them, as Ctrl-C sends it; SIGTERM to the first
    alone. AssertionError where a process is left.
    """
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    whole = [sys.executable, *command]
    with subprocess.Popen(
        whole, cwd=folder, env=environment, text=True, stderr=subprocess.PIPE, start_new_session=True
    ) as process:
        try:
            until(lambda: at_work(process.pid) >= 2, deadline_s=60)
            (os.killpg if number is signal.SIGINT else os.kill)(process.pid, number)
            _, stderr = process.communicate(timeout=10)
            until(lambda: not processes(process.pid), 2, otherwise=lambda: processes(process.pid))
        finally:
            for pid in processes(process.pid):
                os.kill(pid, signal.SIGKILL)
    return process.returncode, stderr


@pytest.mark.thorough
@pytest.mark.parametrize(("command", "said"), [INVARIANT, FALSE_ALARMS], ids=["invariant", "false-alarms"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_broken_off_it_leaves_no_process_and_says_what_was_run(
    tmp_path: Path, command: tuple[str, ...], said: str, number: signal.Signals
) -> None:
    code, stderr = broken_off(tmp_path, number, "-m", *command)
    assert code == 128 + number
    assert re.search(rf"^interrupted by {number.name}: {re.escape(said)}", stderr, re.M), stderr
    assert "Traceback" not in stderr


@pytest.mark.thorough
def test_a_study_that_is_broken_off_waits_for_no_session_that_was_begun(tmp_path: Path) -> None:
    study = ("study", "--sessions", "in-plane", "--seeds", "2", "--jobs", "2", "--output", str(tmp_path))
    answer = broken_off(tmp_path, signal.SIGINT, "-c", "from probewatch.tools.cli import main; main()", *study)
    assert answer == (130, "\nprobewatch: stopped\n")
