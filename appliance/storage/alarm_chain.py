"""Reads and verifies the chain of the alarm log: append-only JSON lines, and the memory that states where it ends.

A folder holds segments `alarms-NNNNNNNN.jsonl`, named by the number of their first entry, and `alarm-memory.json`. Each
entry carries the SHA-256 of its own content, which includes the digest of the entry before it, so that an entry that
was changed, removed or inserted breaks the chain; the memory holds number and digest of the last entry, so that a log
that was truncated is detected as well. This detects accidents and careless hands; somebody who may write to the folder
and knows this format can make a new chain, which the digests in the system journal would contradict.
"""

import hashlib
import json
import re
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

from probewatch.appliance.types import Fault

REPORTS_FAULTS = (Fault.LOG_DAMAGED, Fault.MEMORY_DAMAGED)

MEMORY = "alarm-memory.json"
AFTER = "after"
"""Field of a chain's first entry that holds the digest of the last entry before it."""
CUT_OFF = "is cut off"
"""Describes half an entry at the end of a segment that is not the last."""
VERSION = 1
GENESIS = "0" * 64
"""Takes the place of the digest before the very first entry: as long as a SHA-256 in hexadecimal."""
_SEGMENT = re.compile(r"alarms-([0-9]{8,})\.jsonl")
_ENTRY_TYPES = {"number": int, "utc": str, "t_ns": int, "event": str, "data": dict, "previous": str}
_MEMORY_TYPES = {"number": int, "digest": str, "first": int, "damage": list}


class Event(StrEnum):
    """Names what an entry holds: all events that this version writes, of which earlier versions know fewer."""

    CHAIN_BEGUN = "chain begun"
    STARTED = "started"
    STOPPED = "stopped"
    STATE = "state"
    REQUEST = "request"
    REFERENCE = "reference"
    RELOADED = "reloaded"
    ESTIMATE = "estimate"
    PROPOSAL = "proposal"
    UNDECIDED = "undecided"
    GIVEN_UP = "recalibration given up"
    OVERDUE = "calibration date"
    OVERLOADED = "overloaded"
    OVERLOAD_ENDED = "overload-ended"
    WALL_CLOCK = "wall-clock"
    SLEPT = "slept"


@dataclass(frozen=True, slots=True)
class Latch:
    """Holds the name and fault class of a latched state; every entry has it, so that the log can replace the memory."""

    state: str
    fault: str | None


@dataclass(frozen=True, slots=True)
class Entry:
    """Represents an entry. number: counts from 1. utc: ISO 8601, wall clock. t_ns: of the host clock, since boot."""

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
    """Describes what contradicts the chain, and where. fault: what it raises; None for a write torn by a power cut."""

    fault: Fault | None
    where: str
    what: str

    def __str__(self) -> str:
        return f"{self.where}: {self.what}"


@dataclass(frozen=True, slots=True)
class Memory:
    """Holds what outlives the process. damage: hazard classes that no person has acknowledged yet."""

    number: int = 0
    digest: str = GENESIS
    first: int = 1
    latch: Latch | None = None
    damage: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Reading:
    """Holds all entries that could be read, in order, and everything that is wrong with them."""

    entries: tuple[Entry, ...]
    damages: tuple[Damage, ...]
    memory: Memory | None

    @property
    def broken(self) -> tuple[Damage, ...]:
        """Returns the damage that no power cut explains: the chain is not whole."""
        return tuple(damage for damage in self.damages if damage.fault is not None)


@dataclass(slots=True)
class _Chain:
    """Walks the entries in order and compares each with what the one before requires."""

    entries: list[Entry] = field(default_factory=list)
    damages: list[Damage] = field(default_factory=list)

    def take(self, where: str, line: bytes, promised: int | None) -> None:
        """Takes a line. promised: the number that the name of a segment gives its first line; None for the others."""
        try:
            entry = _parse(line)
        except ValueError as error:
            self.damages.append(Damage(Fault.LOG_DAMAGED, where, f"is not an entry ({error})"))
            return
        if what := _misplaced(entry, promised):
            self.damages.append(Damage(Fault.LOG_DAMAGED, where, what))
        if self.entries:
            self._link(where, entry, self.entries[-1])
        self.entries.append(entry)

    def _link(self, where: str, entry: Entry, before: Entry) -> None:
        if entry.event == Event.CHAIN_BEGUN:
            self._link_begun(where, entry, before)
            return
        if entry.number != before.number + 1:
            what = f"entry {entry.number} follows entry {before.number}: entries are missing or were put in"
            self.damages.append(Damage(Fault.LOG_DAMAGED, where, what))
        elif entry.previous != before.digest:
            self.damages.append(Damage(Fault.LOG_DAMAGED, where, f"entry {entry.number} does not continue the chain"))

    def _link_begun(self, where: str, entry: Entry, before: Entry) -> None:
        """Checks an entry that starts the chain again after an unsound one, of which it states where that ended."""
        if entry.number <= before.number:
            what = f"entry {entry.number}, which begins a chain, follows entry {before.number}: it was moved or copied"
            self.damages.append(Damage(Fault.LOG_DAMAGED, where, what))
        elif entry.data.get(AFTER, before.digest) != before.digest:
            what = f"entry {entry.number} began a chain after another entry than {before.number}: entries are missing"
            self.damages.append(Damage(Fault.LOG_DAMAGED, where, what))


