"""The thread that writes the alarm log: what is taken away, full or of another version, and what it does then."""

import shutil
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest

from appliance.alarm_chain import Latch
from appliance.alarm_log import AlarmLog
from appliance.config import Config
from appliance.service import recorder as room
from appliance.service.daemon import _supervisor
from appliance.service.recorder import Recorder
from appliance.supervision.supervisor import Inputs
from appliance.types import State
from drivers.hosttime import HostClock
from tests.polling import until

HALT = Latch("halt", "scale")


@pytest.fixture
def recorder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Recorder]:
    monkeypatch.setattr(room, "_RETRY_S", 0.02)
    recorder = Recorder(tmp_path / "log", HostClock())
    yield recorder
    recorder.close()


def test_a_folder_that_is_taken_away_alarms_and_the_log_goes_on(recorder: Recorder, tmp_path: Path) -> None:
    recorder.start()
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
    monkeypatch.setattr(room, "_RETRY_S", 0.02)
    (tmp_path / "log").write_text("a file where the folder should be")
    recorder = Recorder(tmp_path / "log", HostClock())
    assert (recorder.damage, recorder.failing) == (("memory-damaged",), "File exists")
    recorder.start()
    recorder.note("started", None)
    recorder.accept_damage("memory-damaged")
    with pytest.raises(AssertionError):
        until(lambda: recorder.damage, 0.3)
    (tmp_path / "log").unlink()
    until(lambda: recorder.waiting == 0)
    assert (recorder.damage, recorder.failing) == ((), None)
    recorder.close()


def test_when_too_many_wait_the_newest_is_kept(
    recorder: Recorder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is latched now is in the newest."""
    monkeypatch.setattr(room, "_MOST_WAITING", 3)
    for _ in range(9):
        recorder.note("state", None)
    recorder.note("state", HALT)
    assert (recorder.waiting, recorder.dropped) == (3, 7)
    recorder.start()
    until(lambda: recorder.waiting == 0)
    assert AlarmLog(tmp_path / "log").latch == HALT


def test_an_error_of_ours_is_handed_to_the_tick(recorder: Recorder) -> None:
    recorder.start()
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
        "tracker": {"url": "sim:/x"},
        "output": [{"url": "relay:/x"}],
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
    alarm = _supervisor(CONFIG, latch).step(0, Inputs())
    assert (alarm.state, alarm.fault, alarm.latched, alarm.energised) == (state, fault, state, False)
