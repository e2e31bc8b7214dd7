"""Until when a reference holds: over midnight, with a clock that is stepped, and with dates that are none."""

from datetime import UTC, datetime, timedelta

import pytest

from probewatch.appliance.storage.calibration_file import calibration_bytes, write_calibration
from probewatch.appliance.storage.reference_dates import Dates, dates_of
from probewatch.appliance.storage.reference_store import Entry
from tests.support.stores import calibration

ENTRY = Entry(
    number=1, origin="recalibration", utc="2026-05-01T10:00:00+00:00", software="1", file="f", sha256="0" * 64,
    image_size_px=(640, 480), probe="Probe", simulated=False,
)  # fmt: skip
SECOND = timedelta(seconds=1)


def dates(tmp_path, due_days: int | None = None, **stated: str) -> Dates:
    file = tmp_path / "probe.toml"
    write_calibration(file, calibration(), stated)
    return dates_of(ENTRY, [ENTRY], calibration_bytes(file), due_days)


def test_without_any_date_nothing_is_ever_overdue_whatever_the_clock_says(tmp_path) -> None:
    known = dates(tmp_path, who="A")
    for year in (1970, 2026, 9999):
        now = datetime(year, 1, 1, tzinfo=UTC)
        assert known.overdue(now) == known.expired(now) == ""
    assert (known.due_utc, known.expires_utc) == (None, None)


@pytest.mark.parametrize("day", ["2027-02-28", "2028-02-29", "2026-12-31"])
def test_a_stated_day_counts_whole_and_passes_at_midnight_utc(tmp_path, day: str) -> None:
    midnight = datetime.fromisoformat(day).replace(tzinfo=UTC) + timedelta(days=1)
    for name in ("due", "expires"):
        known = dates(tmp_path, **{name: day})
        assert known.overdue(midnight - SECOND) == known.expired(midnight - SECOND) == ""
        assert f"since {midnight:%Y-%m-%d} 00:00 UTC" in known.overdue(midnight)
        assert known.expired(midnight)


def test_what_comes_first_is_due_and_what_expires_later_is_only_due_until_then(tmp_path) -> None:
    known = dates(tmp_path, 10, due="2026-08-01", expires="2026-09-01")
    assert known.due_utc == "2026-05-11T10:00:00+00:00"
    assert dates(tmp_path, 1000, due="2026-08-01").due_utc == "2026-08-02T00:00:00+00:00"
    after, long_after = datetime(2026, 8, 2, tzinfo=UTC), datetime(2026, 9, 2, tzinfo=UTC)
    assert known.overdue(after).startswith("it is due since 2026-05-11")
    assert "it counts from 2026-05-01, when its file was first used; if the clock was wrong" in known.overdue(after)
    assert dates(tmp_path, 1000, due="2026-08-01").overdue(after) == "it is due since 2026-08-02 00:00 UTC"
    assert known.expired(after) == ""
    assert known.overdue(long_after) == known.expired(long_after) == "it has expired since 2026-09-02 00:00 UTC"


def test_a_clock_is_believed_both_ways_but_not_before_the_reference_itself(tmp_path) -> None:
    known = dates(tmp_path, expires="2026-12-31")
    in_force = datetime(2026, 5, 1, 10, tzinfo=UTC)
    assert known.expired(datetime(2099, 1, 1, tzinfo=UTC)), "stepped ahead"
    assert known.expired(in_force + SECOND) == "", "and back"
    assert known.expired(in_force - timedelta(hours=23)) == "", "put right by less than a day"
    for wrong in (in_force - timedelta(days=1, seconds=1), datetime(1970, 1, 1, tzinfo=UTC)):
        assert "set the clock" in known.expired(wrong)
        assert known.overdue(wrong) == known.expired(wrong)


@pytest.mark.parametrize("stated", ["soon", "", "2026-02-30", "9999-12-31", "2026-05", "2026-05-01T00:00", "\x00"])
def test_a_date_that_is_none_counts_as_passed_and_is_named(tmp_path, stated: str) -> None:
    for name in ("due", "expires"):
        known = dates(tmp_path, **{name: stated})
        now = datetime(2026, 5, 2, tzinfo=UTC)
        assert f"its '{name}' is {stated[:40]!r}, no day such as" in known.overdue(now)
        assert known.expired(now) == known.overdue(now)


def test_a_reference_of_no_time_is_overdue_where_a_date_counts_from_it(tmp_path) -> None:
    entry = ENTRY.model_copy(update={"utc": "yesterday"})
    assert "no calendar has" in dates_of(entry, [entry], b"", 365).overdue(datetime(2026, 5, 2, tzinfo=UTC))
    naive = ENTRY.model_copy(update={"utc": "2026-05-01T10:00:00"})
    assert dates_of(naive, [naive], b"", 1).due_utc == "2026-05-02T10:00:00+00:00"


def test_a_file_that_was_in_force_before_is_due_by_the_first_time_whatever_was_in_between() -> None:
    """Also where the clock was ahead the first time: the earliest counts."""
    other = ENTRY.model_copy(update={"number": 2, "sha256": "1" * 64, "utc": "2026-04-01T10:00:00+00:00"})
    again = ENTRY.model_copy(update={"number": 3, "origin": "went back to 1", "utc": "2026-07-01T10:00:00+00:00"})
    history = [ENTRY, other, again]
    assert dates_of(again, history, b"", 30).due_utc == "2026-05-31T10:00:00+00:00"
    ahead = ENTRY.model_copy(update={"utc": "2099-05-01T10:00:00+00:00"})
    assert dates_of(again, [ahead, other, again], b"", 30).due_utc == "2026-07-31T10:00:00+00:00"
    unreadable = ENTRY.model_copy(update={"utc": "yesterday"})
    assert dates_of(again, [unreadable, other, again], b"", 30).due_utc == "2026-07-31T10:00:00+00:00"


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"<PlusConfiguration/>", b"[[[", b"provenance = 3"])
def test_what_states_no_dates_has_none(content: bytes) -> None:
    assert dates_of(ENTRY, [ENTRY], content, None) == Dates(since=datetime(2026, 5, 1, 10, tzinfo=UTC))
