"""The strip of the last hour, and the last alarms, from entries of an alarm log on the disk."""

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from probewatch.appliance.storage.alarm_chain import read_log
from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.tools.page.past import hour, last_states

NOW = datetime(2026, 11, 27, 12, 0, tzinfo=UTC)


def written(folder: Path, *entries: tuple[float, str, dict[str, Any]]) -> list[tuple[float, str]]:
    """(minutes before now, lamp) of each stretch of the hour after these: (minutes before now, event, data)."""
    log = AlarmLog(folder)
    for minutes, event, data in entries:
        log.append(NOW - timedelta(minutes=minutes), 0, event, data, None)
    stretches = hour(read_log(folder).entries, NOW.timestamp())
    return [(round((NOW.timestamp() - one["from_s"]) / 60, 3), one["lamp"]) for one in stretches]


def state(minutes: float, name: str) -> tuple[float, str, dict[str, Any]]:
    return minutes, "state", {"state": name, "reason": "r", "fault": None}


def test_the_hour_begins_with_the_state_before_it(tmp_path: Path) -> None:
    entries = [state(200, "halt"), state(90, "monitoring"), state(30, "warning"), state(29.99, "monitoring")]
    assert written(tmp_path, *entries) == [(90, "green"), (30, "yellow"), (29.99, "green")]
    stretches = hour(read_log(tmp_path).entries, NOW.timestamp())
    assert [one["alarm"] for one in stretches] == [False, True, False]


def test_of_a_time_without_a_service_nothing_is_known(tmp_path: Path) -> None:
    """Where it said that it stops, and where it was killed: from its last entry on, not as if it had gone on."""
    found = written(
        tmp_path,
        (50, "started", {}),
        state(50, "monitoring"),
        (40, "stopped", {}),
        (30, "started", {}),
        state(30, "monitoring"),
        (25, "estimate", {}),
        (10, "started", {}),
        state(10, "not verified"),
    )
    lamps = [lamp for _, lamp in found]
    assert lamps == ["unknown", "green", "unknown", "green", "unknown", "cyan"]
    assert [minutes for minutes, _ in found[1:]] == [50, 40, 30, 25, 10]


def test_a_clock_that_was_set_back_makes_no_stretch_of_the_future(tmp_path: Path) -> None:
    assert written(tmp_path, state(-30, "halt"), state(20, "monitoring")) == [
        (pytest.approx(NOW.timestamp() / 60), "unknown"),
        (20, "red"),
        (20, "green"),
    ]


def test_a_state_of_a_later_version_has_no_lamp(tmp_path: Path) -> None:
    assert written(tmp_path, state(90, "asleep"), state(5, "halt")) == [(90, "unknown"), (5, "red")]


def test_no_entry_is_an_hour_of_which_nothing_is_known(tmp_path: Path) -> None:
    assert [lamp for _, lamp in written(tmp_path)] == ["unknown"]


def test_the_newest_alarm_comes_first_and_at_the_carts_own_time(tmp_path: Path) -> None:
    written(tmp_path, *(state(60 - minute, "warning" if minute % 2 else "halt") for minute in range(20)))
    told = last_states(read_log(tmp_path).entries)
    assert len(told) == 12
    assert [one["state"] for one in told[:2]] == ["warning", "halt"]
    assert datetime.fromisoformat(told[0]["time"]) == NOW - timedelta(minutes=41)
