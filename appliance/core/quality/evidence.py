"""Decides which windows of recent motion are examined, and which of their results count as evidence about the
calibration.
"""

from dataclasses import replace

from probewatch.appliance.core.detectors.polarity import obvious_flip
from probewatch.appliance.core.parameters import BREATHED
from probewatch.appliance.core.path.explanation import Explanation
from probewatch.appliance.core.path.residual import Lack
from probewatch.appliance.core.path.solver import Follow
from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.confirmation import (
    Memory,
    Solved,
    decidable,
    decide,
    quick_checks,
    since_change,
    with_accusation,
)
from probewatch.appliance.core.quality.examination import Finding, examine_nothing, lag_known, latency_of, without
from probewatch.appliance.core.quality.examiner import Examiner
from probewatch.appliance.core.quality.field_distortion import FieldDistortion
from probewatch.appliance.core.quality.point_watch import PointWatch
from probewatch.appliance.core.quality.resets import Cause, Effect, Reset, State, reset
from probewatch.appliance.core.quality.sequential_test import WINDOW_NS, Accusation, accuse
from probewatch.appliance.core.quality.stationary_time import StationaryTime
from probewatch.appliance.core.quality.undecided import Choice, undecided
from probewatch.appliance.core.quality.verification import Verification, VerificationStatus
from probewatch.appliance.core.quality.whole_session import WholeSession, whole_session
from probewatch.appliance.core.spread_work import SpreadWork, Steps
from probewatch.appliance.core.times import CHANGE_WINDOW_NS, PRESENT_NS, SELDOM_NS, SWEEP_WINDOW_NS
from probewatch.appliance.limits import NAMED_NATS, Limits
from probewatch.appliance.types import Calibration, Check, Fault, VerdictKind

_OBVIOUS_FLIP_NS = 2_000_000_000
"""Window length, ns, up to which each picture is checked for an obvious flip (1 ms): a solution finds it by then."""
_REQUIRED_FOR = {
    Fault.POLARITY: ("polarity",),
    Fault.SCALE: ("scale-lateral", "scale-axial"),
    Fault.ROTATION: ("rotation-lateral", "rotation-axial", "rotation-elevational"),
    Fault.OFFSET: ("offset-lateral", "offset-axial", "offset-elevational"),
}


