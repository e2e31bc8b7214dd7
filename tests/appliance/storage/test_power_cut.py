"""A power cut at any step of a write leaves the reference before or the one after, whole: never none, never a torn one.

Every state that the cut may have left on the disk (tests/support/power_cut.py) is started from.
"""

import os
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

import pytest

from probewatch.appliance.configuration.config import Config, load_config
from probewatch.appliance.storage import reference_store
from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.appliance.storage.reference_store import read_history, set_aside
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.atomic_file import sync_directory
from tests.support.power_cut import Image, recorded, restored
from tests.support.stores import configuration, log, settled, started, written

pytestmark = pytest.mark.usefixtures("log")
__all__ = ["log"]

Step = Callable[[Config], None]
FIRST_MM, SECOND_MM = 3.0, 4.0
"""Elevational offsets of the two references."""


def take_first(config: Config) -> None:
    settled(started(config))


def take_second(config: Config) -> None:
    references = started(config)
    new = config.calibration.file.with_name("new.toml")
    references.take(references.from_content(new.read_bytes(), str(new)), "recalibration", "anna", "moved by 1 mm")
    settled(references)


def verify(config: Config) -> None:
    references = started(config)
    references.note_verified()
    settled(references)


def log_it(config: Config) -> None:
    """The alarm log remembers which reference is in force."""
    data = {"reference": {"number": 2, "origin": "recalibration", "sha256": "ab" * 32}}
    AlarmLog(config.alarm.folder).append(datetime.now(UTC), 1, "started", data, None)


def cart(folder: Path, *steps: Step) -> Config:
    """A cart with this history."""
    folder.mkdir()
    written(folder / "new.toml", 0, 0, SECOND_MM - FIRST_MM)
    config = configuration(folder)
    for step in steps:
        step(config)
    return config


def offset_after_start(folder: Path, image: Image) -> float | None:
    """mm, elevational, of the reference that a service started on this image goes on with; None where it refuses."""
    restored(image, folder)
    try:
        references = started(load_config(folder / "probewatch.toml"))
    except ConfigurationError:
        return None
    assert settled(references).current is not None
    return float(references.current.calibration.offset_mm[2])


def number_on_disk(folder: Path, image: Image) -> int | None:
    """Of the reference in force, before any start; 0 where the history is empty, None where none can be read."""
    restored(image, folder)
    try:
        history = read_history(load_config(folder / "probewatch.toml").alarm.folder)
    except ConfigurationError:
        return None
    return None if history is None else len(history.entries)


def after_cuts(folder: Path, before: Sequence[Step], step: Step) -> tuple[list[float | None], set[int | None]]:
    """What is in force after each cut of the step, and what number is on the disk after it."""
    config = cart(folder / "cart", *before)
    with recorded(folder / "cart") as disk:
        step(config)
    found = [offset_after_start(folder / f"cut-{number}", image) for number, image in enumerate(disk.cuts)]
    return found, {number_on_disk(folder / f"done-{number}", image) for number, image in enumerate(disk.final)}


@pytest.mark.parametrize(
    ("before", "step", "old_mm", "new_mm", "number"),
    [
        ((), take_first, FIRST_MM, FIRST_MM, 1),
        ((take_first,), take_second, FIRST_MM, SECOND_MM, 2),
        ((take_first, take_second), verify, SECOND_MM, SECOND_MM, 2),
    ],
    ids=["the first", "another", "verified"],
)
def test_a_cut_leaves_the_old_or_the_new_reference_whole(
    tmp_path: Path, before: Sequence[Step], step: Step, old_mm: float, new_mm: float, number: int
) -> None:
    found, done = after_cuts(tmp_path, before, step)
    assert set(found) == {old_mm, new_mm}
    assert found[0] == old_mm
    assert done == {number}, "on the disk once it is said to be"


def in_place(file: Path, content: bytes) -> None:
    file.write_bytes(content)
    with file.open("rb") as stream:
        os.fsync(stream.fileno())
    sync_directory(file.parent)


def renamed_before_it_is_written(file: Path, content: bytes) -> None:
    temporary = file.with_suffix(".tmp")
    temporary.write_bytes(content)
    temporary.replace(file)
    sync_directory(file.parent)


def folder_forgotten(file: Path, content: bytes) -> None:
    temporary = file.with_suffix(".tmp")
    temporary.write_bytes(content)
    with temporary.open("rb") as stream:
        os.fsync(stream.fileno())
    temporary.replace(file)


@pytest.mark.parametrize("write", [in_place, renamed_before_it_is_written, folder_forgotten])
def test_a_careless_writer_is_found_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write: Callable[[Path, bytes], None]
) -> None:
    """Else the cuts above would prove nothing."""
    found, done = after_cuts(
        tmp_path, (take_first, lambda _: monkeypatch.setattr(reference_store, "_write", write)), take_second
    )
    assert None in found or done != {2}


def test_a_reset_that_is_cut_is_seen_or_undone(tmp_path: Path) -> None:
    """It sets a store aside whole, by a person's wish: between the two names there is none, which a start refuses."""
    found, done = after_cuts(tmp_path, (take_first, take_second, log_it), lambda config: set_aside(config.alarm.folder))
    assert set(found) == {SECOND_MM, FIRST_MM, None}
    assert done == {0}
