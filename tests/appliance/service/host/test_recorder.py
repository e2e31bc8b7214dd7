"""The thread that writes the alarm log: what is taken away, full, silent or of another version, and what it does then.

A disk that does not answer is a pipe that nobody reads: opening it for writing waits in the kernel for ever, as writing
on a dead disk does. A pipe that nobody writes stands for one that cannot be read.
"""

import io
import json
import os
import shutil
import stat
import threading
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
import structlog

from probewatch.appliance.configuration.config import Config
from probewatch.appliance.service.control.supervision import supervisor_after
from probewatch.appliance.service.host import recorder as room
from probewatch.appliance.service.host.log import configure
from probewatch.appliance.service.host.own_files import own_files
from probewatch.appliance.service.host.recorder import Recorder
from probewatch.appliance.storage.alarm_chain import MEMORY, Event, Latch
from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.appliance.supervision.supervisor import Inputs
from probewatch.appliance.types import State
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import DeviceLost
from tests.support.polling import until
from tests.support.stopwatch import Stopwatch

HALT = Latch("halt", "scale")


@pytest.fixture(autouse=True)
def said(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[dict[str, object]]]:
    """Lines of the log so far. The recorder shares no open file with the test, so it cannot print them itself."""
    lines: list[dict[str, object]] = []

    class Stream(io.StringIO):
        def write(self, line: str) -> int:
            lines.append(json.loads(line))
            return len(line)

    with configure("info", Stream()):
        yield lines
    structlog.reset_defaults()


@pytest.fixture
def recorder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Recorder]:
    monkeypatch.setattr(room, "RETRY_S", 0.02)
    recorder = Recorder(tmp_path / "log", HostClock())
    yield recorder
    recorder.close()


