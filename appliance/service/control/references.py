"""Keeps which reference is in force, across restarts and power cuts.

The store is read and written in a thread of its own, so that a disk that is slow, full or does not answer delays no
tick. A reference that is in force but not on the disk yet cannot be verified: the contact never closes on a reference
that a restart would not continue with.
"""

import threading
from collections.abc import Callable, Iterable
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from probewatch.appliance.configuration.config import Config
from probewatch.appliance.service.control.configured_reference import UNNAMED, configured
from probewatch.appliance.service.control.last_reference import last_reference
from probewatch.appliance.service.host.log import get_log
from probewatch.appliance.service.host.own_files import own_files
from probewatch.appliance.service.host.recorder import END_S, OPEN_S, RETRY_S
from probewatch.appliance.storage.calibration_file import calibration_bytes, is_device_set
from probewatch.appliance.storage.reference import (
    Candidate,
    Reference,
    Size,
    candidate_from_content,
    candidate_of_entry,
    refuse_simulated,
    size_for,
)
from probewatch.appliance.storage.reference_dates import Dates, dates_of
from probewatch.appliance.storage.reference_store import (
    CONFIGURED,
    Entry,
    History,
    read_history,
    write_history,
)
from probewatch.appliance.supervision.alarms import EXPIRED_CALIBRATION, NO_CALIBRATION
from probewatch.appliance.types import Calibration, Verdict, VerdictKind
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.samples import Matrix4

SOFTWARE = version("probewatch")


