"""Writes the alarm log in a thread of its own: a disk that is slow, full or does not answer at all delays no tick, and
what waits is kept.
"""

import os
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from probewatch.appliance.service.host.log import get_log
from probewatch.appliance.service.host.own_files import own_files
from probewatch.appliance.storage.alarm_chain import Event, Latch, segments
from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.appliance.supervision.alarms import HAZARDS
from probewatch.appliance.types import Fault, Kind
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.files.atomic_file import make_folder
from probewatch.drivers.files.lock import held_lock, is_held
from probewatch.drivers.printable import printable_value

LOCK = ".lock"
"""File in the folder of the alarm log on which the service holds a lock."""
_MOST_WAITING = 10_000
"""Entries kept while the disk does not take them. More takes memory, fewer lose entries sooner (docs/failures.md)."""
_LOOK_S = 10.0
"""s between two measurements of the room on the disk while nothing is to be written: each costs a wake-up, and a disk
that fills up takes minutes.
"""
RETRY_S = 1.0
"""s between two attempts to write. More leaves room on a full disk unnoticed for longer; less does work for nothing."""
OPEN_S, END_S = 2.0, 2.0
"""s, how long start and end wait for the disk. More delays the alarm; less starts in alarm, *alarm memory is damaged*,
on a slow disk, and loses its last entries (docs/failures.md).
"""
_AHEAD = 1 << 20
"""Bytes of the log that are read from the disk at a time at the start, each within OPEN_S. More makes a slow disk count
as silent; fewer costs calls.
"""
_VERIFIED_S = 500_000
"""Bytes of the log that are verified in a second at the least, once the disk has delivered them. Measured here: 22
million, on one core that does nothing else, which is 1 s for 38,000 entries. More starts in alarm, *alarm memory is
damaged*, on a slow or busy computer whose log is whole; fewer waits longer for a disk that dies meanwhile.
"""
_LONGEST_OPEN_S = 60.0
"""s, the longest that a start waits for the log, whatever its progress: less than the unit's TimeoutStartSec. The
contact is open meanwhile.
"""
_POLL_S = 0.02
"""s between two checks of how far the log has been read at the start. More ends a wait later, less costs wake-ups."""
_SILENT_NS = 2_000_000_000
"""ns for which the disk may not answer before that is reported: it is no alarm, so a disk that spins up is not worth a
report. Reported within 3 s (docs/failures.md).
"""


@dataclass(frozen=True, slots=True)
class _Note:
    utc: datetime
    t_ns: int
    event: str
    data: dict[str, Any]
    latch: Latch | None


