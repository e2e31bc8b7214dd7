"""The alarm log: append-only JSON lines in a hash chain, and the alarm memory that says where the chain ends.

A folder holds segments `alarms-NNNNNNNN.jsonl`, named by the number of their first entry, and `alarm-memory.json`. Each
entry carries the SHA-256 of its own content, which includes the digest of the entry before it, so an entry that was
changed, taken out or put in breaks the chain; the memory holds number and digest of the last entry, so a log that was
cut short shows as well. It shows accidents and hasty hands; whoever may write to the folder and knows this format can
make a new chain, which the digests in the system journal would contradict.
"""

import hashlib
import json
import os
import re
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from drivers.atomicfile import replacing, sync_directory

MEMORY = "alarm-memory.json"
BEGUN = "chain begun"
ENTRIES_A_SEGMENT, SEGMENTS_KEPT = 2000, 20
_VERSION = 1
_GENESIS = "0" * 64
_ESCAPED = "backslashreplace"
"""Makes of a lone surrogate, which no UTF-8 can hold, its JSON escape."""
_SEGMENT = re.compile(r"alarms-([0-9]{8,})\.jsonl")
_ENTRY_TYPES = {"number": int, "utc": str, "t_ns": int, "event": str, "data": dict, "previous": str}
_MEMORY_TYPES = {"number": int, "digest": str, "first": int, "damage": list}


@dataclass(frozen=True, slots=True)
class Latch:
    """A latched state by its name and its fault class; in every entry too, so that the log can replace the memory."""

    state: str
    fault: str | None


@dataclass(frozen=True, slots=True)
class Entry:
    """number: counts from 1. utc: ISO 8601, of the wall clock. t_ns: of the host clock, since its boot."""

    number: int
    utc: str
    t_ns: int
    event: str
    data: dict[str, Any]
    latch: Latch | None
    previous: str
    digest: str


@dataclass(frozen=True, slots=True)
class Damage:
    """What contradicts the chain, and where. fault: hazard class it raises; empty for a write that a power cut tore."""

    fault: str
    where: str
    what: str

    def __str__(self) -> str:
        return f"{self.where}: {self.what}"


@dataclass(frozen=True, slots=True)
class Memory:
    """What outlives the process. damage: hazard classes that no person has acknowledged yet."""

    number: int = 0
    digest: str = _GENESIS
    first: int = 1
    latch: Latch | None = None
    damage: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Reading:
    """All entries that could be read, in order, and everything that is wrong with them."""

    entries: tuple[Entry, ...]
    damages: tuple[Damage, ...]
    memory: Memory | None


@dataclass(slots=True)
class _Chain:
    """Walks the entries in order; expects what the one before promised."""

    entries: list[Entry] = field(default_factory=list)
    damages: list[Damage] = field(default_factory=list)

    def take(self, where: str, line: bytes) -> None:
        try:
            entry = _parse(line)
        except ValueError as error:
            self.damages.append(Damage("log-damaged", where, f"is no entry ({error})"))
            return
        self._link(where, entry)
        self.entries.append(entry)

    def _link(self, where: str, entry: Entry) -> None:
        if not self.entries or entry.event == BEGUN:
            return
        before = self.entries[-1]
        if entry.number != before.number + 1:
            what = f"entry {entry.number} follows entry {before.number}: entries are missing or were put in"
            self.damages.append(Damage("log-damaged", where, what))
        elif entry.previous != before.digest:
            self.damages.append(Damage("log-damaged", where, f"entry {entry.number} does not continue the chain"))


def read_log(folder: Path) -> Reading:
    """Read and verify everything in the folder; an empty or missing folder is an empty log. Raises OSError."""
    chain = _Chain()
    files = segments(folder)
    for file in files:
        _read_segment(file, chain, last=file == files[-1])
    memory = _read_memory(folder, chain)
    if memory is not None:
        _compare(chain, memory)
    return Reading(tuple(chain.entries), tuple(chain.damages), memory)


def segments(folder: Path) -> list[Path]:
    """Oldest first; other files in the folder are none of ours."""
    named = [file for file in folder.glob("alarms-*.jsonl") if _SEGMENT.fullmatch(file.name) and file.is_file()]
    return sorted(named, key=_first_number)


