"""A whole cart that gets what other programs leave over: told as that, once, and safe as ever."""

import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from appliance.storage.alarm_chain import read_log
from tests.support.demo_cart import PROBEWATCH, Cart
from tests.support.polling import until

pytestmark = pytest.mark.alone

BUSY_S = 15.0
MOST_ENTRIES = 15
"""The overload, its end, one for each kind of change, and those from before it is known: two seconds at most."""


@pytest.fixture
def cart(tmp_path: Path) -> Iterator[Cart]:
    with Cart(tmp_path, trusting=True) as cart:
        yield cart


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


@contextmanager
def starved(cart: Cart) -> Iterator[None]:
    """Every part of the cart may compute only when none of the busy programs wants to."""
    parts = [part.process.pid for part in (*cart.twins.values(), cart.daemon) if part is not None]
    try:
        with busy_programs():
            _schedule(parts, os.SCHED_IDLE)
            yield
    finally:
        _schedule(parts, os.SCHED_OTHER)


def _schedule(pids: list[int], policy: int) -> None:
    for pid in pids:
        for task in Path(f"/proc/{pid}/task").glob("*"):
            os.sched_setscheduler(int(task.name), policy, os.sched_param(0))
            _schedule([int(child) for child in (task / "children").read_text().split()], policy)


def test_an_overload_is_said_once_and_blames_no_cable(cart: Cart) -> None:
    cart.wait_for("monitoring")
    until(cart.contact)
    until(lambda: cart.status()["load"]["overloaded_s"] is None, 30)
    began_s = time.monotonic()
    with starved(cart):
        until(lambda: cart.contact(began_s) is False, BUSY_S)
        until(lambda: cart.daemon.find(began_s, event="overloaded"), BUSY_S)
        time.sleep(max(0.0, began_s + BUSY_S - time.monotonic()))
    until(lambda: cart.daemon.find(began_s, event="overload ended"), 30)
    cart.wait_for("monitoring", 30)
    said = Counter(event["event"] for event in cart.daemon.said if event["heard_s"] > began_s)
    assert (said["overloaded"], said["overload ended"]) == (1, 1)
    assert said["device lost"] <= 2 * len(cart.twins), "one of each before it is known, and one after"
    until(lambda: cart.status()["log"]["waiting"] == 0)
    reading = read_log(cart.folder / "alarms")
    entries = Counter(entry.event for entry in reading.entries)
    assert reading.damages == ()
    assert (entries["overloaded"], entries["overload-ended"]) == (1, 1)
    assert entries["state"] <= MOST_ENTRIES, entries
    explained = [entry for entry in reading.entries if "overloaded" in str(entry.data.get("reason"))]
    assert explained, "a silent device is told with the overload"


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