def read_log(folder: Path) -> Reading:
    """Reads and verifies everything in the folder; an empty or missing folder is an empty log. Raises OSError."""
    chain = _Chain()
    files = segments(folder)
    for file in files:
        _read_segment(file, chain, last=file == files[-1])
    memory = _read_memory(folder, chain)
    if memory is not None:
        _compare(chain, memory)
    return Reading(tuple(chain.entries), tuple(chain.damages), memory)


def segments(folder: Path) -> list[Path]:
    """Returns the segments, oldest first; other files in the folder are not ours."""
    named = [file for file in folder.glob("alarms-*.jsonl") if _SEGMENT.fullmatch(file.name) and file.is_file()]
    return sorted(named, key=first_number)


def _read_segment(file: Path, chain: _Chain, last: bool) -> None:
    try:
        content = file.read_bytes()
    except OSError as error:
        chain.damages.append(Damage(Fault.LOG_DAMAGED, file.name, f"cannot be read ({error.strerror})"))
        return
    for number, line in enumerate(content.splitlines(keepends=True), 1):
        where = f"{file.name} line {number}"
        if line.endswith(b"\n"):
            chain.take(where, line, first_number(file) if number == 1 else None)
        elif last:
            chain.damages.append(Damage(None, where, "was cut off while it was written"))
        else:
            chain.damages.append(Damage(Fault.LOG_DAMAGED, where, CUT_OFF))


def _read_memory(folder: Path, chain: _Chain) -> Memory | None:
    try:
        stored = _json((folder / MEMORY).read_bytes())
        if stored.pop("check") != digest_of(stored) or stored.pop("v") != VERSION:
            raise ValueError("its content does not match its checksum")
        _check_types(stored, _MEMORY_TYPES)
        latch, damage = _latch(stored.pop("latch")), tuple(map(str, stored.pop("damage")))
        return Memory(**stored, latch=latch, damage=damage)
    except FileNotFoundError:
        if chain.entries:
            chain.damages.append(Damage(Fault.MEMORY_DAMAGED, MEMORY, "is missing, although there is a log"))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, IsADirectoryError) as error:
        chain.damages.append(Damage(Fault.MEMORY_DAMAGED, MEMORY, f"cannot be believed ({error})"))
    return None


def _compare(chain: _Chain, memory: Memory) -> None:
    """Compares log and memory. The memory is written after each entry: the log may be one entry ahead, never behind."""
    last = chain.entries[-1] if chain.entries else None
    number = 0 if last is None else last.number
    if number < memory.number:
        what = f"the log ends with entry {number}, but {memory.number} had been written"
        chain.damages.append(Damage(Fault.LOG_DAMAGED, MEMORY, what))
    elif number > memory.number + 1:
        what = f"it ends with entry {memory.number}, but the log with {number}"
        chain.damages.append(Damage(Fault.MEMORY_DAMAGED, MEMORY, what))
    elif last is not None and number == memory.number and last.digest != memory.digest:
        chain.damages.append(Damage(Fault.LOG_DAMAGED, MEMORY, f"entry {number} is not the one that had been written"))
    if chain.entries and chain.entries[0].number > memory.first:
        what = f"the log begins with entry {chain.entries[0].number}, but {memory.first} had been kept"
        chain.damages.append(Damage(Fault.LOG_DAMAGED, MEMORY, what))


def _parse(line: bytes) -> Entry:
    """Returns the entry of a line. Raises ValueError for a line that is not an entry as it was written."""
    try:
        stored = _json(line)
        if stored.pop("digest") != (digest := digest_of(stored)):
            raise ValueError("it was changed")
        _check_types(stored, _ENTRY_TYPES)
        if datetime.fromisoformat(stored["utc"]).tzinfo is None:
            raise ValueError("its time has no zone")
        return Entry(**{**stored, "latch": _latch(stored["latch"])}, digest=digest)
    except (KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"a field is missing or wrong: {error}") from None


def _json(data: bytes) -> Any:
    """Parses JSON. Raises ValueError in words for a person, not in those of the codec."""
    try:
        return json.loads(data)
    except UnicodeDecodeError:
        raise ValueError("it is not UTF-8 text") from None
    except json.JSONDecodeError:
        raise ValueError("it is not JSON, or a part of it is missing") from None


def _misplaced(entry: Entry, promised: int | None) -> str:
    """Returns why the entry cannot be in this line of its segment; empty where it can."""
    if promised is not None and entry.number != promised:
        return f"entry {entry.number} stands where the segment's name promises entry {promised}"
    if entry.event == Event.CHAIN_BEGUN and promised is None:
        return f"entry {entry.number} begins a chain, but not a segment: it was moved or copied"
    return ""


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


def digest_of(stored: dict[str, Any]) -> str:
    """Returns the SHA-256 of the content, in hexadecimal."""
    return hashlib.sha256(json.dumps(stored, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def first_number(segment: Path) -> int:
    """Returns the number of the first entry in a segment, from its name."""
    return int(segment.stem.removeprefix("alarms-"))