class Recorder(threading.Thread):
    """Opens the log as soon as it is constructed, so that what was latched is known before the first tick. When the
    disk does not answer for two seconds it is not known, which counts as damage; a long log may take longer.
    Construction raises DeviceLost when another service writes there.

    latch, damage: of the last run, see appliance.storage.alarm_log.AlarmLog. written: number of the last entry on the
    disk. dropped: notes that did not fit into memory either. free_bytes: room that the disk has for the log, None while
    it is not known. failure: the exception that has ended the thread; the tick raises it.
    """

    def __init__(self, folder: Path, clock: HostClock) -> None:
        super().__init__(name="recorder", daemon=True)
        self._folder, self._clock = folder, clock
        self._waiting = deque[_Note]()
        self._wake, self._opened = threading.Event(), threading.Event()
        self._ending = False
        self._log = get_log(folder=str(folder))
        self._alarm_log: AlarmLog | None = None
        self._lock_fd: int | None = None
        self._error: str | None = None
        self._asked_ns: int | None = None
        self._said_silent = False
        self._reported_dropped = 0
        self._damage_lock = threading.Lock()
        self.failure: BaseException | None = None
        self.latch: Latch | None = None
        self.damage: tuple[Fault, ...] = ()
        self.written = self.dropped = 0
        self.free_bytes: int | None = None
        self._answered_s, self._verifying_s = time.monotonic(), 0.0
        self.start()
        self._await_log()
        if isinstance(self.failure, DeviceLost):
            raise self.failure
        with self._damage_lock:
            if self._alarm_log is None:
                self.damage = (Fault.MEMORY_DAMAGED,)  # what was latched is not known

    def note(self, event: Event, latch: Latch | None, **data: Any) -> None:
        """Adds an entry; never blocks. When too many wait, the newest replaces the one before it, which counts as
        dropped.
        """
        note = _Note(datetime.now(UTC), self._clock.now_ns(), event, printable_value(data), latch)
        if len(self._waiting) >= _MOST_WAITING:
            self.dropped += 1
            self._waiting[-1] = note
        else:
            self._waiting.append(note)
        self._wake.set()

    def accept_damage(self, fault: Fault | None) -> None:
        """Records that a person has acknowledged this class of damage; the next entry makes that permanent."""
        with self._damage_lock:
            self.damage = tuple(one for one in self.damage if one != fault)

    @property
    def failing(self) -> str | None:
        """Returns why nothing can be written now; None when it can."""
        return self._silence() or self._error

    def watch(self, overloaded: bool = False) -> None:
        """Logs once when the disk does not answer, and once when it does again; the recorder's own thread hangs then.

        overloaded: this computer is short of time, which is no fault of the disk.
        """
        if overloaded:
            return
        silence = self._silence()
        if silence is not None and not self._said_silent:
            self._log.warning("alarm log cannot be written", what=silence)
        elif silence is None and self._said_silent:
            self._log.info("the disk of the alarm log answers again")
        self._said_silent = silence is not None

    @property
    def waiting(self) -> int:
        """Returns the number of entries that are not on the disk yet."""
        return len(self._waiting)

    def waited_ns(self, now_ns: int) -> int:
        """Returns the age of the oldest entry that is not on the disk yet."""
        try:
            return now_ns - self._waiting[0].t_ns
        except IndexError:
            return 0

    def close(self) -> None:
        """Writes what waits, for at most two seconds."""
        self._ending = True
        self._wake.set()
        self.join(END_S)
        if self._waiting:
            self._log.error("alarm log ends without its last entries", entries=self.waiting, what=self.failing)

    def run(self) -> None:
        try:
            own_files()
            self._open()
            self._opened.set()
            self._keep_writing()
        except BaseException as error:
            self.failure = error
        finally:
            self._let_others_in()  # the descriptor belongs to this thread alone
            self._opened.set()

    def _await_log(self) -> None:
        """Waits while the disk delivers more of the log, then for as long as what it has delivered takes to verify."""
        end_s = time.monotonic() + _LONGEST_OPEN_S
        while not self._opened.wait(_POLL_S):
            if time.monotonic() >= min(end_s, self._answered_s + OPEN_S + self._verifying_s):
                return

    def _read_ahead(self) -> None:
        """Reads the whole log, so that the verification finds it in memory. Errors are left to the verification."""
        size = 0
        for segment in segments(self._folder):
            with suppress(OSError), segment.open("rb", buffering=0) as stream:
                while read := len(stream.read(_AHEAD)):
                    size += read
                    self._answered_s = time.monotonic()
        self._verifying_s = size / _VERIFIED_S

    def _silence(self) -> str | None:
        """Returns which file has not answered and for how long; None while the disk takes no longer than it may."""
        asked_ns = self._asked_ns
        age_ns = 0 if asked_ns is None else self._clock.now_ns() - asked_ns
        if age_ns < _SILENT_NS:
            return None
        file = self._folder if self._alarm_log is None else self._alarm_log.file
        return f"{file} has not answered for {age_ns / 1e9:.0f} s"

    def _keep_writing(self) -> None:
        while not (self._ending and (self._error is not None or not self._waiting)):
            if self._error is not None:
                self._clock.wait(self._wake, RETRY_S)
                self._wake.clear()
            elif not self._waiting:
                self._clock.wait(self._wake, _LOOK_S)
                self._wake.clear()
            self._write_waiting()
            self._look_at_room()
            self._look_at_lock()

    def _write_waiting(self) -> None:
        try:
            if self._alarm_log is None:
                self._open()
            while self._waiting and self._alarm_log is not None:
                self._append(self._alarm_log, self._waiting[0])
                self._waiting.popleft()
            self._report_dropped()
        except OSError as error:
            self._note_failure(error)
            if isinstance(error, FileNotFoundError):
                self._begin_again()
        else:
            self._note_success()

    def _report_dropped(self) -> None:
        """Writes an entry with the number of those that did not fit into memory while nothing could be written."""
        dropped = self.dropped - self._reported_dropped
        if dropped and self._alarm_log is not None:
            utc, t_ns = datetime.now(UTC), self._clock.now_ns()
            note = _Note(utc, t_ns, "dropped", {"entries": dropped}, self._alarm_log.latch)
            self._append(self._alarm_log, note)
            self._reported_dropped += dropped

    def _look_at_room(self) -> None:
        """Measures the free space of the disk, for people who plan; nothing depends on it."""
        try:
            with self._asking():
                disk = os.statvfs(self._folder)
        except OSError:
            self.free_bytes = None
        else:
            self.free_bytes = disk.f_bavail * disk.f_frsize

    def _look_at_lock(self) -> None:
        """Takes a new lock when somebody has removed the file, which would let a second service in."""
        held, file = self._lock_fd, self._folder / LOCK
        with suppress(OSError), self._asking():
            if held is None or self._alarm_log is None or is_held(file, held):
                return
            try:
                self._lock_fd = held_lock(file)
            except BlockingIOError:
                self._lock_fd = None  # the lock is not ours any more; the log shows what both have written
                self._log.error("another probewatch service writes here as well", file=str(file))
            else:
                self._log.warning("the file that keeps a second service out was taken away", file=str(file))
            os.close(held)

    def _append(self, alarm_log: AlarmLog, note: _Note) -> None:
        alarm_log.damage = self.damage
        with self._asking():
            alarm_log.append(note.utc, note.t_ns, note.event, note.data, note.latch)
        self.written = alarm_log.number
        self._log.info("alarm log", number=self.written, digest=alarm_log.digest, entry=note.event)

    def _open(self) -> None:
        try:
            with self._asking():
                make_folder(self._folder)
                self._keep_out_others()
                self._read_ahead()
                opened = AlarmLog(self._folder)
        except OSError as error:
            self._note_failure(error)
            return
        with self._damage_lock:
            self._alarm_log = opened
            self.latch, self.written = opened.latch, opened.number
            self.damage = tuple(dict.fromkeys((*self.damage, *map(_integrity_class, opened.damage))))
        for damage in opened.opened.damages:
            self._log.warning("alarm log", damage=str(damage))

    def _keep_out_others(self) -> None:
        """Locks the folder. Two services would number their entries alike, and one would undo what the other has
        latched. Where the disk takes no lock, no service is kept out. Raises DeviceLost.
        """
        self._let_others_in()
        try:
            self._lock_fd = held_lock(self._folder / LOCK)
        except BlockingIOError:
            remedy = "Stop it first, or give this one another folder"
            raise DeviceLost(
                "another probewatch service keeps its alarm log there", f"[alarm] folder = '{self._folder}'", remedy
            ) from None
        except OSError as error:
            self._log.warning("no lock keeps a second service out", why=error.strerror or str(error))

    def _let_others_in(self) -> None:
        held, self._lock_fd = self._lock_fd, None
        if held is not None:
            os.close(held)

    @contextmanager
    def _asking(self) -> Iterator[None]:
        """Marks the time in which the disk was asked for something and may not answer."""
        self._asked_ns = self._clock.now_ns()
        try:
            yield
        finally:
            self._asked_ns = None

    def _begin_again(self) -> None:
        """Records that the folder was removed: the next attempt makes it again, and what it held counts as damage."""
        if self._alarm_log is not None:
            with self._damage_lock:
                self._alarm_log = None
                self.damage = tuple(dict.fromkeys((*self.damage, Fault.LOG_DAMAGED)))

    def _note_failure(self, error: OSError) -> None:
        if self._error is None:
            self._log.warning("alarm log cannot be written", what=error.strerror or str(error))
        self._error = error.strerror or str(error)

    def _note_success(self) -> None:
        if self._alarm_log is not None and self._error is not None:
            self._error = None
            self._log.info("alarm log is written again")


def _integrity_class(fault: str) -> Fault:
    """Returns the class of an integrity fault, MEMORY_DAMAGED for one that only another version knows."""
    known = fault in HAZARDS and Fault(fault).kind is Kind.INTEGRITY
    return Fault(fault) if known else Fault.MEMORY_DAMAGED
