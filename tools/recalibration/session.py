"""Runs one live recalibration at a time: page and terminal drive this object, and any number of people view it.

idle → (latency →) scanning → review → (checking → review →) proving → done; a scan that is rejected, abandoned or not
verified ends in `ended`, with the calibration before it in force. The service is asked to recalibrate before anything
is scanned, over a connection that lives as long as the scan (where it breaks, the service gives the scan up), and again
where it comes back without remembering: the contact stays open from the first request until the service has proved what
it took. Nothing that goes wrong here closes it.
"""

import contextlib
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.service.feed.message import FeedMessage, LineStarted, Lost, Taken
from probewatch.appliance.types import Calibration, State
from probewatch.drivers.errors import ProbewatchError
from probewatch.drivers.files.atomic_file import check_writable
from probewatch.drivers.printable import printable
from probewatch.tools.recalibration.held_service import ANSWER_S, Asked, HeldService
from probewatch.tools.recalibration.paperwork import (
    LONGEST_WORDS,
    Begin,
    Signature,
    checked,
    sign_off,
    signed,
    write_signed,
)
from probewatch.tools.recalibration.phase import HELD, LISTENING, OPEN, Attendance, Phase
from probewatch.tools.recalibration.scanning import Scanned, counts_of, marked, state_fields
from probewatch.tools.recalibration.steps import LatencyStep, Sound, estimate_of
from probewatch.tools.shared.feed import Feed
from probewatch.tools.shared.sign_off import NOT_MADE
from probewatch.tools.shared.status_watch import Seen, StatusWatch
from probewatch.tools.shared.threaded import Threaded
from probewatch.tools.shared.verification import waits_for

_LOOK_S = 0.5
"""Seconds between two looks at the service's state, and before a lost feed is asked for again: ten ticks."""
_SOLVE_EVERY_S = 0.5
"""Seconds between two solutions while views come: a person reads no faster, and 300 views take .1 s."""
_LATENCY_EVERY_S = 1.0
"""Seconds between two solutions of the latency: one of a minute's pictures takes some .2 s. Not varied."""
_FARTHEST_MM = 1e5
"""Distance of a point from the tracker's origin, mm; no tracker sees so far, and NaN is not less."""