def _read_segment(file: Path, chain: _Chain, last: bool) -> None:
    try:
        content = file.read_bytes()
    except OSError as error:
        chain.damages.append(Damage("log-damaged", file.name, f"cannot be read ({error.strerror})"))
        return
    for number, line in enumerate(content.splitlines(keepends=True), 1):
        where = f"{file.name} line {number}"
        if line.endswith(b"\n"):
            chain.take(where, line)
        elif last:
            chain.damages.append(Damage("", where, "was cut off while it was written"))
        else:
            chain.damages.append(Damage("log-damaged", where, "is cut off"))


def _read_memory(folder: Path, chain: _Chain) -> Memory | None:
    try:
        stored = json.loads((folder / MEMORY).read_bytes())
        if stored.pop("check") != _digest(stored) or stored.pop("v") != _VERSION:
            raise ValueError("its content does not match its checksum")
        _check_types(stored, _MEMORY_TYPES)
        latch, damage = _latch(stored.pop("latch")), tuple(map(str, stored.pop("damage")))
        return Memory(**stored, latch=latch, damage=damage)
    except FileNotFoundError:
        if chain.entries:
            chain.damages.append(Damage("memory-damaged", MEMORY, "is missing, although there is a log"))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, IsADirectoryError) as error:
        chain.damages.append(Damage("memory-damaged", MEMORY, f"cannot be believed ({error})"))
    return None


def _compare(chain: _Chain, memory: Memory) -> None:
    """The memory is written after each entry, so the log may be one entry ahead of it, never behind."""
    last = chain.entries[-1] if chain.entries else None
    number = 0 if last is None else last.number
    if number < memory.number:
        what = f"the log ends with entry {number}, but {memory.number} had been written"
        chain.damages.append(Damage("log-damaged", MEMORY, what))
    elif number > memory.number + 1:
        what = f"it ends with entry {memory.number}, but the log with {number}"
        chain.damages.append(Damage("memory-damaged", MEMORY, what))
    elif last is not None and number == memory.number and last.digest != memory.digest:
        chain.damages.append(Damage("log-damaged", MEMORY, f"entry {number} is not the one that had been written"))
    if chain.entries and chain.entries[0].number > memory.first:
        what = f"the log begins with entry {chain.entries[0].number}, but {memory.first} had been kept"
        chain.damages.append(Damage("log-damaged", MEMORY, what))


def _parse(line: bytes) -> Entry:
    """Raises ValueError for a line that is not an entry as it was written."""
    try:
        stored = json.loads(line)
        if stored.pop("digest") != (digest := _digest(stored)):
            raise ValueError("it was changed")
        _check_types(stored, _ENTRY_TYPES)
        if datetime.fromisoformat(stored["utc"]).tzinfo is None:
            raise ValueError("its time has no zone")
        return Entry(**{**stored, "latch": _latch(stored["latch"])}, digest=digest)
    except (KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"a field is missing or wrong: {error}") from None


def _check_types(stored: dict[str, Any], types: dict[str, type]) -> None:
    for name, kind in types.items():
        if type(stored[name]) is not kind:
            raise TypeError(f"{name} is no {kind.__name__}")


def _latch(stored: Any) -> Latch | None:
    if stored is None:
        return None
    latch = Latch(**stored)
    if not isinstance(latch.state, str) or not isinstance(latch.fault, str | None):
        raise TypeError("latch holds no names")
    return latch


