"""The alarm log on a real file system: what is cut, changed, taken out or put in shows; what was latched is kept."""

import contextlib
import errno
import json
import os
import shutil
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from probewatch.appliance.storage import alarm_log
from probewatch.appliance.storage.alarm_chain import MEMORY, Event, Latch, digest_of, read_log, segments
from probewatch.appliance.storage.alarm_log import AlarmLog

NOON = datetime(2026, 1, 1, 12, tzinfo=UTC)
HALT = Latch("halt", "scale")


def filled(folder: Path, entries: int = 5, latch: Latch | None = None) -> AlarmLog:
    log = AlarmLog(folder)
    for number in range(entries):
        log.append(NOON, number, "state", {"state": "warning", "n": number}, latch)
    return log


def faults(folder: Path) -> list[str]:
    return [damage.fault for damage in read_log(folder).damages]


def test_entries_come_back_as_they_were_written(tmp_path: Path) -> None:
    filled(tmp_path, 3, HALT)
    reading = read_log(tmp_path)
    assert reading.damages == ()
    assert [(entry.number, entry.event) for entry in reading.entries] == [
        (1, Event.CHAIN_BEGUN),
        (2, "state"),
        (3, "state"),
        (4, "state"),
    ]
    assert reading.entries[-1].data == {"state": "warning", "n": 2}
    assert reading.entries[-1].latch == HALT
    assert reading.memory is not None
    assert reading.memory.digest == reading.entries[-1].digest


def test_a_log_goes_on_where_it_ended(tmp_path: Path) -> None:
    filled(tmp_path, 2)
    log = filled(tmp_path, 2)
    assert log.damage == ()
    assert log.number == 5
    assert faults(tmp_path) == []


@pytest.mark.parametrize("latch", [None, HALT, Latch("recalibration requested", None)])
def test_what_was_latched_is_known_after_a_restart(tmp_path: Path, latch: Latch | None) -> None:
    filled(tmp_path, 2, HALT)
    filled(tmp_path, 1, latch)
    assert AlarmLog(tmp_path).latch == latch


def test_a_missing_memory_is_damage_and_the_log_still_knows_the_latch(tmp_path: Path) -> None:
    filled(tmp_path, 2, HALT)
    (tmp_path / MEMORY).unlink()
    log = AlarmLog(tmp_path)
    assert (log.damage, log.latch) == (("memory-damaged",), HALT)


@pytest.mark.parametrize("content", [b"", b"{}", b"[]", b"null", b"\xff", b'{"v": 1, "check": "x"}', b"0" * 4096])
def test_a_corrupt_memory_is_damage(tmp_path: Path, content: bytes) -> None:
    filled(tmp_path, 2, HALT)
    (tmp_path / MEMORY).write_bytes(content)
    log = AlarmLog(tmp_path)
    assert (log.damage, log.latch) == (("memory-damaged",), HALT)


def test_a_missing_log_is_damage_and_the_memory_still_knows_the_latch(tmp_path: Path) -> None:
    filled(tmp_path, 2, HALT)
    for file in segments(tmp_path):
        file.unlink()
    log = AlarmLog(tmp_path)
    assert (log.damage, log.latch) == (("log-damaged",), HALT)


def test_damage_stands_through_restarts_until_it_is_accepted(tmp_path: Path) -> None:
    filled(tmp_path)
    (tmp_path / MEMORY).unlink()
    filled(tmp_path, 1)
    log = filled(tmp_path, 1)
    assert log.damage == ("memory-damaged",)
    log.damage = ()
    log.append(NOON, 0, "request", {"do": "acknowledge"}, None)
    again = AlarmLog(tmp_path)
    assert again.damage == ()
    _, begun = [entry for entry in again.opened.entries if entry.event == Event.CHAIN_BEGUN]
    assert "is missing" in begun.data["found"][0]


def test_half_an_entry_before_a_chain_that_was_begun_for_another_reason_is_not_told_again(tmp_path: Path) -> None:
    """The power was cut while an entry was written, and the memory was lost as well."""
    filled(tmp_path)
    with segments(tmp_path)[0].open("ab") as segment:
        segment.write(b'{"number": 4')
    (tmp_path / MEMORY).unlink()
    assert filled(tmp_path).damage == ("memory-damaged",)
    again = AlarmLog(tmp_path)
    again.damage = ()
    again.append(NOON, 0, "request", {"do": "acknowledge"}, None)
    assert AlarmLog(tmp_path).damage == ()


def rewritten(folder: Path, lines: list[bytes]) -> None:
    segments(folder)[0].write_bytes(b"".join(lines))


def lines_of(folder: Path) -> list[bytes]:
    return segments(folder)[0].read_bytes().splitlines(keepends=True)


def test_a_changed_entry_shows(tmp_path: Path) -> None:
    filled(tmp_path)
    lines = lines_of(tmp_path)
    rewritten(tmp_path, [*lines[:2], lines[2].replace(b"warning", b"monitor"), *lines[3:]])
    found = read_log(tmp_path).damages
    assert found[0].where.endswith("line 3")
    assert "it was changed" in found[0].what


