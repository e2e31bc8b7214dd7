"""Keeps the files of a recorder on the disk: a ring of the latest, and those kept of it; never beyond their bounds."""

import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import BinaryIO

from probewatch.appliance.storage.black_box import CHUNK_NS, BlackBoxWriter
from probewatch.appliance.storage.black_box_fields import Begun, Item
from probewatch.drivers.files.atomic_file import make_folder, sync_directory
from probewatch.drivers.files.regular_file import open_regular

RING, KEPT, SUFFIX = "ring", "kept", ".mcap"

PART_NS = 60_000_000_000
"""Nanoseconds of one file. Longer keeps more around an alarm than was asked for; shorter makes thousands of files."""
_PART_SHARE = 8
"""Parts that the ring holds at least, however large the pictures are: with fewer, an eviction takes most of it."""
_MOST_WINDOWS = 64
"""Times to be kept that are remembered while files of them may still come: an alarm a second for a minute."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """Holds the bounds, bytes. leave_free: those of the disk that are left to others."""

    ring: int
    kept: int
    leave_free: int


@dataclass(slots=True)
class _Part:
    """Represents a file. from_ns, to_ns: CLOCK_MONOTONIC; None for one of an earlier run, whose clock may differ."""

    path: Path
    size: int
    from_ns: int | None = None
    to_ns: int | None = None

    def touches(self, from_ns: int, to_ns: int) -> bool:
        return self.from_ns is not None and self.to_ns is not None and self.from_ns <= to_ns and self.to_ns >= from_ns


@dataclass(slots=True)
class _Open:
    stream: BinaryIO
    writer: BlackBoxWriter
    part: _Part
    written: int = field(default=0)


class DiskRing:
    """Writes the parts and evicts the oldest. Every call raises OSError where the disk does; after that, call
    `close_part`, and go on when the disk may have recovered.

    free_bytes: those of the disk when it was last examined. evicted: number of files that were removed to hold the
    bounds. What earlier runs left counts and is removed first.
    """

    def __init__(
        self, folder: Path, bounds: Bounds, free: Callable[[Path], int] = lambda path: shutil.disk_usage(path).free
    ) -> None:
        self._bounds, self._free = bounds, free
        self._folders = {name: folder / name for name in (RING, KEPT)}
        for place in self._folders.values():
            make_folder(place, 0o750)
        self._parts = {name: _found(place) for name, place in self._folders.items()}
        self._windows: list[tuple[int, int]] = []
        self._open: _Open | None = None
        self._number = 0
        self._largest_chunk = 0
        self.evicted = 0
        self.free_bytes = free(folder)

    @property
    def sizes(self) -> dict[str, int]:
        """Returns the bytes of "ring" and "kept"."""
        open_bytes = 0 if self._open is None else self._open.written
        return {
            name: sum(part.size for part in parts) + open_bytes * (name == RING) for name, parts in self._parts.items()
        }

    @property
    def counts(self) -> dict[str, int]:
        """Returns the number of files of either."""
        return {name: len(parts) + (name == RING and self._open is not None) for name, parts in self._parts.items()}

    @property
    def is_open(self) -> bool:
        """Returns whether a file is being written."""
        return self._open is not None

    @property
    def part(self) -> int:
        """Returns the number of the file that is open, or was last."""
        return self._number

    def due(self, now_ns: int) -> bool:
        """Returns whether another file is to be begun."""
        if self._open is None:
            return True
        assert self._open.part.from_ns is not None
        full = self._open.written >= self._bounds.ring // _PART_SHARE
        return full or now_ns - self._open.part.from_ns >= PART_NS

    def begin(self, begun: Begun) -> None:
        """Closes the file that is open and begins the next part."""
        self.close_part()
        self._number += 1
        stamp = datetime.fromisoformat(begun.utc).strftime("%Y%m%dT%H%M%S")
        path = self._folders[RING] / f"{stamp}-{begun.session}-{begun.part:05d}{SUFFIX}"
        stream = os.fdopen(open_regular(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o640), "wb", buffering=1 << 20)
        try:
            sync_directory(path.parent)
            writer = BlackBoxWriter(stream, begun)
        except OSError:
            _closed(stream)
            path.unlink(missing_ok=True)
            raise
        self._open = _Open(stream, writer, _Part(path, 0, begun.t_ns, begun.t_ns))

    def put(self, item: Item, now_ns: int) -> None:
        """Writes an item; at the end of a chunk that chunk is on the disk, and the bounds hold."""
        assert self._open is not None
        if self._open.writer.put(item, now_ns):
            self._sync()
        self._open.part.to_ns = now_ns

    def keep(self, from_ns: int, to_ns: int) -> None:
        """Keeps what lies in this time, as far as it is still there; also what is to come. A second call with the same
        from_ns changes its end.
        """
        others = [one for one in self._windows if one[0] != from_ns and one[1] >= from_ns - PART_NS]
        self._windows = [*others[-_MOST_WINDOWS:], (from_ns, to_ns)]
        for part in [part for part in self._parts[RING] if part.touches(from_ns, to_ns)]:
            self._move(part)
        self._bound()

    def close_part(self) -> None:
        """Ends the file, complete if the disk allows it; one of which nothing ever reached the disk is removed. Raises
        nothing: a file that was cut can be read as well.
        """
        opened, self._open = self._open, None
        if opened is None:
            return
        ended = False
        with suppress(OSError):
            opened.writer.finish()
            opened.stream.flush()
            os.fsync(opened.stream.fileno())
            ended = True
        _closed(opened.stream)
        with suppress(OSError):
            self._file(opened, worth=ended or opened.written > 0)
            self._bound()

    def _file(self, opened: _Open, worth: bool) -> None:
        part = opened.part
        if not worth:
            part.path.unlink(missing_ok=True)
            return
        part.size = part.path.stat().st_size
        self._parts[RING].append(part)
        if any(part.touches(*window) for window in self._windows):
            self._move(part)

    def room(self) -> bool:
        """Returns whether the disk has room to spare, after removing the oldest files of the ring where it has not."""
        self.free_bytes = self._free(self._folders[RING])
        while self.free_bytes < self._bounds.leave_free and self._parts[RING]:
            self._evict(RING)
            self.free_bytes = self._free(self._folders[RING])
        return self.free_bytes >= self._bounds.leave_free

    def _sync(self) -> None:
        assert self._open is not None
        self._open.stream.flush()
        before, self._open.written = self._open.written, self._open.stream.tell()
        self._largest_chunk = max(self._largest_chunk, self._open.written - before)
        self._bound()
        os.fsync(self._open.stream.fileno())

    def _bound(self) -> None:
        """Evicts the oldest files until the bounds hold, with room for the next chunk."""
        bounds = {RING: self._bounds.ring - 2 * self._largest_chunk, KEPT: self._bounds.kept}
        for name, most in bounds.items():
            while self.sizes[name] > most and self._parts[name]:
                self._evict(name)

    def _evict(self, name: str) -> None:
        part = self._parts[name].pop(0)
        part.path.unlink(missing_ok=True)
        self.evicted += 1

    def _move(self, part: _Part) -> None:
        target = self._folders[KEPT] / part.path.name
        part.path.replace(target)
        sync_directory(target.parent)
        self._parts[RING].remove(part)
        part.path = target
        self._parts[KEPT].append(part)


def _closed(stream: BinaryIO) -> None:
    """Closes the stream. What the disk does not take of its contents is lost; the descriptor is freed either way."""
    with suppress(OSError):
        stream.close()


def _found(folder: Path) -> list[_Part]:
    """Returns the files of earlier runs, the oldest first, by their names. Raises OSError."""
    files = sorted(path for path in folder.glob(f"*{SUFFIX}") if path.is_file())
    return [_Part(path, path.stat().st_size) for path in files]


assert PART_NS > CHUNK_NS, "a part has chunks"
