"""A whole cart that gets what other programs leave over: told as that.

That it is said once, and is safe as ever: tests/appliance/service/test_overload.py.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.support.demo_cart import PROBEWATCH
from tests.support.polling import until

pytestmark = pytest.mark.alone


@contextmanager
def busy_programs() -> Iterator[None]:
    """Two for each processor."""
    programs = []
    try:
        for _ in range(2 * (os.cpu_count() or 1)):
            programs.append(subprocess.Popen([sys.executable, "-c", "while True: pass"]))
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait()


def _schedule(pids: list[int], policy: int) -> None:
    for pid in pids:
        for task in Path(f"/proc/{pid}/task").glob("*"):
            os.sched_setscheduler(int(task.name), policy, os.sched_param(0))
            _schedule([int(child) for child in (task / "children").read_text().split()], policy)


@pytest.mark.slow
def test_a_demo_whose_cart_gets_no_time_says_so_and_names_no_fault_for_it() -> None:
    command = [str(PROBEWATCH), "demo", "--fault", "flip-lateral@19"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as demo:
        try:
            parts = until(lambda: len(found := _children(demo.pid)) == 4 and found, 30)
            with busy_programs():
                _schedule(parts, os.SCHED_IDLE)
                out, _ = demo.communicate(timeout=200)
        finally:
            demo.kill()
    assert demo.returncode == 75, out
    assert "overloaded" in out
    assert "Traceback" not in out


def _children(pid: int) -> list[int]:
    tasks = Path(f"/proc/{pid}/task").glob("*")
    return [int(child) for task in tasks for child in (task / "children").read_text().split()]