class References(threading.Thread):
    """Reads what is in force as soon as it is constructed; writes only after begin().

    current: what is in force; None until the disk has answered and, for a device set without a size, a picture was
    seen. changed: what is wrong with the configuration's calibration file, in words, while the file is neither in force
    nor the one that a person last decided about. failure: the exception that has ended the thread; the tick raises it.
    wall_clock: calendar time. clock: times the wait for the next attempt to write. Construction raises
    ConfigurationError when no reference can be had: the store is damaged, or the first calibration cannot be used.
    """

    def __init__(
        self,
        config: Config,
        wall_clock: Callable[[], datetime] = lambda: datetime.now(UTC),
        clock: HostClock | None = None,
    ) -> None:
        super().__init__(name="references", daemon=True)
        self._folder, self._place, self._simulated = config.alarm.folder, config.calibration, config.simulated
        self._clock = HostClock() if clock is None else clock
        self._wake, self._opened = threading.Event(), threading.Event()
        self._lock = threading.RLock()
        self._history = self._written = History()
        self._contents: dict[str, bytes] = {}
        self._unsized: bytes | None = None
        self._seen_px: Size | None = None
        self._look, self._decided, self._begun, self._ending = True, False, False, False
        self._error: str | None = None
        self._wall_clock, self._dates_known = wall_clock, (0, Dates())
        self._missing: tuple[str, ...] = ()
        self._lapsed = ""
        self._log = get_log(folder=str(self._folder))
        self.current: Reference | None = None
        self.changed: str | None = None
        self.failure: BaseException | None = None
        self.start()
        self._opened.wait(OPEN_S)
        if isinstance(self.failure, ConfigurationError):
            raise self.failure

    def begin(self) -> None:
        """Permits writing from now on, because no other service runs here."""
        self._begun = True
        self._wake.set()

    def close(self) -> None:
        """Writes what is not on the disk yet, for at most two seconds."""
        self._ending = True
        self._wake.set()
        self.join(END_S)
        if not self.on_disk:
            self._log.error("the reference in force is not on the disk", what=self.waits)

    @property
    def on_disk(self) -> bool:
        """Returns whether a restart would continue with what is in force."""
        return len(self._written.entries) == len(self._history.entries)

    @property
    def history(self) -> History:
        """Returns every reference that was ever in force, including the present one."""
        return self._history

    @property
    def waits(self) -> str | None:
        """Returns what must happen before a reference exists, or the one in force may be verified; None: nothing."""
        if not self._opened.is_set():
            return f"{self._folder} has not answered yet"
        if self.current is None and self._place.file is None:
            scan = "Scan a cross-wire: on the page, or probewatch recalibrate --live --solve all"
            return f"there is no calibration yet. {scan}; or probewatch calibration use FILE"
        if self.current is None:
            return "no picture has come yet, whose size the device set does not state"
        if not self.on_disk:
            return f"it is not on the disk yet{'' if self._error is None else f' ({self._error})'}"
        if self.current.entry.verified_utc is None and self._missing and not self._expired:
            missing = ", ".join(self._missing)
            new = "far from the one before" if self.current.entry.number > 1 else "the first calibration"
            return f"it is {new}, and of it is not shown yet: {missing}"
        return self._expired or self._lapsed or None

    @property
    def next_step(self) -> str:
        """Returns what a person has to do before any motion can verify something; empty where motion can."""
        if self._opened.is_set() and self.current is None and self._place.file is None:
            return NO_CALIBRATION
        return EXPIRED_CALIBRATION if self._expired else ""

    @property
    def dates(self) -> Dates:
        """Returns the dates of the reference in force."""
        current = self.current
        if current is not None and self._dates_known[0] != current.entry.number:
            found = dates_of(current.entry, self._history.entries, current.candidate.content, self._place.due_days)
            self._dates_known = current.entry.number, found
        return self._dates_known[1]

    @property
    def overdue(self) -> str:
        """Returns which of its dates has passed, in words; empty while none has."""
        return self.dates.overdue(self._wall_clock())

    @property
    def _expired(self) -> str:
        return self.dates.expired(self._wall_clock()) if self._place.overdue == "expires" else ""

    def lapse_ended(self) -> bool:
        """Returns whether the reference had expired by the last call and is valid again, as when the clock was stepped.
        What was shown before verifies nothing. Until the next call no verdict is kept, so that one in between is not
        taken for new.
        """
        before, self._lapsed = self._lapsed, self._expired
        return bool(before) and not self._lapsed

    def see(self, size_px: Size | None) -> None:
        """Takes (width, height) of the last good picture."""
        if size_px is not None and size_px != self._seen_px:
            self._seen_px = size_px
            self._wake.set()

    def look_again(self) -> None:
        """Requests another look at the configuration's calibration file, which may have changed."""
        self._look = True
        self._wake.set()

    def from_content(self, content: bytes, file: str) -> Candidate:
        """Returns a candidate for reference. Raises ConfigurationError, also for a simulated one on a real cart."""
        candidate = candidate_from_content(content, file, self._size_for(content), self._place.probe)
        return self._allowed(candidate)

    def from_history(self, number: int) -> Candidate:
        """Returns an earlier reference, read from the disk. Raises ConfigurationError."""
        return self._allowed(candidate_of_entry(self._folder, self._history.entry(number)))

    def take(
        self,
        candidate: Candidate,
        origin: str,
        who: str = "",
        difference: str = "",
        to_show: Iterable[str] = (),
        relative_pose: tuple[float, ...] | None = None,
    ) -> Reference:
        """Puts a candidate into force. to_show: checks that must be shown, all in one verdict, before its first OK.
        relative_pose: as already known under this calibration.
        """
        with self._lock:
            entry = Entry(
                number=len(self._history.entries) + 1,
                origin=origin,
                utc=_now(),
                software=SOFTWARE,
                file=candidate.file,
                sha256=candidate.sha256,
                image_size_px=candidate.calibration.image_size_px,
                probe=candidate.probe,
                simulated=candidate.calibration.simulated,
                difference=difference,
                who=who,
                to_show=tuple(to_show),
                relative_pose=relative_pose,
            )
            self._unsized, self._missing, self._lapsed = None, entry.to_show, ""
            self._contents[candidate.sha256] = candidate.content
            changes: dict[str, object] = {"entries": (*self._history.entries, entry)}
            if origin == CONFIGURED:
                changes["configured_sha256"] = candidate.sha256
            self._history = self._history.model_copy(update=changes)
            self.current = Reference(entry, candidate)
        self.look_again()
        return self.current

    def note_verified(self) -> None:
        """Records that motion has verified the reference in force."""
        if self.current is None or self.current.entry.verified_utc is not None:
            return
        with self._lock:
            entry = self.current.entry.model_copy(update={"verified_utc": _now()})
            self._history = self._history.model_copy(update={"entries": (*self._history.entries[:-1], entry)})
            self.current = Reference(entry, self.current.candidate)
            self._decided = entry.origin != CONFIGURED
        self.look_again()

    def note_relative_pose(self, reference: Calibration | None, relative_pose: Matrix4 | None) -> None:
        """Keeps the pose of a second marker body relative to the first with the reference in force, if it is the one
        given, so that a restart finds what was bent meanwhile. Another reference begins without it.
        """
        current = self.current
        if current is None or current.calibration is not reference:
            return
        known = None if relative_pose is None else tuple(map(float, relative_pose.ravel()))
        if known == current.entry.relative_pose:
            return
        with self._lock:
            entry = current.entry.model_copy(update={"relative_pose": known})
            self._history = self._history.model_copy(update={"entries": (*self._history.entries[:-1], entry)})
            self.current = Reference(entry, current.candidate)
        self._wake.set()

    def judged(self, verdicts: tuple[Verdict, ...]) -> tuple[Verdict, ...]:
        """Returns the line's verdicts, without an OK that the reference in force has not earned yet."""
        if verdicts and self.current is not None:
            self._missing = self._not_shown(verdicts[-1], self.current.entry)
        return tuple(self._judged(one) for one in verdicts)

    def run(self) -> None:
        try:
            own_files()
            self._open()
            self._opened.set()
            self._work()
            while not self._ending or (self._unwritten and self._error is None):
                if not self._ending:
                    self._clock.wait(self._wake, None if self._error is None else RETRY_S)
                    self._wake.clear()
                self._work()
        except BaseException as error:
            self.failure = error  # the tick raises it
        finally:
            self._opened.set()

    @property
    def _unwritten(self) -> bool:
        return self._begun and self._written is not self._history

    def _open(self) -> None:
        history = read_history(self._folder)
        if history is not None:
            self._history = self._written = history
        if history is not None and history.in_force is not None:
            candidate = self._allowed(candidate_of_entry(self._folder, history.in_force))
            self.current, self._missing = Reference(history.in_force, candidate), history.in_force.to_show
            return
        if history is None:
            _refuse_lost(self._folder)
        if self._place.file is None:
            return
        content = calibration_bytes(self._place.file)
        if is_device_set(content) and self._size_for(content) is None:
            self._unsized = content
        else:
            self.take(self.from_content(content, str(self._place.file)), CONFIGURED)

    def _work(self) -> None:
        self._complete()
        if self._look and self._begun and self.current is not None:
            self._look = False
            self._compare_configured()
        if self._unwritten:
            self._write()

    def _complete(self) -> None:
        """Takes the first calibration once a picture has given the size that its device set does not state."""
        content = self._unsized
        if content is None or self._seen_px is None:
            return
        candidate = self.from_content(content, str(self._place.file))
        with self._lock:
            if self._unsized is content:  # and no person has taken another meanwhile
                self.take(candidate, CONFIGURED)

    def _compare_configured(self) -> None:
        """Reports a configured file, or that none is named any more, that is neither in force nor as it was when a
        person last decided.
        """
        sha256, what, remedy = configured(self._place.file, len(self._history.entries))
        changed = None if self._decided_about(sha256) else what
        if changed is not None and changed != self.changed:
            self._log.warning("configured calibration is not in force", what=changed, remedy=remedy)
        self.changed = changed

    def _decided_about(self, sha256: str) -> bool:
        with self._lock:
            assert self.current is not None
            entry = self.current.entry
            in_force = sha256 == entry.sha256
            if self._decided or (in_force and entry.verified_utc is not None):
                self._decided = False
                if sha256 != self._history.configured_sha256:
                    self._history = self._history.model_copy(update={"configured_sha256": sha256})
            known = self._history.configured_sha256
            return in_force or sha256 == (UNNAMED if known is None else known)

    def _write(self) -> None:
        with self._lock:
            history, contents = self._history, dict(self._contents)
        try:
            write_history(self._folder, history, contents)
        except OSError as error:
            if self._error is None:
                self._log.warning("the history of references cannot be written", what=error.strerror or str(error))
            self._error = error.strerror or str(error)
            return
        if self._error is not None:
            self._log.info("the history of references is written again")
        self._error = None
        with self._lock:
            self._written = history
            self._contents = {key: content for key, content in self._contents.items() if key not in contents}

    def _size_for(self, content: bytes) -> Size | None:
        known_px = None if self.current is None else self.current.calibration.image_size_px
        return size_for(content, self._place, self._seen_px or known_px)

    def _allowed(self, candidate: Candidate) -> Candidate:
        refuse_simulated(candidate, self._simulated)
        return candidate

    def _judged(self, verdict: Verdict) -> Verdict:
        """Withholds an OK of a reference that is not on the disk, is far and not wholly shown, or has expired."""
        kept = self.current is not None and self.on_disk and not self._not_shown(verdict, self.current.entry)
        self._lapsed = self._lapsed or self._expired
        if kept and not self._lapsed:
            return verdict
        withheld = replace(verdict, verified_ns=None)
        if verdict.kind is not VerdictKind.OK:
            return withheld
        return replace(withheld, kind=VerdictKind.NOT_VERIFIED, reason=f"reference: {self.waits}")

    @staticmethod
    def _not_shown(verdict: Verdict, entry: Entry) -> tuple[str, ...]:
        """Returns the checks that the first OK of this reference still lacks."""
        if entry.verified_utc is not None:
            return ()
        shown = {check.name for check in verdict.checks if check.verdict is VerdictKind.OK}
        return tuple(name for name in entry.to_show if name not in shown)


def _refuse_lost(folder: Path) -> None:
    """Raises ConfigurationError if the alarm log names a reference; else a missing store is a cart's first start."""
    known = last_reference(folder)
    if known is not None:
        what = f"is gone, but the alarm log says that {known} was in force"
        remedy = "Restore it from a copy, or start again with the configuration's file: probewatch calibration reset"
        raise ConfigurationError(what, str(folder / "references"), remedy)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