class ScanSession(Threaded):
    """Leads one scan. control, feed: sockets of the service. folder: for new calibrations, readable by the service.

    watch: of the same service. now_s: a clock in seconds. Requests raise ProbewatchError, in words for the technician.
    """

    def __init__(
        self,
        control: Path,
        feed: Path,
        folder: Path,
        watch: StatusWatch,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._feed, self._folder, self._watch, self._now_s = feed, folder, watch, now_s
        self._service = HeldService(control)
        self._lock = threading.RLock()
        self._changed = threading.Event()
        self._ended = threading.Event()
        super().__init__("recalibration")
        self._phase, self._message, self._trouble = Phase.IDLE, "", ""
        self._begin: Begin | None = None
        self._scanned: Scanned | None = None
        self._latency: LatencyStep | None = None
        self._status: Mapping[str, Any] = {}
        self._reference: Calibration | None = None
        self._heard_settings = False
        self._file: Path | None = None
        self._sha256 = ""
        self.attendance = Attendance(now_s)
        self._fields: dict[str, Any] = {}
        self._solved_s = 0.0

    def close(self) -> None:
        """Gives up a scan that nobody can finish any more, so that the cart can be used."""
        self._ended.set()
        self._changed.set()
        self._thread.join(2 * ANSWER_S)
        with self._lock, contextlib.suppress(ProbewatchError):
            if self._phase in HELD:
                self._abort("the page has ended")
        self._service.let_go()

    @property
    def phase(self) -> Phase:
        return self._phase

    def fields(self) -> dict[str, Any]:
        """Returns everything there is to show; docs/page.md lists the phases."""
        with self._lock:
            begin = self._begin
            return {
                "phase": self._phase.value,
                "message": self._message,
                "trouble": self._trouble or ("" if self._scanned is None else self._scanned.pose_trouble),
                "technician": "" if begin is None else begin.technician,
                "probe": "" if begin is None else begin.probe,
                "preset": "" if begin is None else begin.preset,
                "latency": self._latency.fields() if self._latency and self._phase is Phase.LATENCY else None,
                "file": None if self._file is None else str(self._file),
                "scan": {**self._fields, **counts_of(self._scanned)} if self._fields and self._scanned else None,
            }

    def look_at(self, t_ns: int) -> dict[str, Any] | None:
        """Returns what was found in the picture of that time; None where nothing is scanned, or it is too old."""
        with self._lock:
            scanned = self._scanned
            if scanned is None or self._phase not in (Phase.SCANNING, Phase.CHECKING):
                return None
            return scanned.look_at(t_ns)

    @property
    def looked_ns(self) -> int | None:
        """Returns the time of the newest picture that was examined; None while nothing is scanned."""
        scanned = self._scanned
        if scanned is None or self._phase not in (Phase.SCANNING, Phase.CHECKING):
            return None
        look = scanned.last
        return None if look is None else look.t_ns

    def thumbnail(self, index: int) -> Any:
        """Returns the picture around the crossing of a view, (h, w) uint8, None where there is no such view."""
        with self._lock:
            known = [] if self._scanned is None else self._scanned.thumbnails
            return known[index] if 0 <= index < len(known) else None

    def begin(self, begin: Begin) -> None:
        """Has the service recalibrate, and begins the scan. Raises ConfigurationError where no file can be written."""
        with self._lock:
            if self._phase in OPEN:
                who = "" if self._begin is None else self._begin.technician
                raise ControlRefused(
                    f"{who} recalibrates already", "recalibration", "Look on, or have it rejected first"
                )
            begin = checked(begin)
            check_writable(self._folder / "calibration")  # checked now, not once the scan is signed
            self._status = self._watch.seen().status or {}
            self._service.grasp()
            self._latency = LatencyStep() if begin.latency else None
            self._begin, self._scanned, self._file, self._sha256 = begin, None, None, ""
            self._heard_settings, self._reference, self._fields = False, None, {}
            self._phase, self._message, self._trouble = Phase.SCANNING, "", ""
            if begin.latency:
                self._phase = Phase.LATENCY
            self.attendance.begin()
        self._changed.set()

    def take_latency(self, measured: bool) -> None:
        """Ends the measurement of the latency and begins the scan. measured: whether the measured latency is used."""
        with self._lock:
            self._require(Phase.LATENCY)
            found = None if self._latency is None else self._latency.found
            if measured and found is None:
                what = "the motion does not show how late the tracker is"
                raise ControlRefused(what, "latency", "Move straight up and down over the bottom, turning sharply")
            if not measured:
                self._latency = None
            self._phase = Phase.SCANNING
        self._changed.set()

    def check(self, known_mm: tuple[float, float, float] | None = None) -> None:
        """Begins the check at another crossing. known_mm: where it is, tracker axes, if a pointer has measured it."""
        with self._lock:
            self._require(Phase.REVIEW)
            if known_mm is not None and not all(abs(value) < _FARTHEST_MM for value in known_mm):
                raise ControlRefused("three numbers are needed, mm", "where the point is", "Or leave it out")
            assert self._scanned is not None
            self._service.hold(self._watch.seen(), wanted=True)
            self._scanned.begin_check(None if known_mm is None else np.array(known_mm))
            self._phase = Phase.CHECKING
            self._solve()
        self._changed.set()

    def end_check(self) -> None:
        """Ends the check, and returns to the review."""
        with self._lock:
            self._require(Phase.CHECKING)
            assert self._scanned is not None
            assert self._scanned.check is not None
            self._scanned.check.scan.finish()
            self._phase = Phase.REVIEW
            self._solve()
        self._changed.set()

    def finish(self) -> None:
        """Ends the scan, and begins the review."""
        with self._lock:
            self._require(Phase.SCANNING)
            if self._scanned is None or self._scanned.running is None:
                raise ControlRefused("no view of the crossing yet", "scan", "Pass slowly through the crossing")
            for view in self._scanned.scan.finish():
                self._scanned.settle(view)
            self._phase = Phase.REVIEW
            self._solve()

    def resume(self) -> None:
        """Goes on with the scan; its views are kept."""
        with self._lock:
            self._require(Phase.REVIEW)
            self._service.hold(self._watch.seen(), wanted=True)
            self._phase = Phase.SCANNING
        self._changed.set()

    def strike(self, index: int, struck: bool = True) -> None:
        """Leaves a view out, or takes it back."""
        with self._lock:
            self._change(lambda scanned: scanned.strike(index, struck))

    def correct(self, index: int, centre_px: tuple[float, float]) -> None:
        """Puts the crossing of a view elsewhere, (column, row)."""
        with self._lock:
            self._change(lambda scanned: scanned.correct(index, centre_px))

    def require_complete(self) -> None:
        """Raises ProbewatchError where the scan, as it is, cannot be accepted whoever signs it."""
        with self._lock:
            self._require(Phase.REVIEW)
            assert self._scanned is not None
            self._scanned.calibration()

    def require_second(self, name: str) -> None:
        """Raises ProbewatchError where the named person may not sign what the technician scanned."""
        assert self._begin is not None
        sign_off(self._begin, signed(Signature(name, "–"))).check()

    def accept(self, signature: Signature) -> None:
        """Writes the calibration, gives it to the service, and waits until the service has verified it. Raises Asked
        for a difference that must be accepted.
        """
        signature = signed(signature)
        with self._lock:
            self._require(Phase.REVIEW)
            assert self._scanned is not None
            assert self._begin is not None
            sign_off(self._begin, signature).check()
            seen = self._watch.seen()
            simulated = bool(seen.status and seen.status.get("simulated"))
            calibration = marked(self._scanned.calibration(), simulated)
            check = f"{NOT_MADE}{signature.unchecked}" if signature.unchecked else self._scanned.check_record()
            self._service.hold(seen, wanted=True)
            file = write_signed(self._folder, calibration, self._begin, signature, self._scanned, check)
            self._file = file
            try:
                self._sha256 = self._service.give(file, signature.confirm)
            except Asked:
                file.unlink(missing_ok=True)
                self._file = None
                raise
            self._phase, self._message = Phase.PROVING, ""
        self._changed.set()

    def reject(self, why: str = "") -> None:
        """Ends the recalibration; the calibration in force stays."""
        with self._lock:
            if self._phase not in OPEN:
                raise ControlRefused("nothing is being recalibrated", "recalibration", "Begin one")
            self._abort(f"rejected{': ' if why else ''}{printable(why, LONGEST_WORDS)}")

    def dismiss(self) -> None:
        """Returns from a recalibration that has ended to the beginning."""
        with self._lock:
            if self._phase in (Phase.DONE, Phase.ENDED):
                self._phase, self._scanned, self._begin, self._fields = Phase.IDLE, None, None, {}
                self._message = self._trouble = ""

    def _run(self) -> None:
        while not self._ended.is_set():
            if self._phase in LISTENING:
                self._scan()
            else:
                self._changed.wait(_LOOK_S)
                self._changed.clear()
            self._look()

    def _scan(self) -> None:
        """Takes messages of the feed until the phase changes, or the feed is lost."""
        phase = self._phase
        try:
            with Feed(self._feed) as feed:
                looked_s = 0.0
                while self._phase is phase and not self._ended.is_set():
                    message = feed.next(_LOOK_S)
                    with self._lock:
                        self._take(message)
                    if self._now_s() - looked_s > _LOOK_S:
                        looked_s = self._now_s()
                        self._look()
        except ProbewatchError as error:
            self._trouble = f"the pictures are lost: {error.what}. The scan is kept, and goes on when they come back"
            self._ended.wait(_LOOK_S)

    def _take(self, message: FeedMessage | None) -> None:
        if self._phase not in LISTENING:
            return
        if self._phase is Phase.LATENCY:
            if isinstance(message, Taken) and self._latency is not None:
                self._latency.take(message.sample)
                if self._now_s() - self._solved_s > _LATENCY_EVERY_S:
                    self._solved_s = self._now_s()
                    self._latency.solve()
        elif isinstance(message, LineStarted) and not self._heard_settings:
            self._heard_settings = True
            self._reference = None if message.settings is None else message.settings.reference
            self._scanned = self._new_scan()
        elif self._scanned is None:
            return
        elif isinstance(message, Taken):
            self._scanned.take(message.sample, checking=self._phase is Phase.CHECKING)
            if self._now_s() - self._solved_s > _SOLVE_EVERY_S:
                self._solve()
        elif isinstance(message, Lost):
            self._scanned.lost += message.samples

    def _new_scan(self) -> Scanned:
        begin = self._begin
        assert begin is not None
        estimate = estimate_of(self._status)
        latency = None if self._latency is None else self._latency.found
        sound = Sound(begin.water_c, begin.scanner_m_s, begin.correct_sound)
        return Scanned.begun(self._reference, begin.wanted, sound, latency, estimate)

    def _solve(self) -> None:
        if self._scanned is not None:
            self._solved_s = self._now_s()
            self._fields = state_fields(self._scanned)

    def _change(self, change: Callable[[Scanned], None]) -> None:
        self._require(Phase.SCANNING, Phase.REVIEW)
        if self._scanned is None:
            raise ControlRefused("no view of the crossing yet", "scan", "Pass slowly through the crossing")
        try:
            change(self._scanned)
        except (IndexError, ValueError) as error:
            raise ControlRefused(str(error), "view", "Choose another") from None
        self._solve()

    def _look(self) -> None:
        """Renews the hold on the service; after signing, follows its report on the new calibration."""
        seen = self._watch.seen()
        with self._lock:
            if self._phase in HELD:
                if why := self.attendance.deserted():
                    with contextlib.suppress(ProbewatchError):
                        self._abort(why)
                    return
                try:
                    if self._phase is Phase.REVIEW:  # an unattended review must not take the service
                        self._service.keep()
                    else:
                        self._service.hold(seen)
                    self._trouble = ""
                except ProbewatchError as error:
                    self._trouble = error.what
            elif self._phase is Phase.PROVING:
                self._prove(seen)
                if self._phase is Phase.PROVING and not self.attendance.deserted():
                    self._service.speak()
                else:
                    self._service.let_go()

    def _prove(self, seen: Seen) -> None:
        status = seen.status
        if self._service.is_older(seen):
            return
        if status is None:
            self._trouble = f"the service does not answer ({seen.silence})"
            return
        self._trouble = ""
        ours = (status["reference"] or {}).get("sha256") == self._sha256
        self._message = waits_for(status)
        if status["state"] == State.MONITORING.value and ours:
            self._phase, self._message = Phase.DONE, "the service has verified the new calibration and monitors again"
        elif not ours:
            self._phase = Phase.ENDED
            self._message = f"not verified, the calibration before is in force: {status['state']}: {status['reason']}"

    def _abort(self, why: str) -> None:
        """Ends the recalibration. Raises ProbewatchError, and changes nothing, where the service does not answer."""
        self._service.abort()
        self._phase, self._message, self._trouble = Phase.ENDED, why, ""

    def _require(self, *phases: Phase) -> None:
        if self._phase not in phases:
            raise ControlRefused(f"not possible while {self._phase.value}", "recalibration", "Reload the page")
