"""Judges what the service made of the demo's faults: found, named, halted, recovered, or not. It is pure.

Times are seconds of the simulated cart. What alarms from the start of one fault to the start of the next belongs to it,
so that a recovery which comes too late is reported as such and not taken for the next fault.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from probewatch.appliance.types import State
from probewatch.tools.demo.script import LONGEST_RECOVERY_S, Injection, Script

_EVIDENCE_S = 10.0
"""Seconds of motion before a moment on which what is reported of it rests."""
_BUSY_S = 2.0
"""Seconds for which the machine must have been too busy in that time to explain anything. A choice, not measured:
longer, and a short overload is reported as a failure; shorter, and another program's start excuses a failure."""

ALARMS = (State.WARNING, State.HALT, State.RECALIBRATION_REQUESTED, State.DEVICE_LOST)


@dataclass(frozen=True, slots=True)
class Moment:
    """Represents that the service entered a state, or named another fault in it. fault: class, None where none."""

    t_s: float
    state: State
    fault: str | None
    reason: str


@dataclass(frozen=True, slots=True)
class Switch:
    """Represents that the relay board moved its contact; energised means closed, safe."""

    t_s: float
    energised: bool


@dataclass(frozen=True, slots=True)
class Prompt:
    """Holds what the status showed of a calibration that is not verified. asked: number of parameters that must be
    shown. missing: those that no motion has shown. gesture: motions that show them.
    """

    t_s: float
    asked: int
    missing: tuple[str, ...]
    gesture: tuple[str, ...]

    @property
    def text(self) -> str:
        """Returns the text for the operator."""
        if not self.missing:
            return f"shown: all {self.asked}"
        shown = f"shown: {self.asked - len(self.missing)} of {self.asked}"
        return f"{shown}; missing: {', '.join(self.missing)}; to show it: {'; '.join(self.gesture)}"


@dataclass(frozen=True, slots=True)
class History:
    """Holds everything seen during a run, in time order. end_s: when it ended. busy_s: spans in which the machine was
    too busy for a cart in real time. prompts: each that differed from the one before. point_mm: least bound (99.7 %) of
    the error of a point while the calibration was verified, None where none was reported.
    """

    moments: tuple[Moment, ...]
    switches: tuple[Switch, ...]
    acknowledged_s: tuple[float, ...]
    end_s: float
    busy_s: tuple[tuple[float, float], ...] = ()
    prompts: tuple[Prompt, ...] = ()
    point_mm: float | None = None

    def busy(self, from_s: float, until_s: float) -> bool:
        """Returns whether the machine was too busy then for anything to be concluded from it."""
        spans = ((max(one, from_s - _EVIDENCE_S), min(other, until_s)) for one, other in self.busy_s)
        return sum(max(0.0, other - one) for one, other in spans) >= _BUSY_S

    def at(self, t_s: float) -> Moment | None:
        """Returns the moment in force at t_s, None before the first."""
        return next((one for one in reversed(self.moments) if one.t_s <= t_s), None)

    def closed(self, t_s: float) -> bool:
        """Returns whether the contact was closed at t_s."""
        return next((one.energised for one in reversed(self.switches) if one.t_s <= t_s), False)

    def between(self, from_s: float, until_s: float) -> tuple[Moment, ...]:
        return tuple(one for one in self.moments if from_s <= one.t_s < until_s)


