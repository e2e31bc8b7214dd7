"""The report of a period counts what the alarm log says, and its signature holds."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from probewatch.appliance.storage.alarm_chain import read_log
from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.tools.report.period import last_period, per_fault, period, summary

START = datetime(2026, 1, 1, tzinfo=UTC)
NOW = datetime(2026, 3, 1, tzinfo=UTC)


def logged(folder: Path, entries: list[tuple[float, str, dict[str, object]]]) -> Path:
    """(hours after the start of the year, event, data)."""
    log = AlarmLog(folder)
    for hours, event, data in entries:
        log.append(START + timedelta(hours=hours), round(hours * 3.6e12), event, data, None)
    return folder


def state(name: str, fault: str | None = None, reason: str = "") -> dict[str, object]:
    return {"state": name, "fault": fault, "reason": reason}


MONTH = [
    (-5.0, "started", {"software": "probewatch 1"}),
    (-4.0, "state", state("not verified")),
    (10.0, "state", state("monitoring")),
    (30.0, "state", state("warning", "polarity", "mirrored")),
    (30.5, "state", state("halt", "polarity", "mirrored & <b>")),
    (31.0, "request", {"do": "acknowledge", "who": "anna"}),
    (31.0, "state", state("not verified")),
    (32.0, "reference", {"reference": {"number": 2, "origin": "recalibration", "who": "anna", "difference": "1 mm"}}),
    (33.0, "state", state("monitoring")),
    (40.0, "stopped", {}),
    (40.5, "started", {"software": "probewatch 2"}),
    (41.0, "state", state("device lost", "tracker-lost", "silent")),
    (42.0, "state", state("monitoring")),
    (31 * 24 + 5, "stopped", {}),
]


def test_hours_are_those_of_the_states_day_by_part(tmp_path: Path) -> None:
    january = period("month", START + timedelta(days=3))
    found = summary(january, read_log(logged(tmp_path, MONTH)), [], NOW)
    assert (january.name, january.parts) == ("2026-01", 31)
    hours = {name: round(seconds / 3600, 3) for name, seconds in found.shares_s.items()}
    assert hours == {
        "not verified": 12.0,
        "monitoring": 20 + 7 + 31 * 24 - 42,
        "warning": 0.5,
        "halt": 0.5,
        "off": 1.0,
        "device lost": 1.0,
    }
    assert sum(hours.values()) == 31 * 24
    assert [round(sum(day.values()) / 3600, 3) for day in found.by_part] == [24.0] * 31
    assert found.by_part[0]["not verified"] == 10 * 3600
    assert found.verified == pytest.approx(hours["monitoring"] / (31 * 24 - 1))


def test_alarms_are_told_once_with_their_worst(tmp_path: Path) -> None:
    found = summary(period("month", START), read_log(logged(tmp_path, MONTH)), [], NOW)
    assert [(one.worst, one.fault, one.lasted_s) for one in found.alarms] == [
        ("halt", "polarity", 3600.0),
        ("device lost", "tracker-lost", 3600.0),
    ]
    assert dict(found.requests) == {"acknowledge": 1}
    assert [said for _, said in found.software] == ["probewatch 1", "probewatch 2"]
    assert len(found.references) == 1


def test_what_lies_outside_is_not_counted(tmp_path: Path) -> None:
    february = summary(period("month", START + timedelta(days=40)), read_log(logged(tmp_path, MONTH)), [], NOW)
    assert february.shares_s["monitoring"] == 5 * 3600
    assert february.alarms == []
    today = summary(period("day", START), read_log(tmp_path), [], START + timedelta(hours=12))
    assert sum(today.shares_s.values()) == 12 * 3600, "the rest of the day is not there yet"


def test_a_clock_that_was_set_back_makes_no_time(tmp_path: Path) -> None:
    back = [(5.0, "state", state("monitoring")), (2.0, "state", state("halt", "scale")), (3.0, "stopped", {})]
    found = summary(period("day", START), read_log(logged(tmp_path, back)), [], NOW)
    assert found.shares_s["halt"] == 3600
    assert found.shares_s["monitoring"] == 0


@pytest.mark.parametrize(
    ("kind", "day", "name", "days"),
    [
        ("month", "2026-12-31", "2026-12", 31),
        ("month", "2024-02-29", "2024-02", 29),
        ("week", "2026-01-01", "2026-W01", 7),
        ("day", "2026-03-29", "2026-03-29", 1),
    ],
)
def test_periods_of_the_calendar(kind: str, day: str, name: str, days: int) -> None:
    found = period(kind, datetime.fromisoformat(day).replace(tzinfo=UTC))
    assert (found.name, (found.end - found.start).days) == (name, days)
    assert last_period(kind, found.end).name == name


def test_an_alarm_names_every_fault_that_it_had_in_turn(tmp_path: Path) -> None:
    """The last one stood for the whole: a lost tracker and a silent estimator were told as minutes of polarity."""
    hour = [
        (1.0, "state", state("warning", "tracker-lost", "silent")),
        (1.2, "state", state("internal fault", "estimator-silent", "stopped")),
        (1.5, "state", state("warning", "tracker-lost", "silent")),
        (1.6, "state", state("halt", "polarity", "mirrored")),
        (2.0, "state", state("not verified")),
    ]
    found = summary(period("day", START), read_log(logged(tmp_path, hour)), [], NOW)
    (alarm,) = found.alarms
    assert [(name, round(lasted_s)) for name, lasted_s in alarm.named] == [
        ("tracker-lost", 1080),
        ("estimator-silent", 1080),
        ("polarity", 1440),
    ]
    assert (alarm.worst, alarm.fault, round(alarm.lasted_s)) == ("halt", "polarity", 3600)
    assert {name: (number, round(seconds)) for name, number, seconds in per_fault(found.alarms)} == {
        "tracker-lost": (1, 1080),
        "estimator-silent": (1, 1080),
        "polarity": (1, 1440),
    }


def test_a_time_of_overload_is_told_with_what_is_not_known_of_it(tmp_path: Path) -> None:
    """A state that comes back meanwhile has no entry of its own, so shares and alarms are no more than a part."""
    entries = [
        (1.0, "state", state("monitoring")),
        (1.1, "overloaded", {"pressure": 0.6}),
        (1.2, "overload-ended", {"for_s": 360, "repeated": {"monitoring": 3, "warning (video-lost)": 2}}),
        (5.0, "overloaded", {"pressure": 0.6}),
        (6.0, "stopped", {}),
        (30.0, "overloaded", {"pressure": 0.6}),
    ]
    reading = read_log(logged(tmp_path, entries))
    first = summary(period("day", START), reading, [], NOW)
    assert [(round(one.lasted_s), one.unlogged) for one in first.overloads] == [(360, 5), (3600, None)]
    second = summary(period("day", START + timedelta(days=1)), reading, [], NOW)
    assert [(round(one.lasted_s), one.unlogged) for one in second.overloads] == [(18 * 3600, None)]
    assert summary(period("day", START - timedelta(days=1)), reading, [], NOW).overloads == []


def test_a_day_is_told_hour_by_hour(tmp_path: Path) -> None:
    found = summary(period("day", START + timedelta(days=1)), read_log(logged(tmp_path, MONTH)), [], NOW)
    assert len(found.by_part) == 24
    assert found.by_part[6] == {"warning": 1800, "halt": 1800}
    assert found.by_part[5] == {"monitoring": 3600}
