"""What the estimator does before its first picture: every rare path once, and its pages stay in memory."""

import subprocess
import sys

from probewatch.appliance.core.detectors import picture_chain
from probewatch.appliance.core.registration import realtime_tracker
from probewatch.appliance.core.warm_up import warm_up


def test_the_search_and_the_explanation_of_a_mirrored_picture_are_run(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    run: list[str] = []
    explanation, search = picture_chain.flip_or_zoom_of, realtime_tracker.RealTimeTracker._search
    monkeypatch.setattr(picture_chain, "flip_or_zoom_of", lambda *a: run.append("explanation") or explanation(*a))
    monkeypatch.setattr(realtime_tracker.RealTimeTracker, "_search", lambda *a: run.append("search") or search(*a))
    warm_up(320, 240)
    assert {"explanation", "search"} <= set(run)


def test_a_process_that_may_locks_its_memory_and_says_so() -> None:
    code = (
        "from probewatch.appliance.service.host.resident_memory import lock_memory; from pathlib import Path; "
        "locked = lock_memory(); "
        "vm = dict(line.split(':', 1) for line in Path('/proc/self/status').read_text().splitlines()); "
        "assert locked == (int(vm['VmLck'].split()[0]) > 0); bytearray(50_000_000)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_what_is_loaded_is_collected_no_more() -> None:
    code = (
        "import gc, probewatch.appliance.core.line; "
        "from probewatch.appliance.service.host.resident_memory import keep_what_is_loaded; "
        "before = len(gc.get_objects()); keep_what_is_loaded(); "
        "assert len(gc.get_objects()) < before / 100 and gc.isenabled()"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
