"""The recorder stays inside its bounds, keeps what it is to keep, and is harmed by nothing that its disk does."""

import errno
import os
import shutil
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.core.line import Line
from probewatch.appliance.limits import Limits
from probewatch.appliance.service.feed.message import FeedMessage, Judged, LineStarted, Lost, Taken
from probewatch.appliance.storage.black_box import BlackBox, series_of
from probewatch.appliance.storage.black_box_fields import Begun, Gap, Item, Made, Mark, State
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.appliance.types import Calibration, Verdict, VerdictKind
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp
from probewatch.drivers.twins.scene.world import WorldSettings
from probewatch.tools.recorder import ring as ring_module
from probewatch.tools.recorder import run
from probewatch.tools.recorder.recorder import Keeping, Recorder
from probewatch.tools.recorder.ring import PART_NS, Bounds, DiskRing
from probewatch.tools.shared.rerun import Rerun
from tests.support.sessions import kept, session

S = 1_000_000_000
START = 1000 * S
REFERENCE = Calibration(np.eye(3), (1, 1), np.array([0.1, 0.1]), np.zeros(3), (64, 48))
SETTINGS = EstimatorSettings(1, REFERENCE, Limits(), 500)
QUIET = {"state": "monitoring", "priority": "none", "simulated": ["sim:x"]}
ALARM = {"state": "halt", "priority": "high", "reason": "mirrored", "simulated": ["sim:x"]}


