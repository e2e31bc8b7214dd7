"""Holds what the supervisor remembers between ticks, and the guards of its table. Pure: time is an argument."""

from probewatch.appliance.supervision.alarms import HAZARDS, SILENCES
from probewatch.appliance.supervision.condition import Condition
from probewatch.appliance.supervision.faults import FAULT_ROWS
from probewatch.appliance.supervision.policy import CAUGHT_UP_NS, PLAIN, Durations, Policy, Step
from probewatch.appliance.types import Check, Fault, Kind, State, Verdict, VerdictKind


class Ledger:
    """Holds the hazards and the verification as of the last tick. Its boolean properties are the guards named in the
    table; their docstrings are what docs/alarms.md states of each.

    calibration: the fault of the calibration. unrecovered: the fault for which the policy requests a recalibration,
    timed separately, so that a fault that motion recovers does not hasten the request, however long it is shown.
    behind: the last verdict is too old to say anything about the present: the times of picture or pose do not advance
    or advance too slowly, or no picture is judged any more.
    """

    def __init__(self, durations: Durations) -> None:
        self.durations = durations
        self.now_ns = 0
        self.started_ns: int | None = None
        self.verified_ns: int | None = None
        self._expires_ns: int | None = None
        self.last: Verdict | None = None
        self.behind = False
        self.sight: Fault | None = None
        self.notices: tuple[Fault, ...] = ()
        self.scanning = False
        self.acknowledged = False
        self.latched: State | None = None
        self.latched_fault: Fault | None = None
        self.calibration, self.unrecovered, self.device = Condition(), Condition(), Condition()
        self.internal, self.integrity = Condition(), Condition()
        self._unseen = Condition()
        self._accepted: frozenset[Fault] = frozenset()
        self._reported: frozenset[Fault | None] = frozenset()
        self._acknowledged: frozenset[Fault | None] = frozenset()
        self._untested = False
        self.barrier_ns = -1

    def note(self, now_ns: int, verdicts: tuple[Verdict, ...], devices: tuple[Check, ...]) -> None:
        """Takes what came since the last tick. verdicts: in the order in which the line gave them."""
        self.now_ns = now_ns
        self.started_ns = now_ns if self.started_ns is None else self.started_ns
        failing = [check.fault for check in devices if check.verdict is VerdictKind.FAULT]
        newest = verdicts[-1] if verdicts else self.last
        self._note_hazards(failing + self._of_the_line(newest))
        self._note_sight(devices if newest is None else (*devices, *newest.checks))
        if not self.scanning:
            for verdict in verdicts:
                self._note_verdict(verdict)
        self._note_lag()
        if not verdicts and (self.device.active or self.internal.active):
            self._stand()

    def _of_the_line(self, verdict: Verdict | None) -> list[Fault]:
        """Returns the device hazard that the line reports, such as a frozen picture or a distorted field: the
        calibration is not its cause.
        """
        if verdict is None or verdict.fault is None or self.scanning or verdict.fault.kind is Kind.CALIBRATION:
            return []
        return [verdict.fault]

    def _note_hazards(self, failing: list[Fault]) -> None:
        self.notices = tuple(fault for fault in failing if fault.kind is Kind.ADVISORY)
        self._note_integrity(failing)
        self._note_kind(self.internal, failing, Kind.INTERNAL)
        self._note_kind(self.device, failing, Kind.DEVICE)
        self._untested = any(FAULT_ROWS[fault].policy.tested for fault in failing)

    def _note_sight(self, checks: tuple[Check, ...]) -> None:
        """Records what is out of sight and forgets the verification then: what is not seen can be changed meanwhile."""
        unknown = [check.fault for check in checks if check.verdict is not VerdictKind.OK]
        self.sight = next((fault for fault in unknown if fault.kind is Kind.SIGHT), None)
        if self.sight is None:
            self._unseen.lift(self.now_ns)
        else:
            self._unseen.show(self.now_ns, self.sight, HAZARDS[self.sight].text)
        if self.device.active or self.internal.active or self.sight is not None:
            self.forget_verification()

    def _note_integrity(self, failing: list[Fault]) -> None:
        """Keeps damage that was seen active until it is accepted, whether or not it is still reported."""
        self._accepted &= frozenset(failing)
        if not self.integrity.active:
            self._note_kind(self.integrity, [fault for fault in failing if fault not in self._accepted], Kind.INTEGRITY)

    def _note_kind(self, condition: Condition, failing: list[Fault], kind: Kind) -> None:
        fault = next((fault for fault in failing if fault.kind is kind), None)
        if fault is None:
            condition.lift(self.now_ns)
        else:
            condition.show(self.now_ns, fault, self._explained(fault))

    def _explained(self, fault: Fault) -> str:
        """Returns the text of a hazard, with the overload added where a computer short of time may explain it."""
        text = HAZARDS[fault].text
        return (
            f"{text}; {HAZARDS[Fault.OVERLOADED].text}"
            if fault in SILENCES and Fault.OVERLOADED in self.notices
            else text
        )

    def forget_verification(self) -> None:
        """Forgets the verification: only what is measured from now on can verify anything."""
        self.verified_ns, self.barrier_ns = None, self.now_ns

    def _note_verdict(self, verdict: Verdict) -> None:
        self.last = verdict
        self._note_lag()
        self._note_verification(verdict)
        if verdict.kind is VerdictKind.OK:
            self._note_ok(verdict)
        elif verdict.fault is not None and verdict.fault.kind is Kind.CALIBRATION:
            self.barrier_ns = max(min(verdict.t_ns, self.now_ns), self.barrier_ns)
            if not self.calibration.active:
                self._acknowledge_none()
            self._show(verdict.fault, verdict.reason or HAZARDS[verdict.fault].text, verdict.checks)
        else:
            self._stand()

    def _show(self, fault: Fault | None, reason: str, checks: tuple[Check, ...] = ()) -> None:
        """Records what is shown. checks: those of the verdict that shows it; each of several simultaneous faults
        counts. fault: None where it is unknown.
        """
        self.calibration.show(self.now_ns, fault, reason)
        failing = [(check.fault, check.name) for check in checks if check.verdict is VerdictKind.FAULT]
        failing += [] if fault is None else [(fault, "")]
        self._reported = frozenset(one for one, _ in failing)
        unrecovered = next((one for one, check in failing if _requests(one, check)), None)
        if unrecovered is None:
            self.unrecovered.mark_unconfirmed()
        else:
            self.unrecovered.show(self.now_ns, unrecovered, reason)

    def _stand(self) -> None:
        self.calibration.mark_unconfirmed()
        self.unrecovered.mark_unconfirmed()

    def _note_verification(self, verdict: Verdict) -> None:
        """Records when the verification was shown: its age counts from the motion, not from the verdict. What was
        measured before the last disturbance, or claims to be of the future, verifies nothing.
        """
        shown_ns = verdict.verified_ns
        stands = shown_ns is not None and self.barrier_ns < shown_ns <= self.now_ns
        self.verified_ns = shown_ns if stands else None
        self._expires_ns = verdict.expires_ns

    def _note_lag(self) -> None:
        most_ns = self.durations.behind_ns - (CAUGHT_UP_NS if self.behind else 0)
        self.behind = self.last is not None and self.now_ns - self.last.t_ns > most_ns

    def _note_ok(self, verdict: Verdict) -> None:
        if self.verified_ns is not None and not self.behind:
            self.calibration.lift(self.now_ns)
            self.unrecovered.lift(self.now_ns)

    def acknowledge(self) -> None:
        """Records that a person has seen the latched state, and what is reported of it. A fault that comes again, or
        that replaces all that was reported, is not acknowledged.
        """
        self.acknowledged = True
        self._acknowledged |= self._reported | {self.latched_fault}

    def _acknowledge_none(self) -> None:
        self.acknowledged, self._acknowledged = False, frozenset()

    def accept_damage(self) -> None:
        """Records that a person has seen the damage. The same found again, and any other damage, is another alarm."""
        assert self.integrity.fault is not None
        self._accepted |= {self.integrity.fault}
        self.integrity.lift(self.now_ns)

    def latch(self, state: State, fault: Fault | None) -> None:
        """Holds this state until it is released; a person must acknowledge it."""
        self.latched, self.latched_fault = state, fault
        self._acknowledge_none()

    def replaced(self) -> Condition | None:
        """Returns what the line has shown in place of the latched fault for as long as a HALT takes, or anew after an
        OK; None while it has not. A fault that requests a recalibration is not disproved by another fault.
        """
        requested = self.latched is State.RECALIBRATION_REQUESTED and self.unrecovered.active
        shown = self.unrecovered if requested else self.calibration
        if shown.fault in (None, self.latched_fault) or not shown.names(self.now_ns, self.durations.halt_after_ns):
            return None
        return None if shown.fault is Fault.UNDECIDED else shown

    def rename(self, fault: Fault | None) -> None:
        """Reports the latched state as this fault from now on; a fault that was not acknowledged is another alarm."""
        self.latched_fault = fault
        self.acknowledged = self.acknowledged and fault in self._acknowledged

    def release(self) -> None:
        self.latched, self.latched_fault = None, None
        self._acknowledge_none()

    def restore(self, reason: str) -> None:
        """Makes the latched fault active again, unconfirmed, until the line disproves it."""
        self._show(self.latched_fault, reason)
        self._stand()

    def begin_recalibration(self) -> None:
        """Begins the scan: what the probe shows during it says nothing about the calibration in force."""
        self.scanning = True
        self._start_afresh()

    def end_recalibration(self) -> None:
        """Ends the scan with a new reference in force: whatever was measured before says nothing about it."""
        self.scanning = False
        self._start_afresh()

    def leave_recalibration(self) -> None:
        """Leaves the recalibration: the reference before it is in force, unless the new one has been confirmed."""
        self.scanning = False
        if not self.verified:
            self._start_afresh()

    def _start_afresh(self) -> None:
        self.last = None
        self.calibration, self.unrecovered = Condition(), Condition()
        self.forget_verification()

    @property
    def hazard(self) -> bool:
        """A hazard other than an advisory is active."""
        conditions = (self.calibration, self.device, self.internal, self.integrity)
        return any(condition.active for condition in conditions)

    @property
    def calibration_fault(self) -> bool:
        """The line has shown a calibration fault and not disproved it since."""
        return self.calibration.active

    @property
    def device_fault(self) -> bool:
        """A device is silent, stale, reports a fault or measures badly, or the picture is frozen."""
        return self.device.active

    @property
    def internal_fault(self) -> bool:
        """A part of probewatch itself is silent, or what it wrote is damaged."""
        return self.internal.active or self.integrity.active

    @property
    def integrity_broken(self) -> bool:
        """The alarm memory or the alarm log is damaged, and no person has acknowledged it."""
        return self.integrity.active

    @property
    def self_tested(self) -> bool:
        """The outputs were written, the estimator reports, and the alarm memory and the alarm log are undamaged."""
        return not self._untested

    @property
    def verified(self) -> bool:
        """Motion not older than max_verification_age has shown all that is required, nothing has contradicted it, the
        line's last verdict is of the last second, and probe and tissue are in sight. A parameter with an age limit of
        its own in the configuration is not older than that, not counting the time, `limits.at_rest_s` at most, for
        which the probe has been held still since.
        """
        if self.verified_ns is None or self.sight is not None or self.behind:
            return False
        if self._expires_ns is not None and self.now_ns > self._expires_ns:
            return False
        return self.now_ns - self.verified_ns <= self.durations.max_verification_age_ns

    @property
    def reported_sight(self) -> Fault | None:
        """Returns what is out of sight, or was within probation, so that flicker is one episode. Decides nothing."""
        gone = self._unseen.gone(self.now_ns, self.durations.probation_ns)
        return None if gone else self._unseen.fault

    def _led(self, condition: Condition, step: Step | None) -> bool:
        """Returns whether what is shown now has been shown for as long as the policy requires before this step."""
        return step is not None and condition.lasts(self.now_ns, step.after_ns(self.durations))

    @property
    def halting(self) -> bool:
        """A calibration fault is shown now, and has been for as long as the policy requires before HALT."""
        return self._led(self.calibration, _row(self.calibration).step_to(State.HALT))

    @property
    def recalibration_due(self) -> bool:
        """A fault that motion does not recover is shown now, and has been for as long as the policy requires before the
        request.
        """
        return self._led(self.unrecovered, _row(self.unrecovered).step_to(State.RECALIBRATION_REQUESTED))

    @property
    def losing_device(self) -> bool:
        """A device fault has lasted for as long as the policy requires before device lost."""
        return self._led(self.device, _row(self.device).step_to(State.DEVICE_LOST))

    @property
    def losing_internal(self) -> bool:
        """A part of probewatch itself has been silent for as long as the policy lets a recalibration continue."""
        return self._led(self.internal, _row(self.internal).scan)

    @property
    def device_back(self) -> bool:
        """No device fault has been active for probation."""
        return self.device.gone(self.now_ns, self.durations.probation_ns)

    @property
    def internal_back(self) -> bool:
        """No internal fault has been active for probation, and all damage has been acknowledged."""
        return self.internal.gone(self.now_ns, self.durations.probation_ns) and not self.integrity.active

    @property
    def cleared(self) -> bool:
        """No hazard has been active for probation."""
        gone = self.calibration.gone(self.now_ns, self.durations.probation_ns)
        return self.device_back and self.internal_back and gone

    @property
    def disproved(self) -> bool:
        """The latched cause is acknowledged and has been gone for probation, and the calibration has been verified
        since.
        """
        gone = self.calibration.gone(self.now_ns, self.durations.probation_ns)
        return self.acknowledged and gone and self.verified

    @property
    def latched_halt(self) -> bool:
        """HALT was latched before the recalibration began."""
        return self.latched is State.HALT

    @property
    def latched_request(self) -> bool:
        """RECALIBRATION REQUESTED was latched before the recalibration began."""
        return self.latched is State.RECALIBRATION_REQUESTED

    @property
    def self_test_overdue(self) -> bool:
        """The service has run for the duration self_test."""
        return self._running_ns() >= self.durations.self_test_ns

    @property
    def start_overdue(self) -> bool:
        """The service has run for the duration starting."""
        return self._running_ns() >= self.durations.starting_ns

    def _running_ns(self) -> int:
        return 0 if self.started_ns is None else self.now_ns - self.started_ns


def _requests(fault: Fault, check: str) -> bool:
    step = FAULT_ROWS[fault].policy.step_to(State.RECALIBRATION_REQUESTED)
    return step is not None and step.led_by(check)


def _row(condition: Condition) -> Policy:
    """Returns the policy of the condition's hazard, which may be unknown after a restart."""
    return PLAIN if condition.fault is None else FAULT_ROWS[condition.fault].policy
