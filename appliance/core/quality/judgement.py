"""Derives one verdict from checks, and the verdict on a session from many verdicts (Quality Control)."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

from probewatch.appliance.core.path.residual import Lack
from probewatch.appliance.core.quality.check_fields import up_to
from probewatch.appliance.core.quality.gesture import gestures
from probewatch.appliance.core.quality.verification import Contradiction, VerificationStatus
from probewatch.appliance.types import (
    PARAMETERS,
    POINT_WITHHELD,
    Check,
    Fault,
    Kind,
    PointError,
    Rival,
    Verdict,
    VerdictKind,
)

_ESTIMATED = frozenset({"polarity", "latency", *PARAMETERS})
_NEAR = 0.8
"""Share of its limit from which an estimate is named even when it is one sigma less: low enough that a drift is noticed
before it fails, high enough that the noise of a good calibration, a fifth of the limits or so, is not named."""
_LASTING_NS = 1_000_000_000
"""Time, ns, for which a fault must last to name a whole recording. Less lets a passing contradiction name it, more
hides short faults. The alarm of a cart does not wait for it."""
_FIRST = (
    Fault.FROZEN_VIDEO,
    Fault.TRACKER_STALE,
    Fault.POSE_CONVENTION,
    Fault.POLARITY,
    Fault.LATENCY,
    Fault.EXCHANGED_PROBE,
)
"""Faults that spoil or explain everything measured after them, in the order in which they are named."""
_LAST = (Fault.MARKER_BODY_MOVED, Fault.UNDECIDED, Fault.FIELD_DISTORTION)
"""Faults that are reported after all others: that one of two bodies moved, of which motion names the first; what is not
decided; and what mends by itself and must not hide what waits for a person."""

BROKE = "the picture does not continue the one that was verified"
"""The reason after the probe was lifted off or a setting of the scanner was changed; no detector names which it was."""
_NOT_YET = "not shown yet"
_LACKS = {
    "depth_mm": "picture too shallow: {value:.0f} mm, over tissue that may give way {least:.0f} mm needed",
    "tissue_mm2": "too little tissue in the picture: {value:.0f} mm², where it may give way {least:.0f} mm² needed",
}
"""The sentence for each `Lack`, by its name."""


def judge(t_ns: int, checks: tuple[Check, ...], status: VerificationStatus, broke: bool = False) -> Verdict:
    """Returns a FAULT if any check failed; an OK if every required check is shown, none is contradicted, and none of
    kind SIGHT reports that the others do not refer to tissue; a NOT_VERIFIED otherwise.

    status: that of the `Evidence`. broke: whether the picture does not continue the one that was verified.
    """
    failed = [check for check in checks if check.verdict is VerdictKind.FAULT]
    if failed:
        worst = _worst_of_each(failed)
        rivals = status.rivals if Fault.UNDECIDED in worst else ()
        reason = "; ".join(
            _undecided(rivals) if fault is Fault.UNDECIDED else _sentence(worst[fault]) for fault in worst
        )
        return Verdict(t_ns, VerdictKind.FAULT, checks, next(iter(worst)), reason, rivals=rivals)
    unseen = next((one for one in checks if one.fault.kind is Kind.SIGHT and one.verdict is not VerdictKind.OK), None)
    if unseen is not None:
        return Verdict(t_ns, VerdictKind.NOT_VERIFIED, checks, None, f"nothing to compare: {unseen.name}")
    if status.contradictions:
        rivals = status.rivals
        reason = _undecided(rivals) if rivals else _contradiction(status.contradictions[0])
        return Verdict(t_ns, VerdictKind.NOT_VERIFIED, checks, None, reason, rivals=rivals)
    missing = [name for name in status.required if name not in _shown(checks)]
    kind = VerdictKind.NOT_VERIFIED if missing else VerdictKind.OK
    verified = "; ".join(["calibration verified", *_doubts(checks)])
    lacking = [*_lacks(status.lack), *([BROKE] if broke else []), _NOT_YET]
    reason = _unverified(checks, "; ".join(lacking), missing) if missing else verified
    return Verdict(t_ns, kind, checks, None, reason, status.verified_ns, status.expires_ns)


def bounded(verdict: Verdict, point: PointError | None, limit_mm: float | None) -> Verdict:
    """Returns the verdict with the error of a point, which no FAULT reports. limit_mm: the most that an OK may have,
    None for any; beyond it, and where the error is not known, nothing is verified. The error gives no OK and names no
    fault.
    """
    if verdict.kind is VerdictKind.FAULT:
        return verdict
    verdict = replace(verdict, point=point)
    if limit_mm is None:
        return verdict
    if point is not None and point.worst_mm[-1] <= limit_mm:
        shown_ns = None if verdict.verified_ns is None else min(verdict.verified_ns, point.shown_ns)
        return replace(verdict, verified_ns=shown_ns)
    error = "not known" if point is None else f"{up_to(point.worst_mm[-1])} mm"
    reasons = [f"{POINT_WITHHELD} {error}, limit {limit_mm:g} mm"]
    if verdict.kind is not VerdictKind.OK:
        reasons = [verdict.reason, *(reasons if point is not None else [])]
    kind, reason = VerdictKind.NOT_VERIFIED, "; ".join(reasons)
    return replace(verdict, kind=kind, reason=reason, verified_ns=None, expires_ns=None)


class Judgement:
    """Tracks whether a fault lasted and whether the calibration was ever verified.

    required: names of the checks that the contact asks for.
    """

    def __init__(self, required: Sequence[str]) -> None:
        self._required = required
        self._since_ns: dict[Fault, int] = {}
        self._lasted_ns: defaultdict[Fault, int] = defaultdict(int)
        self._failing: dict[Fault, Verdict] = {}
        self._verified_ns: int | None = None
        self._last_ns = 0
        self._rivals: tuple[Rival, ...] = ()
        self._point: PointError | None = None
        self._withheld = "verified only in parts"

    def note(self, verdict: Verdict) -> None:
        """Takes the next verdict of the line, in time order."""
        self._last_ns, self._rivals = verdict.t_ns, verdict.rivals
        self._point = verdict.point or self._point
        if verdict.kind is VerdictKind.OK:
            self._verified_ns = verdict.t_ns
        elif verdict.kind is VerdictKind.NOT_VERIFIED and not self._missing(verdict.checks):
            self._withheld = verdict.reason
        for fault in list(self._since_ns):
            if fault != verdict.fault:
                del self._since_ns[fault]
        if verdict.fault is not None:
            since_ns = self._since_ns.setdefault(verdict.fault, verdict.t_ns)
            self._lasted_ns[verdict.fault] = max(self._lasted_ns[verdict.fault], verdict.t_ns - since_ns)
            self._failing[verdict.fault] = verdict

    def overall(self, checks: tuple[Check, ...], lack: Lack | None = None) -> Verdict:
        """Returns a FAULT if one lasted a second, else an OK if the calibration was verified at any time, else a FAULT
        if the whole recording shows that the tracker is late, else a NOT_VERIFIED. A FAULT has no error of a point; the
        other verdicts have the last one known.

        checks: the best that was known of each quantity; the failing checks of a lasting fault replace them. lack: that
        of the pictures at the end.
        """
        fault = max(self._lasted_ns, key=lambda name: self._lasted_ns[name], default=None)
        if fault is not None and self._lasted_ns[fault] >= _LASTING_NS:
            failing = self._failing[fault]
            checks = _replaced(checks, [check for check in failing.checks if check.verdict is VerdictKind.FAULT])
            return Verdict(self._last_ns, VerdictKind.FAULT, checks, fault, failing.reason, rivals=failing.rivals)
        if self._verified_ns is not None:
            return Verdict(self._last_ns, VerdictKind.OK, checks, None, "calibration verified", point=self._point)
        late = next((check for check in checks if check.fault is Fault.LATENCY), None)
        if late is not None and late.verdict is VerdictKind.FAULT:
            reason = f"{_sentence(late)}, by all of the recording"
            return Verdict(self._last_ns, VerdictKind.FAULT, checks, Fault.LATENCY, reason)
        missing = self._missing(checks)
        lacks = "; ".join([*_lacks(lack), "too little in-plane motion to show"])
        unverified = _unverified(checks, lacks if missing else self._withheld, missing)
        reason = _undecided(self._rivals) if self._rivals else unverified
        kind = VerdictKind.NOT_VERIFIED
        return Verdict(self._last_ns, kind, checks, None, reason, rivals=self._rivals, point=self._point)

    def _missing(self, checks: tuple[Check, ...]) -> list[str]:
        return [name for name in self._required if name not in _shown(checks)]


def _replaced(checks: tuple[Check, ...], failing: list[Check]) -> tuple[Check, ...]:
    by_name = {check.name: check for check in checks} | {check.name: check for check in failing}
    return tuple(by_name.values())


def _shown(checks: tuple[Check, ...]) -> set[str]:
    return {check.name for check in checks if check.verdict is VerdictKind.OK}


def _unverified(checks: tuple[Check, ...], lack: str, missing: list[str]) -> str:
    """Returns why there is no OK: first what contradicts it, then what is missing. lack: why, of what is missing, or of
    all where nothing is.
    """
    agreement = next((check for check in checks if check.name == "motion-agreement" and check.ratio > 1), None)
    if agreement is not None:
        return f"picture and tracker disagree: {agreement.name} {agreement.ratio:.3g} × its limit"
    return "; ".join([*_doubts(checks), f"{lack}: {', '.join(missing)}"]) if missing else lack


def _lacks(lack: Lack | None) -> list[str]:
    return [] if lack is None else [_LACKS[lack.name].format(value=lack.value, least=lack.least)]


def _doubts(checks: tuple[Check, ...]) -> list[str]:
    """Returns the undecided estimate nearest to its limit, or farthest beyond; none where all are far from theirs."""
    undecided = (check for check in checks if check.name in _ESTIMATED and check.verdict is VerdictKind.NOT_VERIFIED)
    near = [check for check in undecided if abs(check.value) - check.sigma >= _NEAR * check.limit]
    if not near:
        return []
    worst = max(near, key=lambda check: check.ratio)
    place = "beyond" if worst.ratio > 1 else "near"
    value = f"{worst.value:+.3g} ± {worst.sigma:.2g} {worst.unit}"
    return [f"{place} its limit, not certain: {worst.name} {value}, limit {worst.limit:g} {worst.unit}"]


def _urgency(check: Check) -> tuple[int, float]:
    rank = _FIRST.index(check.fault) if check.fault in _FIRST else len(_FIRST)
    return rank + (1 + _LAST.index(check.fault) if check.fault in _LAST else 0), -check.ratio


def _worst_of_each(failed: list[Check]) -> dict[Fault, Check]:
    """Returns the worst check of each class, the most urgent first, so that two faults at once are both reported."""
    of_each: dict[Fault, Check] = {}
    for check in sorted(failed, key=_urgency):
        of_each.setdefault(check.fault, check)
    return of_each


def _contradiction(contradiction: Contradiction) -> str:
    check = contradiction.check
    wait = "must be shown again by new motion" if contradiction.named else "waiting for it to be confirmed"
    return f"{_sentence(check)}: {wait}"


def _undecided(rivals: Sequence[Rival]) -> str:
    """Returns which candidates there are, how far the second is behind, and the motion that decides between them."""
    names = [rival.check.name for rival in rivals]
    motions = " + ".join(gesture.value for gesture in gestures(names))
    return f"cause undecided, {rivals[1].behind_nats:.1f} nat apart: {', '.join(names)}; to decide: {motions}"


def _sentence(check: Check) -> str:
    return f"{check.name} {check.value:+.3g} {check.unit}, limit {check.limit:.4g} {check.unit}"
