"""The alarm log after two cuts, each at any step of its writer, the second one before the first was made good.

What a cut may leave is as tests/support/power_cut.py says; it holds whatever kill -9 leaves.
"""

from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest

from probewatch.appliance.storage import alarm_log
from probewatch.appliance.storage.alarm_chain import MEMORY, Latch, read_log, segments
from probewatch.appliance.storage.alarm_log import AlarmLog
from tests.support.power_cut import Image, recorded, restored

NOON = datetime(2026, 1, 1, 12, tzinfo=UTC)
HALT = Latch("halt", "scale")


def start(folder: Path) -> None:
    """A service opens the log and tells that it has started."""
    log = AlarmLog(folder)
    log.append(NOON, 1, "started", {}, log.latch)


def cuts_of(folder: Path) -> list[Image]:
    """Returns the states of the disk that each cut of a start can leave; names of temporary files do not count."""
    with recorded(folder) as disk:
        start(folder)
    whole = [{name: content for name, content in image.items() if not name.endswith(".tmp")} for image in disk.cuts]
    return [image for number, image in enumerate(whole) if image not in whole[:number]]


def twice_cut(folder: Path) -> Iterator[Path]:
    """Folders as two cuts in two starts leave them."""
    for first, image in enumerate(cuts_of(folder)):
        again = folder.with_name(f"cut-{first}")
        restored(image, again)
        for second, last in enumerate(cuts_of(again)):
            restored(last, left := folder.with_name(f"cut-{first}-{second}"))
            yield left


def nothing(folder: Path) -> None:
    folder.mkdir()


def latched(folder: Path) -> None:
    log = AlarmLog(folder)
    for number in range(3):
        log.append(NOON, number, "state", {}, HALT)


def damaged(folder: Path) -> None:
    """Told in the log, and not acknowledged yet."""
    latched(folder)
    (folder / MEMORY).unlink()
    start(folder)


@pytest.fixture(params=[2000, 2], ids=["one segment", "a segment each"], autouse=True)
def segment(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second way makes new segments, and forgets old ones."""
    monkeypatch.setattr(alarm_log, "ENTRIES_A_SEGMENT", request.param)
    monkeypatch.setattr(alarm_log, "SEGMENTS_KEPT", 2)


@pytest.mark.parametrize(
    ("before", "damage", "latch"), [(nothing, (), None), (latched, (), HALT), (damaged, ("memory-damaged",), HALT)]
)
def test_two_cuts_make_no_damage_and_end_none(
    tmp_path: Path, before: Callable[[Path], None], damage: tuple[str, ...], latch: Latch | None
) -> None:
    """Entries of two starts lay ahead of a memory that neither had come to write."""
    before(tmp_path / "cart")
    for left in twice_cut(tmp_path / "cart"):
        log = AlarmLog(left)
        assert (log.damage, log.latch) == (damage, latch), read_log(left).damages
        log.append(NOON, 2, "state", {}, log.latch)
        again = AlarmLog(left)
        assert (again.damage, again.latch) == (damage, latch), read_log(left).damages


def test_after_two_cuts_real_damage_is_told(tmp_path: Path) -> None:
    latched(tmp_path / "cart")
    for left in twice_cut(tmp_path / "cart"):
        first = segments(left)[0]
        kept = first.read_bytes()
        first.write_bytes(kept.replace(b"T12:00:00", b"T12:00:01", 1))
        assert AlarmLog(left).damage == ("log-damaged",)
        first.write_bytes(kept)
        (left / MEMORY).unlink()
        assert AlarmLog(left).damage == ("memory-damaged",)