def test_a_look_at_the_room_on_the_disk_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Looked at though nothing is written; a folder that is gone is no damage before an entry is missed."""
    monkeypatch.setattr(room, "_LOOK_S", 0.02)
    recorder = Recorder(tmp_path / "log", HostClock())
    try:
        until(lambda: recorder.free_bytes)
        disk = os.statvfs(tmp_path)
        assert recorder.free_bytes == pytest.approx(disk.f_bavail * disk.f_frsize, rel=0.1)
        (tmp_path / "log").rename(tmp_path / "away")
        until(lambda: recorder.free_bytes is None)
        time.sleep(0.2)  # ten more looks
        assert (recorder.damage, recorder.failing) == ((), None)
        (tmp_path / "away").rename(tmp_path / "log")
        until(lambda: recorder.free_bytes)
    finally:
        recorder.close()
    assert recorder.failure is None


def test_a_folder_that_is_taken_away_alarms_and_the_log_goes_on(recorder: Recorder, tmp_path: Path) -> None:
    recorder.note("state", HALT)
    until(lambda: recorder.written == 2)
    shutil.rmtree(tmp_path / "log")
    recorder.note("state", HALT)
    until(lambda: recorder.waiting == 0)
    assert (recorder.damage, recorder.failing) == (("log-damaged",), None)
    again = AlarmLog(tmp_path / "log")
    assert (again.latch, again.damage) == (HALT, ("log-damaged",))


def test_damage_that_was_accepted_while_nothing_can_be_opened_stays_accepted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(room, "RETRY_S", 0.02)
    (tmp_path / "log").write_text("a file where the folder should be")
    recorder = Recorder(tmp_path / "log", HostClock())
    assert (recorder.damage, recorder.failing) == (("memory-damaged",), "File exists")
    recorder.note("started", None)
    recorder.accept_damage("memory-damaged")
    with pytest.raises(AssertionError):
        until(lambda: recorder.damage, 0.3)
    (tmp_path / "log").unlink()
    until(lambda: recorder.waiting == 0)
    assert (recorder.damage, recorder.failing) == ((), None)
    recorder.close()


def silent_segment(tmp_path: Path) -> Path:
    """The first segment, on a disk that does not answer."""
    (tmp_path / "log").mkdir()
    segment = tmp_path / "log" / "alarms-00000001.jsonl"
    os.mkfifo(segment)
    return segment


def answer(segment: Path) -> None:
    """The disk says something at last: that what was written there is no file."""
    gone = segment.rename(segment.with_name("gone"))
    os.close(os.open(gone, os.O_RDONLY | os.O_NONBLOCK))


def test_a_disk_that_does_not_answer_is_named_and_nothing_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: list[dict[str, object]]
) -> None:
    monkeypatch.setattr(room, "_SILENT_NS", 300_000_000)
    monkeypatch.setattr(room, "RETRY_S", 0.02)
    segment = silent_segment(tmp_path)
    recorder = Recorder(tmp_path / "log", HostClock())
    watch = Stopwatch()
    for number in range(100):
        recorder.note("state", HALT, number=number)
        recorder.watch()
    assert watch.spent_s() < 1, "a note waits for nothing"
    assert f"{segment} has not answered for" in until(lambda: recorder.failing)
    lines = len(said)
    recorder.watch(overloaded=True)
    assert len(said) == lines, "a computer short of time is no fault of the disk"
    for _ in range(3):
        recorder.watch()
    answer(segment)
    until(lambda: recorder.waiting == 0 and recorder.failing is None)

    def answers_again() -> int:
        recorder.watch()
        return [line["event"] for line in said].count("the disk of the alarm log answers again")

    assert until(answers_again) == 1
    recorder.close()
    entries = AlarmLog(tmp_path / "log").opened.entries
    assert [entry.data["number"] for entry in entries if entry.event == "state"] == list(range(100))
    whats = [str(line["what"]) for line in said if line["event"] == "alarm log cannot be written"]
    assert [str(segment) in what for what in whats].count(True) == 1, "said once"


def test_a_log_that_cannot_be_read_keeps_the_service_waiting_for_a_moment_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(room, "OPEN_S", 0.2)
    monkeypatch.setattr(room, "_SILENT_NS", 100_000_000)
    log = AlarmLog(tmp_path / "log")
    log.append(datetime(2026, 1, 1, tzinfo=UTC), 0, "state", {}, HALT)
    memory = (tmp_path / "log" / MEMORY).rename(tmp_path / "kept")
    os.mkfifo(tmp_path / "log" / MEMORY)
    recorder = Recorder(tmp_path / "log", HostClock())
    assert (recorder.damage, recorder.latch) == (("memory-damaged",), None), "what was latched is not known"
    assert str(tmp_path / "log") in (recorder.failing or "")
    recorder.note("started", None)
    with (tmp_path / "log" / MEMORY).open("wb") as pipe:
        pipe.write(memory.read_bytes())
    until(lambda: recorder.waiting == 0)
    assert (recorder.damage, recorder.failing) == (("memory-damaged",), None), "a person must see it"
    recorder.close()
    assert [entry.event for entry in AlarmLog(tmp_path / "log").opened.entries][-2:] == ["state", "started"]


def test_a_long_log_that_is_whole_takes_its_time_and_is_no_damage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """38,001 entries took more than two seconds on a busy computer: what was latched was not read."""
    log = AlarmLog(tmp_path / "log")
    for _ in range(20):
        log.append(datetime(2026, 1, 1, tzinfo=UTC), 0, "state", {"text": "x" * 10_000}, HALT)
    monkeypatch.setattr(room, "OPEN_S", 0.1)
    monkeypatch.setattr(room, "AlarmLog", lambda folder: time.sleep(0.3) or AlarmLog(folder))
    recorder = Recorder(tmp_path / "log", HostClock())
    assert (recorder.latch, recorder.damage, recorder.written) == (HALT, (), 21)
    recorder.close()
    monkeypatch.setattr(room, "_LONGEST_OPEN_S", 0.1)
    late = Recorder(tmp_path / "log", HostClock())
    assert (late.latch, late.damage) == (None, ("memory-damaged",)), "the alarm is not held up for ever"
    until(lambda: late.written)
    late.close()


def test_a_lock_whose_file_was_deleted_keeps_a_second_service_out_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: list[dict[str, object]]
) -> None:
    monkeypatch.setattr(room, "_LOOK_S", 0.02)
    first = Recorder(tmp_path / "log", HostClock())
    file = tmp_path / "log" / room.LOCK
    file.unlink()
    until(file.exists)
    until(lambda: [line for line in said if "was taken away" in str(line["event"])])
    with pytest.raises(DeviceLost, match="another probewatch service"):
        Recorder(tmp_path / "log", HostClock())
    stolen = room.held_lock(tmp_path / "other")  # by another service, sooner than this one looks
    (tmp_path / "other").rename(file)
    until(lambda: [line for line in said if line["event"] == "another probewatch service writes here as well"])
    time.sleep(0.2)
    assert (first.failure, first.damage) == (None, ()), "it goes on"
    assert [line["event"] for line in said].count("another probewatch service writes here as well") == 1
    first.close()
    os.close(stolen)


def test_a_disk_that_dies_while_a_long_log_is_read_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    AlarmLog(tmp_path / "log").append(datetime(2026, 1, 1, tzinfo=UTC), 0, "state", {}, HALT)
    (segment,) = (tmp_path / "log").glob("alarms-*")
    kept = segment.rename(tmp_path / "kept")
    os.mkfifo(segment)
    monkeypatch.setattr(room, "OPEN_S", 0.2)
    monkeypatch.setattr(room, "segments", lambda _folder: [kept] * 1000 + [segment])
    monkeypatch.setattr(room, "_VERIFIED_S", 1)  # had it answered
    watch = Stopwatch()
    recorder = Recorder(tmp_path / "log", HostClock())
    assert (recorder.latch, recorder.damage) == (None, ("memory-damaged",))
    assert watch.spent_s() < 5
    with segment.open("wb"):
        pass
    recorder.close()


def test_when_too_many_wait_the_newest_is_kept_and_the_log_says_how_many_are_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is latched now is in the newest."""
    monkeypatch.setattr(room, "_MOST_WAITING", 3)
    monkeypatch.setattr(room, "RETRY_S", 0.02)
    segment = silent_segment(tmp_path)
    recorder = Recorder(tmp_path / "log", HostClock())
    for _ in range(9):
        recorder.note("state", None)
    recorder.note("state", HALT)
    assert (recorder.waiting, recorder.dropped) == (3, 7)
    answer(segment)
    until(lambda: recorder.waiting == 0)
    recorder.close()
    reopened = AlarmLog(tmp_path / "log")
    assert reopened.latch == HALT
    last = reopened.opened.entries[-1]
    assert (last.event, last.data) == ("dropped", {"entries": 7})