@dataclass(frozen=True, slots=True)
class Finding:
    """Holds what became of one injection. named: class that the first alarm named.

    reached: alarm state → s from the injection to its first entry; contact_open_after_s, acknowledged_after_s likewise.
    verified_after_s: s from the end of the fault. None, or no key, where it did not happen. problem: empty where none.
    """

    injection: Injection
    named: str | None
    reached: Mapping[State, float]
    contact_open_after_s: float | None
    acknowledged_after_s: float | None
    verified_after_s: float | None
    problem: str = ""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Holds the judgement. verified_s: when the calibration was first verified. unexpected: alarms without their fault.

    sentence: why the run failed, empty where it passed. too_busy: whether the machine was too busy then, so that the
    run shows nothing. point_mm: as in History.
    """

    findings: tuple[Finding, ...]
    unexpected: tuple[Moment, ...]
    verified_s: float | None
    sentence: str
    too_busy: bool = False
    point_mm: float | None = None

    @property
    def passed(self) -> bool:
        return not self.sentence


def judge(script: Script, history: History) -> Outcome:
    """Compares what was injected with what was found."""
    findings = tuple(_find(one, script.until_s(one), history) for one in script.injections)
    unexpected = _unexpected(script, findings, history)
    verified_s = next((one.t_s for one in history.moments if one.state is State.MONITORING), None)
    cause = _cause(script, findings, unexpected, verified_s)
    sentence, busy = ("", False) if cause is None else (cause.sentence, history.busy(cause.from_s, cause.until_s))
    return Outcome(findings, unexpected, verified_s, sentence, busy, history.point_mm)


def _find(injection: Injection, until_s: float, history: History) -> Finding:
    from_s, to_s = injection.from_s, injection.to_s
    moments = history.between(from_s, until_s)
    alarms = [one for one in moments if one.state in ALARMS]
    opened = (one.t_s - from_s for one in history.switches if from_s <= one.t_s < until_s and not one.energised)
    acknowledged = (t_s - from_s for t_s in history.acknowledged_s if from_s <= t_s < until_s)
    verified = (one.t_s - to_s for one in moments if one.t_s >= to_s and one.state is State.MONITORING)
    finding = Finding(
        injection,
        named=next((one.fault for one in alarms if one.fault), None),
        reached={one.state: one.t_s - from_s for one in reversed(alarms)},
        contact_open_after_s=next(opened, None),
        acknowledged_after_s=next(acknowledged, None),
        verified_after_s=next(verified, None) if alarms else None,
    )
    return replace(finding, problem=_problem(finding, history))


def _problem(finding: Finding, history: History) -> str:
    """Returns the first thing that went wrong, as the end of a sentence that begins with the fault."""
    injection = finding.injection
    before = history.at(injection.from_s)
    if before is None or before.state is not State.MONITORING or not history.closed(injection.from_s):
        state = "self-test" if before is None else before.state.value
        return f"began while the service was still '{state}', so it has no result"
    if finding.named != injection.fault_class:
        return f"was named {finding.named} instead of {injection.fault_class}" if finding.named else "was not found"
    if finding.contact_open_after_s is None:
        return "did not open the contact"
    wrong = _wrong_states(finding)
    return wrong or ("" if finding.verified_after_s is not None else "was removed, but is not verified again in time")


def _wrong_states(finding: Finding) -> str:
    states = finding.injection.states
    missing = [state.value for state in states if state not in finding.reached]
    if missing:
        return f"did not lead to '{missing[0]}'"
    beyond = [state.value for state in finding.reached if state not in states]
    if beyond:
        return f"led to '{beyond[0]}' as well"
    times_s = [finding.reached[state] for state in states]
    return "" if times_s == sorted(times_s) else "led to the right states in the wrong order"


def _unexpected(script: Script, findings: tuple[Finding, ...], history: History) -> tuple[Moment, ...]:
    """Returns alarms outside every fault's time, or under another name than its class."""
    return tuple(
        one for one in history.moments if one.state in ALARMS and not any(_explains(f, one, script) for f in findings)
    )


def _explains(finding: Finding, moment: Moment, script: Script) -> bool:
    injection = finding.injection
    verified_after_s = finding.verified_after_s
    until_s = script.until_s(injection) if verified_after_s is None else injection.to_s + verified_after_s
    return injection.from_s <= moment.t_s < until_s and moment.fault in (injection.fault_class, None)


@dataclass(frozen=True, slots=True, order=True)
class _Cause:
    """Represents what went wrong from from_s until until_s, as a sentence."""

    from_s: float
    sentence: str
    until_s: float


def _cause(
    script: Script, findings: tuple[Finding, ...], unexpected: tuple[Moment, ...], verified_s: float | None
) -> _Cause | None:
    """Returns the earliest cause; None when the run passed."""
    if verified_s is None:
        return _Cause(0.0, "The calibration was never verified.", script.end_s)
    causes = [_fault_cause(one.injection, one.problem, script) for one in findings if one.problem]
    causes += [
        _Cause(one.t_s, f"At {one.t_s:.1f} s '{one.state.value}' ({one.fault}) came up without that fault.", one.t_s)
        for one in unexpected
    ]
    if script.left_out and not causes:
        what = f"At {script.end_s:.1f} s the calibration was not verified; {script.left_out[0]} did not have its turn."
        return _Cause(script.end_s - LONGEST_RECOVERY_S, what, script.end_s)
    return min(causes, default=None)


def _fault_cause(injection: Injection, problem: str, script: Script) -> _Cause:
    from_s = injection.from_s
    return _Cause(from_s, f"At {from_s:.1f} s {injection.fault} {problem}.", script.until_s(injection))
