"""Decides which failed checks of consecutive solutions are named, and which motion stays valid after a change. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from probewatch.appliance.core.parameters import BREATHED
from probewatch.appliance.core.quality.examination import Finding, latency_of, without
from probewatch.appliance.core.quality.sequential_test import Accusation
from probewatch.appliance.core.times import CHANGE_WINDOW_NS
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import PARAMETERS, Check, VerdictKind

_AS_IT_WAS = 0.5
"""Share of its limit by which a wrong parameter may move without counting as another change: two to three sigmas of a
short window in the study's gesture. A smaller value starts again because of noise; a larger one takes a fault that is
still growing for a steady one."""
_SLOW = frozenset({"rotation-lateral", "rotation-axial", "offset-lateral", "offset-axial", "offset-elevational"})
"""Names of the checks that only tilt and turn show; a few seconds hold too little of either to decide them."""
_OF_X = frozenset(PARAMETERS)


@dataclass(frozen=True, slots=True)
class Memory:
    """Holds the state that is carried from one solution to the next.

    suspects: names of the checks that failed in the last solution. culprits: the value at which each parameter was
    confirmed to be wrong. valid_ns: older motion is not examined. settled_ns: until then, the short window holds motion
    from before the last change. lagged_ns: when the newest lag began. failing_ns, breathed_ns: since when any check,
    and any scale that rests on breathing alone, has failed; None where none does.
    """

    suspects: frozenset[str] = frozenset()
    culprits: Mapping[str, float] = field(default_factory=dict)
    valid_ns: int = 0
    settled_ns: int = 0
    lagged_ns: int = 0
    failing_ns: int | None = None
    breathed_ns: int | None = None

    def valid_from(self, t_ns: int) -> "Memory":
        """Returns the memory without motion before `t_ns`."""
        return self if t_ns <= self.valid_ns else replace(self, valid_ns=t_ns)

    def lagged_from(self, t_ns: int) -> "Memory":
        """Returns the memory with a new lag: windows that hold motion from before it show neither lag for seconds."""
        return replace(self.valid_from(t_ns), lagged_ns=t_ns)


@dataclass(frozen=True, slots=True)
class Solved:
    """Holds the result of one solution at `now_ns`, the time of the newest picture.

    short: finding of the short window, as `decidable` leaves it. finding: that of the window that decided, which is
    `span_ns` long. lag_explained: whether the separate search for an explanation found a lag.
    """

    short: Finding
    finding: Finding
    span_ns: int
    now_ns: int
    lag_explained: bool


def decidable(finding: Finding) -> Finding:
    """Returns the finding, with every check undecided that a few seconds of motion cannot show."""
    return without(finding, _SLOW)


def quick_checks(finding: Finding) -> tuple[Check, ...]:
    """Returns the checks that a few seconds of motion can decide."""
    return tuple(check for check in finding.checks if check.name not in _SLOW)


def since_change(memory: Memory, short: Finding, now_ns: int) -> Memory:
    """Returns the memory without motion before a change that the short window confirms; unchanged where it confirms
    none, or while it still holds motion from before the last one.
    """
    changed = _changed(memory, short)
    if changed is None or now_ns < memory.settled_ns:
        return memory
    return replace(memory, valid_ns=now_ns - CHANGE_WINDOW_NS, settled_ns=now_ns + CHANGE_WINDOW_NS, culprits=changed)


def decide(memory: Memory, solved: Solved, limits: Limits) -> tuple[Memory, frozenset[str]]:
    """Returns the memory for the next solution, and the names of the failed checks that are in doubt: these withdraw
    an OK, but are not named yet.

    A fault is named when two consecutive solutions show it, a latency also where its explanation was found. While the
    short window holds motion from before a change, only the changed parameters may be named, or a latency, which can
    look like any other fault.
    """
    failed, short = solved.finding.failed, solved.short
    doubtful = failed - memory.suspects - (frozenset({"latency"}) if solved.lag_explained else frozenset())
    if solved.now_ns < memory.settled_ns:
        doubtful |= failed - memory.culprits.keys() - {"latency"}
    early = failed & (_SLOW if _punctual(short, limits) else _OF_X)
    failing_ns, premature = _held(early, memory.failing_ns, solved.now_ns, CHANGE_WINDOW_NS)
    # Consecutive solutions use the same breaths, and so share one error, until half of the window is new.
    same_breaths = by_breathing_alone(solved.finding)
    breathed_ns, unrepeated = _held(same_breaths, memory.breathed_ns, solved.now_ns, solved.span_ns / 2)
    memory = replace(memory, suspects=failed | short.failed, failing_ns=failing_ns, breathed_ns=breathed_ns)
    return memory, doubtful | premature | unrepeated


def by_breathing_alone(finding: Finding) -> frozenset[str]:
    """Returns the failed scales that rest on breathing alone."""
    followed = finding.solution is not None and bool(finding.solution.noise.habits)
    return BREATHED & finding.failed if followed else frozenset()


def with_accusation(finding: Finding, accusation: Accusation, reported: bool) -> Finding:
    """Returns the finding with the checks that the accusation names in place of the old ones. `reported` is False where
    a higher threshold withholds the names: then these checks are not verified, and a measured FAULT stays a FAULT.
    """
    named = {check.name: check for check in accusation.checks if check.verdict is VerdictKind.FAULT}
    if not reported:
        named = {
            name: replace(check, verdict=VerdictKind.NOT_VERIFIED)
            for name, check in named.items()
            if name not in finding.failed
        }
    return Finding(tuple(named.get(check.name, check) for check in finding.checks), finding.solution)


def _held(
    failed: frozenset[str], since_ns: int | None, now_ns: int, for_ns: float
) -> tuple[int | None, frozenset[str]]:
    """Returns the time since which checks have failed, and `failed` until `for_ns` have passed since then; no names
    after that.
    """
    if not failed:
        return None, failed
    since_ns = now_ns if since_ns is None else since_ns
    return since_ns, failed if now_ns - since_ns < for_ns else frozenset()


def _changed(memory: Memory, short: Finding) -> dict[str, float] | None:
    """Returns the values of the parameters that two consecutive short windows show to be newly wrong; empty where a
    fault seen before has been corrected. In both cases motion before that is dropped. Returns None where nothing is
    new: if motion were dropped repeatedly, no window would become long enough for the second of two simultaneous
    faults.
    """
    confirmed = [check for check in short.checks if check.name in short.failed & memory.suspects]
    if any(_moved(check, memory.culprits.get(check.name)) for check in confirmed):
        return {check.name: check.value for check in confirmed}
    return {} if any(short.shows((name,)) for name in memory.culprits) else None


def _moved(check: Check, before: float | None) -> bool:
    """Returns whether the parameter was not wrong before, or its wrong value has changed since by more than
    `_AS_IT_WAS` of its limit.
    """
    return before is None or abs(check.value - before) > _AS_IT_WAS * check.limit


def _punctual(finding: Finding, limits: Limits) -> bool:
    """Returns whether the latency is shown to be within half of its limit. A window that contains the onset of a larger
    latency underestimates it, and its scales are wrong too, so the short window must be used then.
    """
    lateness = latency_of(finding)
    return abs(lateness.value) + limits.confidence_sigma * lateness.sigma <= lateness.limit / 2