def _digest(stored: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(stored, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


class AlarmLog:
    """The writing end. opened: what was found; an unsound chain is left as it is and a new one begun after it.

    latch: what the last run latched. damage: hazard classes that are not acknowledged yet; the next entry keeps what it
    is set to. Raises OSError when the folder cannot be made or read.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self.opened = read_log(folder)
        unsound = self._unsound()
        last = self.opened.entries[-1] if self.opened.entries else None
        memory = self.opened.memory or Memory()
        number = max(memory.number, 0 if last is None else last.number)
        ahead = last is not None and last.number > memory.number
        self.latch = last.latch if last is not None and (ahead or self.opened.memory is None) else memory.latch
        self.damage = tuple(dict.fromkeys((*memory.damage, *(one.fault for one in unsound))))
        first = memory.first
        if unsound:
            number = max([number, *map(_first_number, segments(folder))])
            first = self.opened.entries[0].number if self.opened.entries else number + 1
        self._memory = Memory(number, _GENESIS if last is None else last.digest, first, self.latch)
        self._chain_begins = bool(unsound) or last is None
        self._memory_behind = False
        self._segment: Path | None = None
        self._entries = 0
        self._continue_segment()

    @property
    def number(self) -> int:
        """Of the last entry on the disk."""
        return self._memory.number

    @property
    def digest(self) -> str:
        """Of the last entry on the disk."""
        return self._memory.digest

    def append(self, utc: datetime, t_ns: int, event: str, data: dict[str, Any], latch: Latch | None) -> None:
        """On the disk when it returns. Raises OSError; then nothing was appended, and it may be tried again."""
        if self._chain_begins:
            found = [str(one) for one in self._unsound()]
            if found:  # the memory first: once the chain has begun anew, the log itself shows this damage no more
                self._remember(replace(self._memory, damage=self.damage))
            self._write(utc, t_ns, BEGUN, {"found": found}, latch)
            self._chain_begins = False
        self._write(utc, t_ns, event, data, latch)

    def _unsound(self) -> list[Damage]:
        """Damage since the chain was last begun, in a segment of its own; what lies before it was reported then."""
        begins = [entry.number for entry in self.opened.entries if entry.event == BEGUN]
        since = begins[-1] if begins else 0
        before = {file.name for file in segments(self._folder) if _first_number(file) < since}
        return [one for one in self.opened.damages if one.fault and one.where.split(" ")[0] not in before]

    def _continue_segment(self) -> None:
        """Write on in the last segment if it is whole; a torn last line is set aside first."""
        files = segments(self._folder)
        if not files or self._chain_begins:
            return
        content = files[-1].read_bytes()
        whole = content[: content.rfind(b"\n") + 1]
        if len(whole) < len(content):
            with files[-1].with_suffix(".torn").open("ab") as torn:
                torn.write(content[len(whole) :] + b"\n")
            os.truncate(files[-1], len(whole))
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
            "latch": None if latch is None else {"state": latch.state, "fault": latch.fault},
            "previous": _GENESIS if event == BEGUN else self._memory.digest,
        }
        digest = _digest(stored)
        _append(
            self._segment, json.dumps({**stored, "digest": digest}, ensure_ascii=False).encode(errors=_ESCAPED) + b"\n"
        )
        self._entries += 1
        self.latch, self._memory_behind = latch, True
        with suppress(OSError):
            self._remember(Memory(number, digest, self._memory.first, latch, self.damage))

    def _forget_oldest(self) -> None:
        """Before a new segment: the memory first, so that a cut between the two leaves too much, not too little."""
        files = segments(self._folder)
        kept = files[-(SEGMENTS_KEPT - 1) :]
        if len(kept) < len(files):
            self._remember(replace(self._memory, first=_first_number(kept[0])))
            for file in files[: -len(kept)]:
                file.unlink()

    def _remember(self, memory: Memory) -> None:
        """When this fails the entry is on the disk all the same; the memory is tried again before the next one."""
        self._memory = memory
        latch = None if memory.latch is None else {"state": memory.latch.state, "fault": memory.latch.fault}
        stored: dict[str, Any] = {
            "v": _VERSION,
            "number": memory.number,
            "digest": memory.digest,
            "first": memory.first,
            "latch": latch,
            "damage": list(memory.damage),
        }
        with replacing(self._folder / MEMORY) as stream:
            stream.write(json.dumps({**stored, "check": _digest(stored)}).encode())
        self._memory_behind = False


def _first_number(segment: Path) -> int:
    return int(segment.stem.removeprefix("alarms-"))


def _append(file: Path, line: bytes) -> None:
    """The whole line or nothing. Raises OSError."""
    fd = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o640)
    try:
        length = os.fstat(fd).st_size
        try:
            if os.write(fd, line) != len(line):
                raise OSError(28, "No space left on device")
            os.fsync(fd)
        except OSError:
            os.truncate(fd, length)
            raise
        if length == 0:
            sync_directory(file.parent)
    finally:
        os.close(fd)