def test_an_entry_that_was_changed_with_its_digest_shows_in_the_next(tmp_path: Path) -> None:
    filled(tmp_path)
    lines = lines_of(tmp_path)
    entry = json.loads(lines[2])
    entry.pop("digest")
    entry["event"] = "nothing happened"
    entry["digest"] = digest_of({key: entry[key] for key in entry})
    rewritten(tmp_path, [*lines[:2], json.dumps(entry).encode() + b"\n", *lines[3:]])
    assert "does not continue the chain" in read_log(tmp_path).damages[0].what


@pytest.mark.parametrize("taken", [1, 2, 3])
def test_an_entry_taken_out_shows(tmp_path: Path, taken: int) -> None:
    filled(tmp_path)
    lines = lines_of(tmp_path)
    rewritten(tmp_path, [*lines[:taken], *lines[taken + 1 :]])
    assert faults(tmp_path) == ["log-damaged"]


@pytest.mark.parametrize("kept", [0, 1, 4])
def test_a_log_cut_short_shows(tmp_path: Path, kept: int) -> None:
    filled(tmp_path)
    rewritten(tmp_path, lines_of(tmp_path)[:kept])
    assert "log-damaged" in faults(tmp_path)


def test_entries_in_another_order_show(tmp_path: Path) -> None:
    filled(tmp_path)
    lines = lines_of(tmp_path)
    rewritten(tmp_path, [*lines[:2], lines[3], lines[2], *lines[4:]])
    assert "log-damaged" in faults(tmp_path)


def test_a_torn_last_line_is_set_aside_without_alarm(tmp_path: Path) -> None:
    filled(tmp_path, 3, HALT)
    with segments(tmp_path)[0].open("ab") as stream:
        stream.write(b'{"number": 5, "utc": "2026')
    log = filled(tmp_path, 1, HALT)
    assert (log.damage, log.latch) == ((), HALT)
    assert read_log(tmp_path).damages == ()
    assert segments(tmp_path)[0].with_suffix(".torn").read_bytes() == b'{"number": 5, "utc": "2026\n'


def test_power_lost_between_the_entry_and_the_memory_is_no_damage(tmp_path: Path) -> None:
    filled(tmp_path, 3)
    before = (tmp_path / MEMORY).read_bytes()
    filled(tmp_path, 1, HALT)
    (tmp_path / MEMORY).write_bytes(before)
    log = AlarmLog(tmp_path)
    assert (log.damage, log.latch) == ((), HALT), "the entry on the disk is newer than the memory"
    log.append(NOON, 0, "state", {}, None)
    assert faults(tmp_path) == []


def test_two_entries_ahead_of_the_memory_is_damage(tmp_path: Path) -> None:
    filled(tmp_path, 3)
    before = (tmp_path / MEMORY).read_bytes()
    filled(tmp_path, 2)
    (tmp_path / MEMORY).write_bytes(before)
    assert AlarmLog(tmp_path).damage == ("memory-damaged",)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(at=st.integers(0), cut=st.booleans(), value=st.integers(1, 255))
def test_any_flipped_or_lost_byte_shows_or_is_harmless(tmp_path: Path, at: int, cut: bool, value: int) -> None:
    """Nothing raises, and what is read is a beginning of what was written."""
    if not (tmp_path / "kept").exists():
        filled(tmp_path / "kept", 4, HALT)
    shutil.rmtree(tmp_path / "log", ignore_errors=True)
    shutil.copytree(tmp_path / "kept", tmp_path / "log")
    file = segments(tmp_path / "log")[0]
    content = bytearray(file.read_bytes())
    at %= len(content)
    if cut:
        del content[at:]
    else:
        content[at] ^= value
    whole = read_log(tmp_path / "log").entries
    file.write_bytes(content)
    reading = read_log(tmp_path / "log")
    assert reading.damages
    assert set(map(str, reading.entries)) <= set(map(str, whole))
    assert AlarmLog(tmp_path / "log").latch == HALT