class Evidence:
    """Estimates the calibration from the current window on request, and keeps the latest solution until the next one.

    A short window detects a change early, the long window is more accurate. Once the short window shows a fault, motion
    before the change is dropped, so that no estimate mixes the calibrations before and after it. A fault counts when
    two consecutive solutions show it. While the short window still holds motion from before the change, only that fault
    may be named, or a latency, which can look like any other fault. Then the window grows again and shows other faults.
    """

    def __init__(self, reference: Calibration, limits: Limits, window: PathWindow) -> None:
        self._reference = reference
        self._limits = limits
        self.window = window
        self._nothing = examine_nothing(limits)
        self._choice = Choice()
        self.distortion = FieldDistortion(limits.named_nats)
        self.stationary = StationaryTime(limits, reference)
        self.points = PointWatch(reference, limits)
        self._verification = Verification(limits, self.stationary)
        self._latest = self._best = self._nothing
        self._memory = Memory()
        self._long_ns = 0
        self.nats: float | None = None
        self._examiner = Examiner(reference, limits)
        self._solution = SpreadWork()

    @property
    def estimate(self) -> Calibration | None:
        """Returns the calibration of the solution that determines most parameters; None without a solution."""
        return None if self._best.solution is None else self._best.solution.calibration

    @property
    def follow(self) -> Follow | None:
        """Returns the share by which the tissue follows the probe, in the solution that determines most parameters;
        None without one.
        """
        return None if self._best.solution is None else self._best.solution.follow

    @property
    def motions(self) -> int:
        """Returns the number of pictures used in the solution that determines most parameters."""
        return 0 if self._best.solution is None else self._best.solution.motions

    @property
    def explanation(self) -> Explanation | None:
        """Returns the latest explanation of motion that contradicts the reference; None without one since a change."""
        return self._examiner.explanation

    def restart(self) -> None:
        """Discards what motion has shown, because the geometry has changed; contradictions stand."""
        self.reset(Cause.PICTURE_CHANGED)

    def lose_sight(self) -> None:
        """Discards what motion has shown: while the probe was out of sight, anything may have been changed on it. The
        learned breathing of the patient is kept, because it cannot have changed by that.
        """
        self.reset(Cause.SIGHT_LOST)

    def forget(self, since_ns: int) -> None:
        """Discards motion at or after `since_ns`, whose timestamps were wrong."""
        self.reset(Cause.PICTURE_STAMPS, since_ns)

    def forget_poses(self, since_ns: int) -> None:
        """Discards poses at or after `since_ns`, whose timestamps were wrong."""
        self.reset(Cause.POSE_STAMPS, since_ns)

    def reset(self, cause: Cause, since_ns: int = 0) -> None:
        """Discards what `resets.RESETS` lists for the cause. since_ns: from when on timestamps were wrong."""
        reset(cause, since_ns, self._resets())

    def _resets(self) -> dict[tuple[State, Effect], Reset]:
        examiner, verification, cleared, cut = self._examiner, self._verification, Effect.CLEARED, Effect.CUT
        return {
            (State.SOLVING, cleared): lambda _: self._solution.drop(),
            (State.MOTION, cleared): lambda _: self.window.restart(),
            (State.MOTION, cut): self.window.forget,
            (State.SHOWN, cleared): lambda _: verification.restart(),
            (State.SHOWN, cut): verification.forget,
            (State.LATEST, cleared): lambda _: self._clear_latest(),
            (State.UNCONFIRMED, cleared): lambda _: self._clear_unconfirmed(),
            (State.SUSPECTED, cleared): lambda _: self._clear_suspected(),
            (State.RESTS, cleared): lambda _: self.stationary.restart(),
            (State.RESTS, cut): self.stationary.forget,
            (State.NOISE, cleared): lambda _: examiner.noises.restart(),
            (State.NOISE, Effect.BREATHS_KEPT): lambda _: examiner.noises.lose_sight(),
            (State.LAG, cleared): lambda _: examiner.forget_lag(),
            (State.TISSUE, cleared): lambda _: self.window.forget_tissue(),
            (State.CONTRADICTIONS, cut): self._predate,
            (State.SETTLING, cleared): lambda _: self._settle_by(0),
            (State.SETTLING, cut): self._settle_by,
            (State.CHANGES, cut): self._cut_changes,
            (State.SEARCHED, cleared): lambda _: examiner.search_again(),
            (State.POSES, cut): self.window.poses.forget,
            (State.PACE, cleared): lambda _: self.points.pace.restart(),
        }

    def _clear_latest(self) -> None:
        self._latest, self._long_ns = self._nothing, 0

    def _clear_unconfirmed(self) -> None:
        self._choice = Choice()
        self._memory = replace(self._memory, failing_ns=None, breathed_ns=None)
        self.distortion.lose_sight()
        self.points.restart()
        self._examiner.forget_drift()

    def _clear_suspected(self) -> None:
        self._memory = replace(self._memory, suspects=frozenset(), culprits={})

    def _predate(self, since_ns: int) -> None:
        self._verification.predate(since_ns)
        self.distortion.predate(since_ns)

    def _settle_by(self, since_ns: int) -> None:
        self._memory = replace(self._memory, settled_ns=min(self._memory.settled_ns, since_ns))

    def _cut_changes(self, since_ns: int) -> None:
        kept = self._memory
        self._memory = replace(kept, valid_ns=min(kept.valid_ns, since_ns), lagged_ns=min(kept.lagged_ns, since_ns))

    def checks(self) -> tuple[Check, ...]:
        """Returns the checks of the latest solution, of a distorted field, and, while neither candidate is decided, of
        an undecided fault.
        """
        choice = self._choice.check if self._verification.rivals else None
        latest = tuple(
            replace(check, rested_ns=rested_ns)
            if (rested_ns := self._verification.rested_ns(check.name)) != check.rested_ns
            else check
            for check in self._latest.checks
        )
        return (*latest, *(check for check in (self.distortion.check, choice) if check is not None))

    @property
    def required(self) -> tuple[str, ...]:
        """Returns the names of the checks that must pass before the contact closes."""
        return self._limits.required_age_s.names

    @property
    def lack(self) -> Lack | None:
        """Returns the `Lack` of the latest solution's pictures; None without a solution."""
        return None if self._latest.solution is None else self._latest.solution.lack

    @property
    def status(self) -> VerificationStatus:
        """Returns the verification so far: what is shown, and which contradictions stand."""
        contradiction, status = self.distortion.contradiction, replace(self._verification.status, lack=self.lack)
        if contradiction is None:
            return status
        standing = (*status.contradictions, contradiction)
        return replace(status, verified_ns=None, expires_ns=None, contradictions=standing)

    def shows(self, fault: Fault) -> bool:
        """Returns whether the latest solution verifies every parameter of that class."""
        return self._latest.shows(_REQUIRED_FOR[fault])

    def finish(self) -> WholeSession:
        """Finishes the solution under way and returns all motion that is kept, for `final`."""
        self._solution.finish()
        return self._session()

    def final(self, session: WholeSession) -> tuple[Check, ...]:
        """Returns the checks of the solution that determines most parameters; the solution over all motion that is kept
        is one of the candidates.
        """
        whole = session.finding()
        if whole.shown >= self._best.shown and whole.failed <= self._latest.failed:
            self._best = whole
        best = session.with_sharper_latency(self._best.checks)
        return (*best, *([] if self.distortion.check is None else [self.distortion.check]))

    def constant_latency(self) -> Check:
        """Returns the tracker's latency from all motion that is kept, assuming that it has not changed. Unlike `final`
        it keeps the motion before a change, so it is more accurate for a recording made to measure the latency.
        """
        return self._session().constant_latency()

    def _session(self) -> WholeSession:
        return whole_session(self.window, self._reference, self._limits, self._memory.valid_ns, self._examiner.about_s)

    def solve(self, now_ns: int) -> None:
        """Runs a solution from start to end."""
        self.begin(now_ns)
        self._solution.finish()

    def begin(self, now_ns: int) -> None:
        """Starts a solution of the current data; one in progress is dropped.

        `now_ns` is the time of the latest picture, which need not have shown motion.
        """
        self._solution.begin(self._solving(self.window.as_now(), now_ns))

    @property
    def under_way(self) -> bool:
        """Returns whether a solution is in progress."""
        return self._solution.under_way

    def go_on(self, most_us: int) -> None:
        """Runs the next step of the solution in progress, and further steps while the total stays within `most_us`."""
        self._solution.go_on(most_us)

    def _solving(self, window: PathWindow, now_ns: int) -> Steps[None]:
        """Examines the short window for a change, drops the motion before one, and examines the rest. The whole
        solution uses the motion kept at its start, so a late result does not look newer than its data. Discarding any
        of that motion, or a contradiction from another detector, cancels the solution.

        `window` holds the motion kept at `now_ns`.
        """
        lagged_ns = yield from self._examiner.new_lag(window, now_ns)
        if lagged_ns is not None:
            self._memory = self._memory.lagged_from(lagged_ns)
        window.look_at_tissue(self._examiner.about_s, self._limits.scale_percent / 100)
        self.window.take_tissue(window)
        recent = window.since(max(self._memory.lagged_ns, now_ns - CHANGE_WINDOW_NS))
        finding = yield from self._examiner.look(
            window, recent, self._memory.valid_ns, now_ns - CHANGE_WINDOW_NS, now_ns
        )
        accusation = yield from self._accused(finding, window, now_ns)
        yield from self._measure(finding, recent, window, now_ns)
        if accusation is not None:
            self._latest = with_accusation(
                self._latest, accusation, reported=accusation.nats >= self._limits.named_nats
            )
        excused = frozenset[str]() if self._examiner.noises.breathing_known else BREATHED
        accusation = None if self._latest.failed else accusation
        unnamed = None if accusation is None else undecided(accusation, excused, self._limits.named_nats)
        self._choice.note(unnamed, now_ns)
        self.points.note(self._latest, now_ns, self.status, window.stamps_err_s)

    def check_obvious_flip(self) -> None:
        """Looks for a mirrored picture without a solution: at every picture of the first motion, while the polarity is
        undecided.
        """
        if self._polarity_known or not 0 < self.window.span_ns < _OBVIOUS_FLIP_NS:
            return
        try:
            check = obvious_flip(self.window.samples(0.0), self._reference, NAMED_NATS)
        except ValueError:
            return
        if check is not None:
            self._solution.drop()
            self._verification.contradict((check,), frozenset({check.name}), self.window.now_ns)
            self._memory = replace(self._memory, suspects=self._memory.suspects | {check.name})
            checks = (check if one.name == check.name else one for one in self._latest.checks)
            self._latest = Finding(tuple(checks), self._latest.solution)

    @property
    def _polarity_known(self) -> bool:
        own = next(check for check in self._latest.checks if check.fault is Fault.POLARITY)
        return own.verdict is not VerdictKind.NOT_VERIFIED

    def _accused(self, finding: Finding, whole: PathWindow, now_ns: int) -> Steps[Accusation | None]:
        """Runs the sequential test and returns its result. Each contradiction withdraws the OK, and motion before the
        change is dropped.

        `finding` belongs to the short window, whose noise is used until noise from before the window has been learned.
        """
        learned = self._examiner.noises.of_motion(now_ns - WINDOW_NS)
        if finding.solution is None:
            self.nats = None
            return None
        window = whole.since(max(self._memory.valid_ns, now_ns - WINDOW_NS))
        noise = finding.solution.noise if learned is None else learned
        lateness = latency_of(finding)
        lag_s = lateness.value / 1e3 if lag_known(lateness, self._limits) else 0.0
        ask_bent, known = self.distortion.due(now_ns), learned is not None
        found = yield from accuse(window, self._reference, self._limits, noise, lag_s, known, ask_bent)
        self.nats = found.nats
        explained = bool(found.named or self._latest.failed)
        if ask_bent and self.distortion.note(found.bent_nats, window.start_ns, now_ns, explained):
            # Motion that looked bent must not make anything OK again.
            self.reset(Cause.FIELD_ANSWERED)
            self._memory = self._memory.valid_from(self.distortion.until_ns)
        if not found.checks:
            return None
        # A mirrored picture can look like many other faults, and is named elsewhere.
        if not finding.shows(("polarity",)):
            found = replace(found, checks=without(Finding(found.checks), found.named).checks, rivals=())
        self._verification.accuse(found.checks, found.named, whole.now_ns, found.rivals)
        if found.named:
            self._memory = self._memory.valid_from(found.since_ns)
        return found

    def _measure(self, finding: Finding, recent: PathWindow, whole: PathWindow, now_ns: int) -> Steps[None]:
        short = decidable(finding)
        self._memory = since_change(self._memory, short, now_ns)
        if not self._due(whole.since(max(self._memory.valid_ns, now_ns - SWEEP_WINDOW_NS)), short, now_ns):
            self._contradict(quick_checks(short), frozenset(), whole)
            return
        self._long_ns = now_ns
        long, finding = yield from self._measured(recent, finding, whole, now_ns)
        if finding.solution is not None:
            self._examiner.noises.learn(now_ns, finding.solution.noise, long.span_ns, finding.solution.way_mm)
        solved = Solved(short, finding, long.span_ns, now_ns, lag_explained=bool(self._examiner.about_s))
        self._memory, doubtful = decide(self._memory, solved, self._limits)
        self._contradict((*quick_checks(short), *finding.checks), finding.failed - doubtful, whole)
        if finding.solution is not None:
            self._examiner.noises.see_breathing(long.span_ns)
        last_contradiction_ns = self._verification.last_contradiction_ns
        self._latest = yield from self._accepted(without(finding, doubtful), long, whole, now_ns)
        if not self._verification.contradictions:
            # A resolved contradiction must not come back with the motion that caused it.
            self._memory = self._memory.valid_from(last_contradiction_ns)
        if self._latest.shown >= self._best.shown:
            self._best = self._latest

    def _measured(
        self, recent: PathWindow, finding: Finding, whole: PathWindow, now_ns: int
    ) -> Steps[tuple[PathWindow, Finding]]:
        """Returns the shortest window that decides, and its finding, because newer motion keeps the contact closed for
        longer.

        `finding` belongs to the recent window, where nothing precedes it. While a contradiction stands, the longest
        window is left out: it would keep the motion that caused the contradiction for three times as long.
        """
        window = recent
        for span_ns in (PRESENT_NS,) if self._verification.doubted else (PRESENT_NS, SWEEP_WINDOW_NS):
            longer = whole.since(max(self._memory.valid_ns, now_ns - span_ns))
            if len(longer) > len(window):
                window = longer
                finding = yield from self._examiner.examined(window, self._examiner.noises.for_window(window, now_ns))
            if finding.failed or finding.shows(self.required):
                break
        return window, finding

    def _due(self, long: PathWindow, short: Finding, now_ns: int) -> bool:
        """Returns whether another solution of the long window, three times as costly as one of the short window, is
        worthwhile: the window still grows, or something contradicts its last solution.
        """
        doubted = bool(short.failed or self._memory.suspects) or self._verification.doubted
        return doubted or long.span_ns < PRESENT_NS or now_ns - self._long_ns >= SELDOM_NS

    def _contradict(self, checks: tuple[Check, ...], named: frozenset[str], whole: PathWindow) -> None:
        known = self._examiner.noises.breathing_known
        self._verification.contradict_over(checks, named, whole.start_ns, whole.now_ns, known)

    def _accepted(self, finding: Finding, window: PathWindow, whole: PathWindow, now_ns: int) -> Steps[Finding]:
        """Returns the finding; where its window reaches back to the last contradiction of a fault, returns the finding
        of the motion after that contradiction.
        """
        last_contradiction_ns = self._verification.last_contradiction_ns
        if window.start_ns <= last_contradiction_ns and not finding.failed:
            window = window.since(last_contradiction_ns + 1)
            finding = yield from self._examiner.examined(window, self._examiner.noises.for_window(window, now_ns))
            self._contradict(finding.checks, frozenset(), whole)
            finding = without(finding, finding.failed)
        return replace(finding, checks=self._verification.weigh(finding.checks, window.start_ns))
