"""A lock keeps a second process out, also where somebody takes its file away."""

import os
from pathlib import Path

import pytest

from probewatch.drivers.files import lock
from probewatch.drivers.files.lock import held_lock, is_held


def test_a_file_that_is_taken_away_while_it_is_locked_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lock on a file that nobody finds keeps nobody out."""
    file, flock, taken = tmp_path / ".lock", lock.fcntl.flock, []

    def takes_away(descriptor: int, how: int) -> None:
        if len(taken) < 2:
            file.unlink()
            taken.append(descriptor)
        flock(descriptor, how)

    monkeypatch.setattr(lock.fcntl, "flock", takes_away)
    held = held_lock(file)
    assert (len(taken), is_held(file, held)) == (2, True)
    with pytest.raises(BlockingIOError):
        held_lock(file)
    os.close(held)
    os.close(held_lock(file))


def test_a_file_that_is_always_taken_away_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lock.fcntl, "flock", lambda *_: (tmp_path / ".lock").unlink())
    before = len(list(Path("/proc/self/fd").iterdir()))
    with pytest.raises(OSError, match="Stale"):
        held_lock(tmp_path / ".lock")
    assert len(list(Path("/proc/self/fd").iterdir())) == before


def test_who_holds_a_lock_sees_that_its_file_is_gone_or_another(tmp_path: Path) -> None:
    file = tmp_path / ".lock"
    held = held_lock(file)
    assert is_held(file, held)
    file.unlink()
    assert not is_held(file, held)
    file.touch()
    assert not is_held(file, held)
    os.close(held)