@pytest.fixture(autouse=True)
def disk_without_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hours of simulated time sync thousands of times; that it syncs is tried by the disk that fails."""
    monkeypatch.setattr(ring_module.os, "fsync", lambda _: None)


def recorder(folder: Path, bounds: Bounds | None = None, blacken: bool = False, **keeping: int) -> Recorder:
    ring = DiskRing(folder, bounds or Bounds(1 << 30, 1 << 30, 0))
    span = {"before_ns": 120 * S, "after_ns": 60 * S, "every": 1} | keeping
    return Recorder(ring, Keeping(**span, blacken=blacken), "abcd", "test", utc)


def utc(now_ns: int) -> str:
    day, seconds = divmod(now_ns // S, 86_400)
    hours, seconds = divmod(seconds, 3600)
    return f"2026-01-{day + 1:02d}T{hours:02d}:{seconds // 60:02d}:{seconds % 60:02d}+00:00"


def second(number: int, side: int = 48, step: int = 0) -> list[FeedMessage]:
    """What the feed tells of one second: a noisy picture, a pose, a verdict."""
    t_ns = START + number * S
    image = np.random.default_rng(number).integers(0, 256, (side, side), dtype=np.uint8)
    return [
        Taken(step, Frame(Stamp(t_ns, 1), number, image)),
        Taken(step + 1, Pose(Stamp(t_ns, 1), number, np.eye(4), 0.1, PoseStatus.OK)),
        Judged(step + 1, Verdict(t_ns, VerdictKind.NOT_VERIFIED, (), None, "little motion")),
    ]


def fed(recorder: Recorder, seconds: range, side: int = 48) -> None:
    for number in seconds:
        for message in second(number, side, 2 * number):
            recorder.take(message, START + number * S)


def bytes_in(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.iterdir())


def items(folder: Path) -> Iterator[Item]:
    for path in sorted(folder.glob("*.mcap")):
        yield from (told.item for told in BlackBox(path).items())


@pytest.mark.thorough
@pytest.mark.parametrize("hours", [7, 26])
def test_a_day_and_more_stays_inside_the_bounds(hours: int, tmp_path: Path) -> None:
    """Hours of simulated time with an alarm every two hours; the folders are looked at every minute."""
    bounds = Bounds(2_000_000, 1_000_000, 0)
    recording = recorder(tmp_path, bounds, before_ns=300 * S)
    recording.take(LineStarted(SETTINGS, 0), START)
    most = {"ring": 0, "kept": 0}
    for number in range(0, hours * 3600, 6):
        fed(recording, range(number, number + 1))
        recording.state(ALARM if number % 7200 == 3600 else QUIET, START + number * S)
        if number % 60 == 0:
            most = {name: max(size, bytes_in(tmp_path / name)) for name, size in most.items()}
    recording.close()
    assert most["ring"] <= bounds.ring
    assert most["kept"] <= bounds.kept
    assert most["ring"] > 0.8 * bounds.ring, "the bound was put to the test"
    assert hours < 26 or most["kept"] > 0.5 * bounds.kept
    assert recording.fields()["evicted_files"] > 3 * hours
    newest = [item for item in items(tmp_path / "ring") if isinstance(item, Frame)]
    assert newest[-1].stamp.t_ns == START + (hours * 3600 - 6) * S


def test_the_minutes_around_an_alarm_are_kept_and_no_others(tmp_path: Path) -> None:
    recording = recorder(tmp_path)
    recording.take(LineStarted(SETTINGS, 0), START)
    for number in range(900):
        fed(recording, range(number, number + 1))
        recording.state(ALARM if number == 400 else QUIET, START + number * S)
    recording.close()
    told = [*items(tmp_path / "kept")]
    times = [(item.stamp.t_ns - START) // S for item in told if isinstance(item, Frame)]
    assert times[0] <= 280
    assert times[0] > 280 - 61, "no more than one file before"
    assert 460 <= times[-1] < 460 + 61
    assert [item.reason for item in told if isinstance(item, Mark)] == ["halt: mirrored"]
    assert {item.status["state"] for item in told if isinstance(item, State)} == {"halt", "monitoring"}


def test_what_a_person_marks_is_kept_and_the_mark_is_written(tmp_path: Path) -> None:
    recording = recorder(tmp_path)
    recording.take(LineStarted(SETTINGS, 0), START)
    fed(recording, range(300))
    with pytest.raises(ValueError, match="none was started"):
        recording.mark("stop", "", START + 300 * S)
    recording.mark("start", "phantom", START + 300 * S)
    with pytest.raises(ValueError, match="already"):
        recording.mark("start", "", START + 300 * S)
    fed(recording, range(300, 500))
    recording.mark("stop", "done", START + 500 * S)
    fed(recording, range(500, 900))
    recording.close()
    told = [*items(tmp_path / "kept")]
    times = [(item.stamp.t_ns - START) // S for item in told if isinstance(item, Frame)]
    assert times[0] <= 300
    assert 500 <= times[-1] < 561
    assert [(item.kind, item.reason) for item in told if isinstance(item, Mark)] == [
        ("start", "phantom"),
        ("stop", "done"),
    ]


def test_a_mark_that_is_forgotten_ends_by_itself(tmp_path: Path) -> None:
    recording = recorder(tmp_path)
    recording.mark("start", "", START)
    recording.state(QUIET, START + 3601 * S)
    assert not recording.fields()["marked"]
    recording.close()


def test_a_full_disk_is_told_and_harms_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """fsync fails as on a disk that is full, and later does not."""
    said: list[str] = []
    recording = Recorder(
        DiskRing(tmp_path, Bounds(1 << 30, 1 << 30, 0)), Keeping(S, S, 1, False), "abcd", "test", utc, said.append
    )
    recording.take(LineStarted(SETTINGS, 0), START)
    fed(recording, range(30))

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(ring_module.os, "fsync", full)
    fed(recording, range(30, 60))
    assert recording.fields()["failing"] == "No space left on device"
    assert not recording.fields()["recording"]
    monkeypatch.undo()
    fed(recording, range(60, 90))
    recording.close()
    assert said == ["not recording: No space left on device; trying again", "recording again"]
    assert recording.fields()["recording"]
    told = [*items(tmp_path / "ring")]
    gaps = [item for item in told if isinstance(item, Gap) and "disk" in item.reason]
    assert gaps
    missing = sum(gap.samples for gap in gaps)
    written = sum(isinstance(item, Frame | Pose | Verdict) for item in told)
    assert 3 * 90 <= missing + written <= 3 * 90 + 12, "what the disk took before it failed counts twice at most"
    assert [item.stamp.t_ns for item in told if isinstance(item, Frame)][-1] == START + 89 * S


def test_others_keep_their_share_of_the_disk(tmp_path: Path) -> None:
    free = [10_000]
    said: list[str] = []
    ring = DiskRing(tmp_path, Bounds(1 << 30, 1 << 30, 5_000), lambda _: free[0])
    recording = Recorder(ring, Keeping(S, S, 1, False), "abcd", "test", utc, said.append)
    recording.take(LineStarted(SETTINGS, 0), START)
    fed(recording, range(61))
    free[0] = 4_000
    fed(recording, range(61, 180))
    assert "leave_free_gb" in str(recording.fields()["failing"])
    assert not [*(tmp_path / "ring").glob("*.mcap")], "the oldest went first, and it was not enough"
    free[0] = 6_000
    fed(recording, range(180, 200))
    assert recording.fields()["failing"] is None
    recording.close()


def test_what_an_earlier_run_left_counts_and_goes_first(tmp_path: Path) -> None:
    first = recorder(tmp_path)
    fed(first, range(200))
    first.close()
    size = bytes_in(tmp_path / "ring")
    second_run = Recorder(
        DiskRing(tmp_path, Bounds(size + 3000, 1 << 30, 0)), Keeping(S, S, 1, False), "ef01", "test", utc
    )
    fed(second_run, range(300, 420))
    second_run.close()
    assert bytes_in(tmp_path / "ring") <= size + 3000
    sessions = [BlackBox(path).begun.session for path in sorted((tmp_path / "ring").glob("*.mcap"))]
    assert "ef01" in sessions
    assert sessions.count("abcd") < 4


def test_what_was_lost_and_interrupted_is_in_the_file(tmp_path: Path) -> None:
    recording = recorder(tmp_path)
    recording.take(LineStarted(SETTINGS, 7), START)
    recording.take(Lost(12), START)
    recording.interrupted("the service ended it", START + S)
    recording.close()
    found = [*items(tmp_path / "ring")]
    assert isinstance(found[0], Begun)
    assert isinstance(found[1], Made)
    assert found[1].step == 7
    assert [item.samples for item in found if isinstance(item, Gap)] == [12, 0]
    assert recording.fields()["lost_samples"] == 12


# Sessions of simulated tissue, as the feed tells them.

SMALL = WorldSettings(width_px=400, height_px=300, scale_mm_per_px=(0.09, 0.08))


def live(recording: Recorder, duration_s: float, change: Callable[[Frame], Frame] = lambda frame: frame) -> int:
    """A line works, and its feed is recorded; how many verdicts it gave."""
    world, verdicts = kept(3, settings=SMALL), 0
    reference = calibration_from_image_to_probe(world.image_to_probe, (400, 300))
    settings = EstimatorSettings(1, reference, Limits(), 500_000_000)
    line = Line(settings.reference, settings.limits, settings.stale_ns)
    recording.take(LineStarted(settings, 0), 5 * S)
    for step, sample in enumerate(session(world, duration_s)):
        if isinstance(sample, Frame):
            sample = change(sample)  # noqa: PLW2901
        now_ns = sample.stamp.t_ns
        recording.take(Taken(step, sample), now_ns)
        for verdict in line.step(sample):
            recording.take(Judged(step, verdict), now_ns)
            verdicts += 1
    return verdicts


@pytest.mark.thorough
def test_parts_of_a_recording_say_the_same_bit_for_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ring_module, "PART_NS", 2 * S)
    recording = recorder(tmp_path)
    verdicts = live(recording, 6.0)
    recording.close()
    files = sorted((tmp_path / "ring").glob("*.mcap"))
    assert len(files) >= 3
    (series,) = series_of(BlackBox(path) for path in files)
    rerun = Rerun(series)
    for _ in rerun.steps():
        pass
    assert rerun.comparison.exact, rerun.comparison.sentence
    assert rerun.comparison.recorded == verdicts
    assert series.damage_text == ""


@pytest.mark.thorough
def test_names_beside_the_sector_are_never_written(tmp_path: Path) -> None:
    """No pixel that is lit outside the sector, of any picture; nothing at all before the sector is known."""
    recording = recorder(tmp_path, blacken=True)
    live(recording, 6.0)
    recording.close()
    told = [*items(tmp_path / "ring")]
    frames = [item for item in told if isinstance(item, Frame)]
    withheld = sum(item.samples for item in told if isinstance(item, Gap))
    assert len(frames) + withheld == 180
    assert len(frames) > 90
    screen = kept(3, settings=SMALL)._screen
    words = (screen.text > 0) & (screen.sector == 0)
    words[:25, 80:310] = False  # the arc of the probe's face touches the sector
    words[260:] = False
    assert np.count_nonzero(words) > 300
    for frame in frames:
        assert not frame.image[words].any()
        assert np.count_nonzero(frame.image[screen.sector > 0]) > 0.8 * np.count_nonzero(screen.sector)
    begun = told[0]
    assert isinstance(begun, Begun)
    assert begun.text == "blackened"


@pytest.mark.thorough
def test_blackened_pictures_say_alike_but_not_bit_for_bit_and_that_is_told(tmp_path: Path) -> None:
    """The mask of the overlay keeps text out of the registration, not out of what it learns of it: a share of all that
    changes. What is withheld at the beginning proves the calibration later, never sooner.
    """
    recording = recorder(tmp_path, blacken=True)
    live(recording, 12.0)
    recording.close()
    rerun = Rerun(*series_of(BlackBox(path) for path in (tmp_path / "ring").glob("*.mcap")))
    for _ in rerun.steps():
        pass
    assert (
        rerun.comparison.equal_anyway + rerun.comparison.equal
        < rerun.comparison.without_past + rerun.comparison.recorded
    )
    told = rerun.comparison
    assert "text was blackened" in told.sentence
    judged = told.recorded + told.without_past - recording.withheld
    assert told.alike >= judged - 30, "the second by which the beginning is withheld"
    assert told.alike + told.unproved == judged
    assert told.proved == 0
    assert f"{told.alike} of {told.recorded + told.without_past} verdicts came again" in told.sentence


@pytest.mark.thorough
def test_another_screen_is_not_written(tmp_path: Path) -> None:
    """A list of patients over the whole picture, as long as nothing is known of it."""
    names = np.random.default_rng(1).integers(0, 2, (300, 400), dtype=np.uint8) * np.uint8(230)

    def menu(frame: Frame) -> Frame:
        shown = names if frame.sequence >= 150 else frame.image
        return Frame(frame.stamp, frame.sequence, shown)

    recording = recorder(tmp_path, blacken=True)
    live(recording, 6.0, menu)
    recording.close()
    written = [item.sequence for item in items(tmp_path / "ring") if isinstance(item, Frame)]
    assert max(written) < 150
    assert max(written) > 140


def test_what_json_cannot_hold_is_told_as_missing(tmp_path: Path) -> None:
    recording = recorder(tmp_path)
    recording.state({**QUIET, "fps": float("nan")}, START)
    fed(recording, range(2))
    recording.close()
    found = [*items(tmp_path / "ring")]
    assert [item.samples for item in found if isinstance(item, Gap)] == [1]
    assert sum(isinstance(item, Frame) for item in found) == 2


def test_a_folder_has_one_recorder(tmp_path: Path) -> None:
    held = run._locked(tmp_path)
    with pytest.raises(BlockingIOError):
        run._locked(tmp_path)
    os.close(held)
    os.close(run._locked(tmp_path))


def test_nobody_but_the_recorder_may_open_its_lock_and_so_hold_it(tmp_path: Path) -> None:
    """Also where an earlier version let the group read it."""
    (tmp_path / ".lock").touch(0o640)
    os.close(run._locked(tmp_path))
    assert stat.S_IMODE((tmp_path / ".lock").stat().st_mode) == 0o600


def test_status_of_a_disk(tmp_path: Path) -> None:
    fields: dict[str, Any] = recorder(tmp_path).fields()
    assert fields["free_bytes"] == pytest.approx(shutil.disk_usage(tmp_path).free, rel=0.2)
    assert PART_NS == 60 * S