def test_what_is_not_on_the_disk_at_the_end_is_said_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: list[dict[str, object]]
) -> None:
    monkeypatch.setattr(room, "END_S", 0.1)
    segment = silent_segment(tmp_path)
    recorder = Recorder(tmp_path / "log", HostClock())
    recorder.note("stopped", None)
    recorder.close()
    (last,) = until(lambda: [line for line in said if line["event"] == "alarm log ends without its last entries"])
    assert last["entries"] == 1
    answer(segment)


def test_a_thread_with_files_of_its_own_keeps_none_of_the_others_open() -> None:
    """Else an output that the service left behind would stay open as long as one of its threads hangs."""
    found: list[tuple[list[str], list[str]]] = []

    def files() -> list[str]:
        return [file.name for file in Path("/proc/thread-self/fd").iterdir()]

    def look() -> None:
        before = files()
        own_files()
        found.append((before, files()))

    with Path("/dev/null").open() as device:
        thread = threading.Thread(target=look)
        thread.start()
        thread.join()
        assert str(device.fileno()) in found[0][0]
        assert sorted(found[0][1]) == ["0", "1", "2", "3"], "3 is the listing itself"
        assert device.read() == "", "still open here"


def test_an_error_of_ours_is_handed_to_the_tick(recorder: Recorder) -> None:
    recorder.note("state", None, what=object())
    until(lambda: recorder.failure is not None)
    assert isinstance(recorder.failure, TypeError)


@pytest.mark.parametrize("unknown", ["bit-rot", "video-lost", "log-not-written"])
def test_damage_of_another_version_can_be_shown_and_acknowledged(tmp_path: Path, unknown: str) -> None:
    log = AlarmLog(tmp_path)
    log.damage = (unknown, "memory-damaged")
    log.append(datetime(2026, 1, 1, tzinfo=UTC), 0, "started", {}, None)
    assert Recorder(tmp_path, HostClock()).damage == ("memory-damaged",)


CONFIG = Config.model_validate(
    {
        "video": {"url": "sim:/x"},
        "tracker": {"url": "ndi:/x"},
        "output": [{"url": "relay:/y"}],
        "calibration": {"file": "x"},
    }
)


@pytest.mark.parametrize(
    ("latch", "state", "fault"),
    [
        (Latch("halt", "scale"), State.HALT, "scale"),
        (Latch("recalibration requested", "offset"), State.RECALIBRATION_REQUESTED, "offset"),
        (Latch("recalibration requested", "twist"), State.RECALIBRATION_REQUESTED, None),
        (Latch("emergency", "scale"), State.HALT, "scale"),
        (Latch("monitoring", None), State.HALT, None),
    ],
)
def test_a_latch_of_another_version_comes_back_latched(latch: Latch, state: State, fault: str | None) -> None:
    alarm = supervisor_after(latch, CONFIG.supervisor.durations()).step(0, Inputs())
    assert (alarm.state, alarm.fault, alarm.latched, alarm.energised) == (state, fault, state, False)


def test_a_folder_has_one_service(recorder: Recorder, tmp_path: Path) -> None:
    with pytest.raises(DeviceLost, match="another probewatch service keeps its alarm log there"):
        Recorder(tmp_path / "log", HostClock())
    assert stat.S_IMODE((tmp_path / "log" / ".lock").stat().st_mode) == 0o600, "no member of the group may hold it"
    recorder.close()
    Recorder(tmp_path / "log", HostClock()).close()


def test_a_folder_that_was_taken_away_and_made_again_is_held_again(recorder: Recorder, tmp_path: Path) -> None:
    shutil.rmtree(tmp_path / "log")
    recorder.note(Event.STATE, None)
    until(lambda: recorder.waiting == 0)
    with pytest.raises(DeviceLost, match="another probewatch service"):
        Recorder(tmp_path / "log", HostClock())


def test_a_disk_that_takes_no_lock_keeps_nobody_out(tmp_path: Path, said: list[dict[str, object]]) -> None:
    (tmp_path / ".lock").mkdir()
    recorder = Recorder(tmp_path, HostClock())
    recorder.note(Event.STATE, None)
    recorder.close()
    assert (recorder.written, recorder.damage) == (2, ()), "the beginning of the chain, and the entry"
    assert any(line["event"] == "no lock keeps a second service out" for line in said)