def test_many_entries_rotate_and_still_verify(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(alarm_log, "ENTRIES_A_SEGMENT", 20)
    monkeypatch.setattr(alarm_log, "SEGMENTS_KEPT", 5)
    monkeypatch.setattr(os, "fsync", lambda fd: None)
    filled(tmp_path, 300)
    reading = read_log(tmp_path)
    assert reading.damages == ()
    assert len(segments(tmp_path)) == 5
    assert 80 <= len(reading.entries) <= 100
    assert reading.entries[-1].number == 301
    segments(tmp_path)[0].unlink()
    assert faults(tmp_path) == ["log-damaged"], "the oldest segment was not taken by rotation"


def test_the_log_keeps_at_least_ten_thousand_entries() -> None:
    assert alarm_log.ENTRIES_A_SEGMENT * (alarm_log.SEGMENTS_KEPT - 1) >= 10_000


def test_a_full_disk_appends_nothing_and_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = filled(tmp_path, 2)
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(OSError, match="No space"):
            log.append(NOON, 9, "state", {}, HALT)
    assert len(read_log(tmp_path).entries) == 3
    log.append(NOON, 9, "state", {}, HALT)
    assert (faults(tmp_path), log.number) == ([], 4)


def full(fd: int) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_memory_that_cannot_be_written_holds_up_the_next_entry_not_this_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = filled(tmp_path, 2)

    def refused(path: Path) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(alarm_log, "replacing", refused)
        log.append(NOON, 9, "state", {}, HALT)
        with pytest.raises(OSError, match="No space"):
            log.append(NOON, 9, "state", {}, HALT)
    assert AlarmLog(tmp_path).damage == ()
    log.append(NOON, 9, "state", {}, HALT)
    assert (faults(tmp_path), log.number) == ([], 5)


def test_other_files_in_the_folder_are_let_be(tmp_path: Path) -> None:
    filled(tmp_path, 3, HALT)
    (tmp_path / "alarms-backup.jsonl").write_text("mine\n")
    (tmp_path / "alarms-00000001.jsonl.gz").write_text("mine")
    (tmp_path / "alarms-99999999.jsonl").mkdir()
    os.mkfifo(tmp_path / "alarms-88888888.jsonl")
    log = filled(tmp_path, 1, HALT)
    assert (log.damage, faults(tmp_path)) == ((), [])
    assert (tmp_path / "alarms-backup.jsonl").read_text() == "mine\n"
    assert len(read_log(tmp_path).entries) == 5


def test_a_segment_that_cannot_be_read_is_damage_and_the_memory_still_knows_the_latch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bad sector must not cost what was latched, nor all that is written from now on."""
    filled(tmp_path, 3, HALT)
    bad, read_bytes = segments(tmp_path)[0], Path.read_bytes

    def fails_on_the_bad_one(file: Path) -> bytes:
        if file == bad:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return read_bytes(file)

    monkeypatch.setattr(Path, "read_bytes", fails_on_the_bad_one)
    log = filled(tmp_path, 1, HALT)
    assert (log.damage, log.latch, log.number) == (("log-damaged",), HALT, 6)


def lost_first_segment(folder: Path) -> None:
    segments(folder)[0].unlink()


def lost_log(folder: Path) -> None:
    for file in segments(folder):
        file.unlink()


def garbage_everywhere(folder: Path) -> None:
    (folder / MEMORY).write_bytes(b"\0" * 100)
    for file in segments(folder):
        file.write_bytes(b"\0" * 100)


def garbage_at_the_end(folder: Path) -> None:
    (folder / MEMORY).write_bytes(b"\0" * 100)
    segments(folder)[-1].write_bytes(b"\0" * 100 + b"\n")


@pytest.mark.parametrize("harm", [lost_first_segment, lost_log, garbage_everywhere, garbage_at_the_end])
def test_damage_that_was_accepted_does_not_come_back(
    tmp_path: Path, harm: Callable[[Path], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(alarm_log, "ENTRIES_A_SEGMENT", 3)
    filled(tmp_path, 8)
    harm(tmp_path)
    log = AlarmLog(tmp_path)
    assert log.damage
    log.damage = ()
    log.append(NOON, 0, "request", {"do": "acknowledge"}, None)
    for _ in range(3):
        again = filled(tmp_path, 2)
        assert again.damage == ()
    before = again.number
    assert AlarmLog(tmp_path).number == before


def test_text_that_no_file_can_hold_comes_back_as_it_was(tmp_path: Path) -> None:
    filled(tmp_path).append(NOON, 0, "state", {"reason": "a\ud800ä"}, HALT)
    reading = read_log(tmp_path)
    assert (reading.damages, reading.entries[-1].data) == ((), {"reason": "a\ud800ä"})


class PowerCut(BaseException):
    """Nothing runs after it."""


def cut_after(writes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The power goes instead of the write after so many, of entries and of the memory alike."""
    done = 0

    def powered(write: Callable[..., Any]) -> Callable[..., Any]:
        def carry_out(*given: Any) -> Any:
            nonlocal done
            if done == writes:
                raise PowerCut
            done += 1
            return write(*given)

        return carry_out

    monkeypatch.setattr(alarm_log, "_append", powered(alarm_log._append))
    monkeypatch.setattr(alarm_log, "replacing", powered(alarm_log.replacing))


@pytest.mark.parametrize("harm", [lost_first_segment, lost_log, garbage_everywhere, garbage_at_the_end])
@pytest.mark.parametrize("writes", range(6))
def test_power_lost_between_any_two_writes_hides_no_damage_and_frees_no_latch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, harm: Callable[[Path], None], writes: int
) -> None:
    monkeypatch.setattr(alarm_log, "ENTRIES_A_SEGMENT", 3)
    filled(tmp_path, 8, HALT)
    harm(tmp_path)
    found = AlarmLog(tmp_path)
    with monkeypatch.context() as patch:
        cut_after(writes, patch)
        with contextlib.suppress(PowerCut):
            found.append(NOON, 0, "started", {}, found.latch)
            found.append(NOON, 0, "state", {}, found.latch)
    again = AlarmLog(tmp_path)
    assert set(found.damage) <= set(again.damage)
    assert again.latch == found.latch
