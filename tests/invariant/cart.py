"""Line, device watchers and supervisor over the world, in simulated time; after every tick the oracle speaks."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from probewatch.appliance.core.detectors.no_picture import NoPicture
from probewatch.appliance.core.line import Line
from probewatch.appliance.limits import AT_REST_S, Limits, RequiredAges
from probewatch.appliance.supervision.device_health import DeviceHealth, Timeouts
from probewatch.appliance.supervision.device_watchers import watch_devices
from probewatch.appliance.supervision.supervisor import LATCHED, Durations, Inputs, Request, Supervisor
from probewatch.appliance.types import AlarmState, Verdict
from probewatch.drivers.samples import Frame, GreyImage, Pose, PoseStatus, Sample, Stamp
from tests.invariant.circumstances import GRADUAL, NO_BLANK, Blank, Circumstances, Manner, Pictures, Poses, Stamps
from tests.invariant.oracle import GRADUAL_WITHIN_NS, MAX_AGE_NS, NAMED_WITHIN_NS, SHIPPED, TICK_NS, Broken, Oracle
from tests.invariant.world import MOVED, NONE, Change, Hand, Scanner, Tracker, blended, reference

ORIGIN_NS = 10_000_000_000_000
"""Later than any stamp in these tests is early: none is negative."""
_ERR_NS = 100_000
_STATUS = {
    Poses.MISSING: PoseStatus.MISSING,
    Poses.PARTIAL: PoseStatus.PARTIAL,
    Poses.OUT_OF_VOLUME: PoseStatus.OUT_OF_VOLUME,
    Poses.STALE: PoseStatus.STALE,
    Poses.FAULT: PoseStatus.FAULT,
}
_ONE_IN = {Poses.ONE_IN_TWELVE: 12, Poses.ONE_IN_TWO: 2}
POSE_MS = 16.666667
"""Of a tracker of 60 Hz."""
QUICK_FADE_S = 0.3
"""Up to which a fade into a picture that was moved, turned or sheared is told as soon as one at once."""
_SLOWER = 20
"""60 Hz ÷ 20 is three poses a second."""


@dataclass(frozen=True, slots=True)
class Moment:
    """The contact or the state changed. t_s: since the start."""

    t_s: float
    closed: bool
    state: str
    reason: str

    def __str__(self) -> str:
        return f"{self.t_s:8.2f} s  {'closed' if self.closed else 'open  '}  {self.state}: {self.reason}"


@dataclass(frozen=True, slots=True)
class _Transition:
    """From what was true before to what is. black_ns: from when to when its pictures are black."""

    manner: Manner
    before: Change
    start_ns: int
    end_ns: int
    black_ns: tuple[int, int] = (0, 0)


class Cart:
    """A cart that was just switched on, with everything well unless told otherwise.

    change: how the true calibration differs from the reference from the start. tilt_deg: of the hand. enforced: the
    clauses of the invariant that are raised; of the others `broken` tells. attended: somebody acknowledges whatever is
    latched. received: samples pass the threads of their devices, which refuse what is stamped later than it arrives;
    without, the line alone must cope. discerning: without, whatever comes is taken for tissue, and evidence alone must
    outlast noise and black. pose_ms: from one reading of the tracker to the next. max_age_ns: after which a
    verification is none. asked: what the contact asks for; at_rest_s: for how much longer it counts while the probe
    rests.
    """

    frames = 0
    """Delivered to the line, by all carts of the process."""

    def __init__(
        self,
        seed: int,
        *,
        change: Change = NONE,
        tilt_deg: float = 1.4,
        fps: float = 30.0,
        pose_ms: float = POSE_MS,
        enforced: str = "abcdfg",
        attended: bool = True,
        received: bool = False,
        discerning: bool = True,
        max_age_ns: int = MAX_AGE_NS,
        asked: RequiredAges = SHIPPED,
        at_rest_s: float = AT_REST_S,
    ) -> None:
        self.circumstances = Circumstances()
        self.attended, self._received = attended, received
        self.oracle = Oracle(max_age_ns, asked, at_rest_s)
        self.journal: list[str] = []
        self.moments: list[Moment] = []
        self.broken: list[tuple[float, Broken]] = []
        self.alarm: AlarmState | None = None
        self.newest: Verdict | None = None
        self._enforced = enforced
        self._hand, self._scanner, self.tracker = Hand(seed, tilt_deg), Scanner(seed), Tracker(seed)
        self._limits = Limits(required_age_s=asked, at_rest_s=at_rest_s)
        self._reference, self._discerning = reference(), discerning
        self.line, self._supervisor = (
            Line(self._reference, self._limits),
            Supervisor(Durations(max_verification_age_ns=max_age_ns)),
        )
        if not discerning:
            self.line._detectors = tuple(one for one in self.line._detectors if not isinstance(one, NoPicture))
        self._health = DeviceHealth(started_ns=ORIGIN_NS)
        self._verdicts: list[Verdict] = []
        self._request: Request | None = None
        self._index = {"frame": 0, "pose": 0}
        self._every_ns = {"frame": round(1e9 / fps), "pose": round(pose_ms * 1e6), "tick": TICK_NS}
        self._next_ns = {"frame": ORIGIN_NS, "pose": ORIGIN_NS + self._every_ns["pose"] // 3, "tick": ORIGIN_NS}
        self._now_ns = self._true_ns = ORIGIN_NS
        self._picture: GreyImage | None = None
        self._reading: np.ndarray | None = None
        self._false_once: dict[str, int] = {}
        self._alike_ns: dict[str, int] = {}
        self._change = NONE
        self._transition: _Transition | None = None
        if change is not NONE:
            self.change(change)

    @property
    def t_s(self) -> float:
        """Since the start."""
        return (self._now_ns - ORIGIN_NS) / 1e9

    @property
    def closed(self) -> bool:
        return self.alarm is not None and self.alarm.energised

    @property
    def truth(self) -> Change:
        return self._change

    def change(self, change: Change) -> None:
        """The true calibration is another from here on."""
        self._say(f"the truth: {change}")
        self._change, self._transition = change, None
        self.oracle.changed(change)

    def break_picture(self, change: Change, manner: Manner, lasting_s: float, blank: Blank = NO_BLANK) -> None:
        """The picture becomes another from here on, after so long and the blank; a torn picture is one. The body
        stays.
        """
        moved = change in MOVED
        change = replace(change, body=self._change.body)
        lasting_ns = {Manner.AT_ONCE: 0, Manner.TORN: self._every_ns["frame"]}.get(manner, round(lasting_s * 1e9))
        self._say(f"the picture, {manner.value}, {lasting_ns / 1e9:g} s, {blank}: {change}")
        start_ns, black_ns = self._now_ns, round(blank.lasting_s * 1e9)
        first_ns = start_ns if blank.first else start_ns + lasting_ns
        self._transition = _Transition(
            manner, self._change, start_ns, start_ns + lasting_ns + black_ns, (first_ns, first_ns + black_ns)
        )
        told_at_once = manner is Manner.FADED and lasting_s <= QUICK_FADE_S and moved and not self._change.faults
        self._change = change
        slow = manner in GRADUAL and not told_at_once
        self.oracle.changed(change, GRADUAL_WITHIN_NS if slow else NAMED_WITHIN_NS)

    def meet(self, **circumstances: object) -> None:
        """These circumstances from here on; what is not named stays."""
        self.circumstances = replace(self.circumstances, **circumstances)  # type: ignore[arg-type]
        self._alike_ns.clear()
        self._say(str(self.circumstances))

    def tilt(self, deg: float) -> None:
        """The hand tilts the probe by so much from here on."""
        self._say(f"the hand tilts by {deg:g}°")
        self._hand.tilt_deg = deg

    def false_stamp(self, what: str, off_ns: int) -> None:
        """The next "frame" or "pose" is stamped so much too late, or too early where negative."""
        self._say(f"one {what} stamped {off_ns / 1e9:+g} s off")
        self._false_once[what] = off_ns

    def ask(self, request: Request) -> None:
        """At the next tick."""
        self._say(f"a person asks: {request.value}")
        self._request = request

    def recalibrate(self) -> None:
        """A scan and its confirmation: what is true is the reference from here on."""
        for request in (Request.BEGIN_RECALIBRATION, Request.END_RECALIBRATION):
            self.ask(request)
            self.run(0.2)
        self.line = Line(self._reference, self._limits)
        self._change = NONE
        self.oracle.renewed()

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass; False where `until`, asked after each tick, never held. Raises Broken."""
        end_ns = self._now_ns + round(seconds * 1e9)
        while (what := min(self._next_ns, key=self._next_ns.__getitem__)) and self._next_ns[what] < end_ns:
            self._now_ns = self._next_ns[what]
            self._next_ns[what] += self._every_ns[what]
            {"frame": self._frame, "pose": self._pose, "tick": self._tick}[what]()
            if what == "tick" and until():
                return True
        self._now_ns = end_ns
        return False

    def told(self) -> str:
        """What happened, and what the room saw, in order."""
        return "\n".join([*self.journal, "", *map(str, self.moments)])

    def _say(self, what: str) -> None:
        self.journal.append(f"{self.t_s:8.2f} s  {what}")

    def _frame(self) -> None:
        self._index["frame"] += 1
        if self.circumstances.pictures is Pictures.GONE:
            return
        pose = self._hand_on()
        image, genuine = self._seen(pose)
        stamp_ns, right = self._stamped("frame", self.circumstances.frame_stamps)
        if genuine and right:
            self.oracle.picture(self._now_ns, pose)
        Cart.frames += 1
        self._health = replace(self._health, frame_ns=self._now_ns)
        self._deliver(Frame(Stamp(stamp_ns, _ERR_NS), self._index["frame"], image))

    def _pose(self) -> None:
        index = self._index["pose"] = self._index["pose"] + 1
        fate = self.circumstances.poses
        if fate is Poses.GONE or (fate is Poses.SLOW and index % _SLOWER):
            return
        pose = self._hand_on()
        status = _STATUS.get(fate, PoseStatus.MISSING if index % _ONE_IN.get(fate, 1) else PoseStatus.OK)
        stamp_ns, right = self._stamped("pose", self.circumstances.pose_stamps)
        if right and status is PoseStatus.OK and fate not in (Poses.NAN, Poses.REPEATED):
            self.oracle.pose(self._now_ns)
        matrix = self._read(pose) if status is PoseStatus.OK else None
        self._note_reply(status)
        self._deliver(Pose(Stamp(stamp_ns, _ERR_NS), index, matrix, 0.1, status))

    def _hand_on(self) -> np.ndarray:
        """(4, 4) picture → tissue now."""
        self._hand.go_on((self._now_ns - self._true_ns) / 1e9, self.circumstances.moving)
        self._true_ns = self._now_ns
        return self._hand.pose()

    def _seen(self, pose: np.ndarray) -> tuple[GreyImage, bool]:
        """What the scanner sends, and whether it is the tissue as it is now."""
        fate = self.circumstances.pictures
        if fate is Pictures.FLICKER:
            fate = Pictures.BLACK if self._index["frame"] % 2 else Pictures.GENUINE
        if fate is Pictures.FROZEN and self._picture is not None:
            return self._picture, False
        between = self._transition is not None and self._now_ns < self._transition.end_ns
        make = {
            Pictures.BLACK: self._scanner.black,
            Pictures.NOISE: self._scanner.noise,
        }.get(fate, partial(self._between if between else self._shown, pose))
        image = self._picture = make()
        return image, fate is Pictures.GENUINE and not between

    def _shown(self, pose: np.ndarray) -> GreyImage:
        return self._scanner.picture(pose, self._change)

    def _between(self, pose: np.ndarray) -> GreyImage:
        """What is shown until the picture is the other one."""
        transition = self._transition
        assert transition is not None
        black_ns, black_end_ns = transition.black_ns
        if black_ns <= self._now_ns < black_end_ns:
            return self._scanner.black()
        before = self._scanner.picture(pose, transition.before)
        if transition.manner is Manner.TORN:
            half = before.shape[0] // 2
            return np.vstack([before[:half], self._shown(pose)[half:]])
        lasting_ns = transition.end_ns - transition.start_ns - (black_end_ns - black_ns)
        passed_ns = self._now_ns - transition.start_ns - (black_end_ns - black_ns if self._now_ns >= black_ns else 0)
        share = passed_ns / lasting_ns
        if transition.manner is Manner.ANIMATED:
            return self._scanner.picture(pose, self._change.on_its_way(share))
        if transition.manner in GRADUAL:
            return blended(before, self._shown(pose), transition.manner, share)
        return self._scanner.black() if self._picture is None or transition.manner is Manner.BLACK else self._picture

    def _read(self, pose: np.ndarray) -> np.ndarray:
        fate = self.circumstances.poses
        if fate is Poses.NAN:
            return np.full((4, 4), np.nan)
        if fate is not Poses.REPEATED or self._reading is None:
            self._reading = self.tracker.reading(pose, self._change)
        return self._reading

    def _stamped(self, what: str, stamps: Stamps) -> tuple[int, bool]:
        """The stamp, and whether it is right."""
        off_ns = self._false_once.pop(what, 0)
        skew_ns = self.circumstances.skew_ns
        if stamps is Stamps.ALIKE:
            return self._alike_ns.setdefault(what, self._now_ns), False
        if stamps is Stamps.CRAWLING:
            self._alike_ns[what] = self._alike_ns.get(what, self._now_ns) + 1
            return self._alike_ns[what], False
        if stamps is Stamps.HALF_AS_FAST:
            return (self._now_ns + self._alike_ns.setdefault(what, self._now_ns)) // 2, False
        off_ns += {Stamps.FUTURE: skew_ns, Stamps.PAST: -skew_ns}.get(stamps, 0)
        return self._now_ns + off_ns, off_ns == 0

    def _note_reply(self, status: PoseStatus) -> None:
        self._health = replace(self._health, replies=self._health.replies.noted(status, self._now_ns))

    def _deliver(self, sample: Sample) -> None:
        """The one place where a sample enters the line; it arrives at self._now_ns."""
        if not (self._received and sample.stamp.later_than(self._now_ns)):
            self._verdicts += self.line.step(sample)

    def _tick(self) -> None:
        now_ns = self._now_ns
        health = replace(self._health, heartbeat_ns=now_ns, output_ns=now_ns)
        inputs = Inputs(tuple(self._verdicts), watch_devices(now_ns, health, Timeouts()), self._next_request())
        self.newest = self._verdicts[-1] if self._verdicts else self.newest
        self._verdicts.clear()
        alarm = self._supervisor.step(now_ns, inputs)
        self._note_moment(alarm)
        self.alarm = alarm
        lively_in_view = self.circumstances.in_view and self.circumstances.moving
        blank = self.circumstances.blank and self._discerning
        rests = self.line.stationary_spans
        for broken in self.oracle.tick(now_ns, lively_in_view, blank, alarm, self.newest, rests):
            self.broken.append((self.t_s, broken))
            if broken.clause in self._enforced:
                broken.add_note(f"at {self.t_s:.2f} s\n{self.told()}")
                raise broken

    def _next_request(self) -> Request | None:
        request, self._request = self._request, None
        latched = self.alarm is not None and self.alarm.state in LATCHED and not self.alarm.acknowledged
        return Request.ACKNOWLEDGE if request is None and latched and self.attended else request

    def _note_moment(self, alarm: AlarmState) -> None:
        before = self.alarm
        if before is None or (before.energised, before.state, before.fault) != (
            alarm.energised,
            alarm.state,
            alarm.fault,
        ):
            self.moments.append(Moment(self.t_s, alarm.energised, alarm.state.value, alarm.reason))
