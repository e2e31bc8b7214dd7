"""What the supervisor remembers between ticks, and the guards of its table. Pure: time is an argument."""

from dataclasses import dataclass

from appliance.supervision.alarms import HAZARDS, UNVERIFIED, Kind, kind_of
from appliance.types import Check, Verdict, VerdictKind


@dataclass(frozen=True, slots=True)
class Durations:
    """Times of the table, ns of the host clock."""

    halt_after_ns: int = 1_000_000_000
    recalibrate_after_ns: int = 2_000_000_000
    device_lost_after_ns: int = 1_000_000_000
    probation_ns: int = 1_000_000_000
    max_verification_age_ns: int = 30_000_000_000
    starting_ns: int = 10_000_000_000


@dataclass(slots=True)
class Condition:
    """One kind of hazard over time. It is shown, or stands (neither shown nor disproved), or is gone.

    onset_ns: when it was first shown since it was last gone, None while gone. lifted_ns: when it went.
    """

    fault: str | None = None
    reason: str = ""
    shown: bool = False
    onset_ns: int | None = None
    lifted_ns: int | None = None

    @property
    def active(self) -> bool:
        return self.onset_ns is not None

    def show(self, now_ns: int, fault: str, reason: str) -> None:
        self.fault, self.reason, self.shown = fault, reason, True
        self.onset_ns = now_ns if self.onset_ns is None else self.onset_ns

    def stand(self) -> None:
        self.shown = False

    def lift(self, now_ns: int) -> None:
        if self.active:
            self.lifted_ns = now_ns
        self.shown, self.onset_ns = False, None

    def lasts(self, now_ns: int, duration_ns: int) -> bool:
        """Shown now, and not gone since duration_ns ago or longer."""
        return self.shown and self.onset_ns is not None and now_ns - self.onset_ns >= duration_ns

    def gone(self, now_ns: int, duration_ns: int) -> bool:
        """Gone for duration_ns or longer."""
        return not self.active and (self.lifted_ns is None or now_ns - self.lifted_ns >= duration_ns)


class Ledger:
    """Hazards and verification as of the last tick; its boolean properties are the guards named in the table."""

    def __init__(self, durations: Durations) -> None:
        self.durations = durations
        self.now_ns = 0
        self.started_ns: int | None = None
        self.verified_ns: int | None = None
        self.last: Verdict | None = None
        self.unverified = ""
        self.scanning = self.confirming = False
        self.calibration, self.device = Condition(), Condition()
        self._barrier_ns: int | None = None

    def note(self, now_ns: int, verdicts: tuple[Verdict, ...], devices: tuple[Check, ...]) -> None:
        """Fold in what came since the last tick. verdicts are in the order in which the line spoke."""
        self.now_ns = now_ns
        self.started_ns = now_ns if self.started_ns is None else self.started_ns
        frozen = self._frozen(verdicts[-1] if verdicts else self.last)
        self._note_devices(devices, frozen)
        if not self.scanning:
            for verdict in verdicts:
                self._note_verdict(verdict)
        if not verdicts and self.device.active:
            self.calibration.stand()

    def _frozen(self, verdict: Verdict | None) -> Verdict | None:
        """The line's own device hazard: a frozen picture is the scanner's doing, not the calibration's."""
        if verdict is None or verdict.fault is None or self.scanning or kind_of(verdict.fault) is Kind.CALIBRATION:
            return None
        return verdict

    def _note_devices(self, devices: tuple[Check, ...], frozen: Verdict | None) -> None:
        failing = next((check for check in devices if check.verdict is VerdictKind.FAULT), None)
        if failing is not None:
            self.device.show(self.now_ns, failing.fault, HAZARDS[failing.fault].text)
        elif frozen is not None and frozen.fault is not None:
            self.device.show(self.now_ns, frozen.fault, frozen.reason or HAZARDS[frozen.fault].text)
        else:
            self.device.lift(self.now_ns)
        unseen = next((check for check in devices if check.verdict is VerdictKind.NOT_VERIFIED), None)
        self.unverified = "" if unseen is None else UNVERIFIED[unseen.fault]
        if self.device.active or self.unverified:
            self._forget_verification()

    def _forget_verification(self) -> None:
        self.verified_ns, self._barrier_ns = None, self.now_ns

    def _note_verdict(self, verdict: Verdict) -> None:
        self.last = verdict
        if verdict.kind is VerdictKind.OK:
            self._note_ok(verdict)
        elif verdict.fault is not None and kind_of(verdict.fault) is Kind.CALIBRATION:
            self.verified_ns = None
            self.calibration.show(self.now_ns, verdict.fault, verdict.reason or HAZARDS[verdict.fault].text)
        else:
            self.calibration.stand()

    def _note_ok(self, verdict: Verdict) -> None:
        """Only what was measured after the last disturbance verifies anything."""
        if self._barrier_ns is not None and verdict.t_ns <= self._barrier_ns:
            return
        self.calibration.lift(self.now_ns)
        self.verified_ns = min(verdict.t_ns, self.now_ns)

    def begin_recalibration(self) -> None:
        """What the probe shows during the scan says nothing of the calibration in force."""
        self.scanning, self.confirming = True, False
        self._start_afresh()

    def end_recalibration(self) -> None:
        """A new reference is in force: whatever was measured before says nothing of it."""
        self.scanning, self.confirming = False, True
        self._start_afresh()

    def leave_recalibration(self) -> None:
        self.scanning = self.confirming = False

    def abort_recalibration(self) -> None:
        self.leave_recalibration()
        self._start_afresh()

    def _start_afresh(self) -> None:
        self.last = None
        self.calibration = Condition()
        self._forget_verification()

    @property
    def hazard(self) -> bool:
        return self.calibration.active or self.device.active

    @property
    def calibration_fault(self) -> bool:
        return self.calibration.active

    @property
    def device_fault(self) -> bool:
        return self.device.active

    @property
    def verified(self) -> bool:
        if self.verified_ns is None or self.unverified:
            return False
        return self.now_ns - self.verified_ns <= self.durations.max_verification_age_ns

    @property
    def halting(self) -> bool:
        return self.calibration.lasts(self.now_ns, self.durations.halt_after_ns)

    @property
    def recalibration_due(self) -> bool:
        total_ns = self.durations.halt_after_ns + self.durations.recalibrate_after_ns
        return self.calibration.lasts(self.now_ns, total_ns)

    @property
    def losing_device(self) -> bool:
        return self.device.lasts(self.now_ns, self.durations.device_lost_after_ns)

    @property
    def device_back(self) -> bool:
        return self.device.gone(self.now_ns, self.durations.probation_ns)

    @property
    def cleared(self) -> bool:
        return self.device_back and self.calibration.gone(self.now_ns, self.durations.probation_ns)

    @property
    def start_overdue(self) -> bool:
        return self.started_ns is not None and self.now_ns - self.started_ns >= self.durations.starting_ns
