"""The references bear witness to the alarm log: what lacks an entry is told, and a healthy cart is never accused."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import pytest

from probewatch.appliance.storage import alarm_log
from probewatch.appliance.storage.alarm_chain import MEMORY, Event, read_log, segments
from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.appliance.storage.reference_store import (
    FOLDER,
    HISTORY,
    Entry,
    History,
    set_aside,
    sha256_of,
    write_history,
)
from probewatch.appliance.storage.witnessed_log import read_witnessed_log

NOON = datetime(2026, 1, 1, 12, tzinfo=UTC)
VERIFIED, UNVERIFIED = "2026-01-01T12:00:10+00:00", None


def store(folder: Path, *verified: str | None) -> None:
    """One reference for each; when motion showed it."""
    contents = [f"calibration {number}".encode() for number in range(1, len(verified) + 1)]
    entries = [
        Entry(
            number=number, origin="recalibration", utc=NOON.isoformat(), software="1", file="f", probe="Probe",
            sha256=sha256_of(content), image_size_px=(640, 480), simulated=False, verified_utc=utc,
        )
        for number, (content, utc) in enumerate(zip(contents, verified, strict=True), 1)
    ]  # fmt: skip
    write_history(folder, History(entries=tuple(entries)), {sha256_of(one): one for one in contents})


def named(number: int) -> dict[str, object]:
    return {"reference": {"number": number, "sha256": sha256_of(f"calibration {number}".encode())}}


def log(folder: Path, *numbers: int | None) -> AlarmLog:
    """As a service writes it that starts with the first of them, and takes the others."""
    written = AlarmLog(folder)
    for place, number in enumerate(numbers):
        data = {"reference": None} if number is None else named(number)
        written.append(NOON, place, Event.REFERENCE if place else Event.STARTED, data, None)
    return written


def found(folder: Path) -> list[str]:
    return [str(one) for one in read_witnessed_log(folder).damages]


def lacks(number: int) -> list[str]:
    what = f"reference {number} was in force, but no entry of the log names it: entries are missing"
    return [f"{FOLDER}/{HISTORY}: {what}"]


@pytest.mark.parametrize("numbers", [(), (None,), (None, 1), (1,), (1, 2), (1, 2, 3)])
def test_a_log_that_names_every_reference_is_whole(tmp_path: Path, numbers: Sequence[int | None]) -> None:
    """From the first start of a cart on, with a calibration and without."""
    log(tmp_path, *numbers)
    if any(numbers):
        store(tmp_path, *[VERIFIED for number in numbers if number])
    assert found(tmp_path) == []
    assert AlarmLog(tmp_path).damage == ()


@pytest.mark.parametrize("numbers", [(), (None,), (1,), (1, 2)])
def test_a_power_cut_between_store_and_log_is_no_damage(tmp_path: Path, numbers: Sequence[int | None]) -> None:
    """The new reference is on the disk, its entry is not; no contact has closed on it."""
    log(tmp_path, *numbers)
    store(tmp_path, *[VERIFIED for number in numbers if number], UNVERIFIED)
    assert found(tmp_path) == []


@pytest.mark.parametrize(
    ("numbers", "held", "missing"), [((), 1, 1), ((), 3, 3), ((None,), 1, 1), ((1,), 2, 2), ((1, 2), 4, 4)]
)
def test_a_log_that_lacks_a_verified_reference_is_damaged(
    tmp_path: Path, numbers: Sequence[int | None], held: int, missing: int
) -> None:
    log(tmp_path, *numbers)
    store(tmp_path, *[VERIFIED] * held)
    assert found(tmp_path) == lacks(missing)
    assert AlarmLog(tmp_path).damage == ("log-damaged",)


def test_one_in_between_that_the_log_lacks_is_told_though_the_last_is_not_verified(tmp_path: Path) -> None:
    log(tmp_path, 1)
    store(tmp_path, VERIFIED, UNVERIFIED, UNVERIFIED)
    assert found(tmp_path) == lacks(2)


def test_another_content_under_the_same_number_is_told(tmp_path: Path) -> None:
    log(tmp_path).append(NOON, 0, Event.STARTED, {"reference": {"number": 1, "sha256": "0" * 64}}, None)
    store(tmp_path, VERIFIED)
    assert found(tmp_path) == lacks(1)


def test_it_is_told_once_whatever_the_store_holds_from_before(tmp_path: Path) -> None:
    store(tmp_path, VERIFIED, VERIFIED, VERIFIED)
    again = log(tmp_path, 3)
    assert again.damage == ("log-damaged",)
    again.damage = ()
    again.append(NOON, 0, Event.REQUEST, {"do": "acknowledge"}, None)
    for _ in range(2):
        assert found(tmp_path) == []
        assert log(tmp_path, 3).damage == ()
    (begun,) = [entry for entry in read_log(tmp_path).entries if entry.event == Event.CHAIN_BEGUN]
    assert begun.data["found"] == lacks(3)
    for file in [*segments(tmp_path), tmp_path / MEMORY]:
        file.unlink()
    assert found(tmp_path) == lacks(3), "and again once it is taken away again"


def test_references_whose_entries_are_forgotten_are_no_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(alarm_log, "ENTRIES_A_SEGMENT", 4)
    monkeypatch.setattr(alarm_log, "SEGMENTS_KEPT", 2)
    store(tmp_path, VERIFIED, VERIFIED, VERIFIED)
    written = log(tmp_path, 1, 2, 3)
    for t_ns in range(20):
        written.append(NOON, t_ns, Event.STATE, {"state": "monitoring"}, None)
    assert read_log(tmp_path).entries[0].number > 4
    assert found(tmp_path) == [], "none is named any more"
    log(tmp_path, 3)
    assert found(tmp_path) == [], "the last is named again"
    store(tmp_path, *[VERIFIED] * 4)
    assert found(tmp_path) == lacks(4)


def test_a_log_of_a_version_that_named_no_references_is_no_damage(tmp_path: Path) -> None:
    log(tmp_path).append(NOON, 0, Event.STARTED, {"software": "probewatch 0"}, None)
    store(tmp_path, VERIFIED, VERIFIED)
    assert found(tmp_path) == []
    log(tmp_path, 2)
    assert found(tmp_path) == []
    assert AlarmLog(tmp_path).damage == ()


def test_a_store_that_was_begun_anew_is_no_damage(tmp_path: Path) -> None:
    store(tmp_path, VERIFIED, VERIFIED)
    log(tmp_path, 1, 2)
    set_aside(tmp_path)
    assert found(tmp_path) == []
    store(tmp_path, VERIFIED)
    log(tmp_path, 1)
    assert found(tmp_path) == []


def test_a_store_that_cannot_be_read_says_nothing_of_the_log(tmp_path: Path) -> None:
    """The service refuses to start on it."""
    store(tmp_path, VERIFIED)
    (tmp_path / FOLDER / HISTORY).write_text("{")
    assert found(tmp_path) == []


def test_a_log_that_was_taken_away_from_a_running_service_is_told_once(tmp_path: Path) -> None:
    """What it writes from then on begins with no start; that the folder was gone it told itself."""
    written = AlarmLog(tmp_path)
    written.append(NOON, 0, Event.STATE, {"state": "internal fault"}, None)
    store(tmp_path, VERIFIED, VERIFIED)
    assert found(tmp_path) == []
