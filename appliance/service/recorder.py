"""Writes the alarm log in a thread of its own: a slow or full disk delays no tick, and what waits is kept."""

import threading
from collections import deque
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from appliance.alarm_chain import Latch
from appliance.alarm_log import AlarmLog
from appliance.service.log import get_log
from appliance.supervision.alarms import HAZARDS, Kind
from drivers.hosttime import HostClock

_MOST_WAITING = 10_000
_RETRY_S = 1.0
_END_S = 2.0


@dataclass(frozen=True, slots=True)
class _Note:
    utc: datetime
    t_ns: int
    event: str
    data: dict[str, Any]
    latch: Latch | None


class Recorder(threading.Thread):
    """Opens the log at once, so that what was latched is known before the first tick.

    latch, damage: of the last run, see appliance.alarm_log.AlarmLog. failing: why nothing can be written now, None when
    it can. written: number of the last entry on the disk. dropped: notes that did not fit into memory either.
    failure: an error of ours, which has ended the thread; the tick raises it.
    """

    def __init__(self, folder: Path, clock: HostClock) -> None:
        super().__init__(name="recorder", daemon=True)
        self._folder, self._clock = folder, clock
        self._waiting = deque[_Note]()
        self._wake = threading.Event()
        self._ending = False
        self._log = get_log(folder=str(folder))
        self._alarm_log: AlarmLog | None = None
        self.failing: str | None = None
        self.failure: BaseException | None = None
        self.latch: Latch | None = None
        self.damage: tuple[str, ...] = ()
        self.written = self.dropped = 0
        self._open()

    def note(self, event: str, latch: Latch | None, **data: Any) -> None:
        """Add an entry; never blocks. When too many wait the newest takes the place of the one before it, counted."""
        note = _Note(datetime.now(UTC), self._clock.now_ns(), event, data, latch)
        if len(self._waiting) >= _MOST_WAITING:
            self.dropped += 1
            self._waiting[-1] = note
        else:
            self._waiting.append(note)
        self._wake.set()

    def accept_damage(self, fault: str | None) -> None:
        """A person has acknowledged this class; the next entry makes that last."""
        self.damage = tuple(one for one in self.damage if one != fault)

    @property
    def waiting(self) -> int:
        """Entries that are not on the disk yet."""
        return len(self._waiting)

    def waited_ns(self, now_ns: int) -> int:
        """Age of the oldest entry that is not on the disk yet."""
        try:
            return now_ns - self._waiting[0].t_ns
        except IndexError:
            return 0

    def close(self) -> None:
        """Write what waits, for at most two seconds."""
        self._ending = True
        self._wake.set()
        self.join(_END_S)

    def run(self) -> None:
        try:
            self._keep_writing()
        except BaseException as error:
            self.failure = error

    def _keep_writing(self) -> None:
        while not (self._ending and (self.failing is not None or not self._waiting)):
            if self.failing is not None:
                self._wake.wait(_RETRY_S)
                self._wake.clear()
            elif not self._waiting:
                self._wake.wait()
                self._wake.clear()
            self._write_waiting()

    def _write_waiting(self) -> None:
        try:
            if self._alarm_log is None:
                self._open()
            while self._waiting and self._alarm_log is not None:
                self._append(self._alarm_log, self._waiting[0])
                self._waiting.popleft()
        except OSError as error:
            self._note_failure(error)
            if isinstance(error, FileNotFoundError):
                self._begin_again()
        else:
            self._note_success()

    def _append(self, alarm_log: AlarmLog, note: _Note) -> None:
        alarm_log.damage = self.damage
        alarm_log.append(note.utc, note.t_ns, note.event, note.data, note.latch)
        self.written = alarm_log.number
        self._log.info("alarm log", number=self.written, digest=alarm_log.digest, entry=note.event)

    def _open(self) -> None:
        try:
            opened = AlarmLog(self._folder)
        except OSError as error:
            if self.failing is None:
                self.damage = ("memory-damaged",)  # what was latched is not known
            self._note_failure(error)
            return
        self._alarm_log = opened
        self.latch, self.written = opened.latch, opened.number
        self.damage = self.damage or tuple(dict.fromkeys(map(_integrity_class, opened.damage)))
        for damage in opened.opened.damages:
            self._log.warning("alarm log", damage=str(damage))

    def _begin_again(self) -> None:
        """The folder was taken away: the next attempt makes it anew, and what it held is missed."""
        if self._alarm_log is not None:
            self._alarm_log = None
            self.damage = tuple(dict.fromkeys((*self.damage, "log-damaged")))

    def _note_failure(self, error: OSError) -> None:
        if self.failing is None:
            self._log.warning("alarm log cannot be written", what=error.strerror or str(error))
        self.failing = error.strerror or str(error)

    def _note_success(self) -> None:
        if self._alarm_log is not None and self.failing is not None:
            self.failing = None
            self._log.info("alarm log is written again")


def _integrity_class(fault: str) -> str:
    """Another version may have known classes that this one cannot show."""
    known = fault in HAZARDS and HAZARDS[fault].kind is Kind.INTEGRITY
    return fault if known else "memory-damaged"
