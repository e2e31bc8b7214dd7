"""Writes the alarm log; appliance.storage.alarm_chain describes its form on the disk."""

import errno
import json
import os
from contextlib import suppress
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from probewatch.appliance.storage.alarm_chain import (
    AFTER,
    CUT_OFF,
    GENESIS,
    MEMORY,
    VERSION,
    Damage,
    Event,
    Latch,
    Memory,
    digest_of,
    first_number,
    segments,
)
from probewatch.appliance.storage.witnessed_log import read_witnessed_log
from probewatch.drivers.files.atomic_file import make_folder, replacing, sync_directory

ENTRIES_A_SEGMENT, SEGMENTS_KEPT = 2000, 20
"""Entries in a segment, and segments that are kept: 40,000 entries in all. More fills the disk of a cart and takes
longer to verify at the start; fewer forgets sooner. Entries are removed a segment at a time.
"""
_ESCAPED = "backslashreplace"
"""Turns a lone surrogate, which no UTF-8 can hold, into its JSON escape."""


class AlarmLog:
    """Writes the log. opened: what was found; an unsound chain is left as it is and a new one begun after it.

    latch: what the last run latched. damage: hazard classes that are not acknowledged yet; the next entry stores its
    value. file: the file that was read or written last, so that a disk that does not answer can be named. Raises
    OSError when the folder cannot be made or read.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = self.file = folder
        make_folder(folder)
        self.opened = read_witnessed_log(folder)
        unsound = self._unsound()
        last = self.opened.entries[-1] if self.opened.entries else None
        memory = self.opened.memory or Memory()
        number = max(memory.number, 0 if last is None else last.number)
        ahead = last is not None and last.number > memory.number
        latch = last.latch if last is not None and (ahead or self.opened.memory is None) else memory.latch
        self.damage = tuple(dict.fromkeys((*memory.damage, *(one.fault for one in unsound if one.fault is not None))))
        first = memory.first
        if unsound:
            number = max([number, *map(first_number, segments(folder))])
            first = self.opened.entries[0].number if self.opened.entries else number + 1
        self._memory = Memory(number, GENESIS if last is None else last.digest, first, latch, self.damage)
        self._chain_begins = bool(unsound) or last is None
        # A power cut came between an entry and the write of the memory, or this is the first start. The memory is
        # written before the next entry: else another power cut would leave the log two entries ahead of it, or without
        # one, as real damage does.
        self._memory_behind = ahead or self.opened.memory is None
        self._segment: Path | None = None
        self._entries = 0
        if not unsound:
            self._continue_segment()

    @property
    def latch(self) -> Latch | None:
        """Returns the latch of the last entry on the disk."""
        return self._memory.latch

    @property
    def number(self) -> int:
        """Returns the number of the last entry on the disk."""
        return self._memory.number

    @property
    def digest(self) -> str:
        """Returns the digest of the last entry on the disk."""
        return self._memory.digest

    def append(self, utc: datetime, t_ns: int, event: str, data: dict[str, Any], latch: Latch | None) -> None:
        """Appends an entry, which is on the disk when this returns.

        Raises OSError; then nothing was appended, and the call may be repeated.
        """
        if self._chain_begins:
            found = [str(one) for one in self._unsound()]
            if found:  # the memory first: once the chain has started again, the log no longer shows this damage
                self._remember(replace(self._memory, damage=self.damage))
            self._write(utc, t_ns, Event.CHAIN_BEGUN, {"found": found, AFTER: self._memory.digest}, latch)
            self._chain_begins = False
        self._write(utc, t_ns, event, data, latch)

    def _unsound(self) -> list[Damage]:
        """Returns the damage after which no chain has begun. In a segment from before the last beginning, this is the
        damage that no beginning names, because it came later. An older segment that ends in half an entry is not
        counted, named or not, because a power cut causes that; where whole entries were lost with it, the chain shows
        it.
        """
        begins = [entry for entry in self.opened.entries if entry.event == Event.CHAIN_BEGUN]
        since = begins[-1].number if begins else 0
        before = {file.name for file in segments(self._folder) if first_number(file) < since}
        told = {str(text) for entry in begins for text in _listed(entry.data.get("found"))}

        def is_old(one: Damage) -> bool:
            return one.where.split(" ")[0] in before and (one.what == CUT_OFF or str(one) in told)

        return [one for one in self.opened.damages if one.fault and not is_old(one)]

    def _continue_segment(self) -> None:
        """Continues the last segment; a torn last line is set aside first, even the only one of a log."""
        files = segments(self._folder)
        if not files:
            return
        content = files[-1].read_bytes()
        whole = content[: content.rfind(b"\n") + 1]
        if len(whole) < len(content):
            with files[-1].with_suffix(".torn").open("ab") as torn:
                torn.write(content[len(whole) :] + b"\n")
            os.truncate(files[-1], len(whole))
        if not self._chain_begins:
            self._segment, self._entries = files[-1], whole.count(b"\n")

    def _write(self, utc: datetime, t_ns: int, event: str, data: dict[str, Any], latch: Latch | None) -> None:
        if self._memory_behind:
            self._remember(self._memory)
        number = self._memory.number + 1
        if self._segment is None or self._entries >= ENTRIES_A_SEGMENT:
            self._segment, self._entries = self._folder / f"alarms-{number:08d}.jsonl", 0
            self._forget_oldest()
        stored: dict[str, Any] = {
            "number": number,
            "utc": utc.astimezone(UTC).isoformat(timespec="milliseconds"),
            "t_ns": t_ns,
            "event": event,
            "data": data,
            "latch": latch and asdict(latch),
            "previous": GENESIS if event == Event.CHAIN_BEGUN else self._memory.digest,
        }
        digest = digest_of(stored)
        line = json.dumps({**stored, "digest": digest}, ensure_ascii=False).encode(errors=_ESCAPED) + b"\n"
        self.file = self._segment
        _append(self._segment, line)
        self._entries += 1
        self._memory_behind = True
        with suppress(OSError):
            self._remember(Memory(number, digest, self._memory.first, latch, self.damage))

    def _forget_oldest(self) -> None:
        """Removes the oldest segments before a new one begins. The memory is written first, so that a power cut between
        the two leaves too much, not too little.
        """
        files = segments(self._folder)
        kept = files[-(SEGMENTS_KEPT - 1) :]
        if len(kept) < len(files):
            self._remember(replace(self._memory, first=first_number(kept[0])))
            for file in files[: -len(kept)]:
                file.unlink()

    def _remember(self, memory: Memory) -> None:
        """Writes the memory. If that fails, the entry is on the disk all the same; the next entry tries again first."""
        self._memory = memory
        stored = {"v": VERSION, **asdict(memory), "damage": list(memory.damage)}
        self.file = self._folder / MEMORY
        with replacing(self.file) as stream:
            stream.write(json.dumps({**stored, "check": digest_of(stored)}).encode())
        self._memory_behind = False


def _listed(found: object) -> list[Any]:
    return found if isinstance(found, list) else []


def _append(file: Path, line: bytes) -> None:
    """Appends the whole line or nothing. Raises OSError."""
    fd = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o640)
    try:
        length = os.fstat(fd).st_size
        try:
            if os.write(fd, line) != len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(fd)
        except OSError:
            os.truncate(fd, length)
            raise
        if length == 0:
            sync_directory(file.parent)
    finally:
        os.close(fd)
