"""Turns samples into verdicts. Pure: no clock, no thread, no file; time is in the stamps.

Acquisition → Real-time Tracker → Motion Analyzer → AX=XB solver → Quality Control, one picture after the other."""

from collections import deque
from dataclasses import replace

from probewatch.appliance.core.acquisition.input_validation import checked_pose, refused_picture
from probewatch.appliance.core.acquisition.pairing import Pairing, Unpaired
from probewatch.appliance.core.acquisition.stamp_gate import StampCheck, StampGate
from probewatch.appliance.core.detectors.depth_ruler import DepthRuler
from probewatch.appliance.core.detectors.detector import Detector
from probewatch.appliance.core.detectors.exchanged_probe import ExchangedProbe
from probewatch.appliance.core.detectors.fan_watch import FanWatch
from probewatch.appliance.core.detectors.frozen_tracker import FrozenTracker
from probewatch.appliance.core.detectors.frozen_video import FrozenVideo
from probewatch.appliance.core.detectors.marker_slip import MarkerSlip
from probewatch.appliance.core.detectors.no_picture import NoPicture
from probewatch.appliance.core.detectors.observation import Observation, observed
from probewatch.appliance.core.detectors.picture_chain import PictureChain
from probewatch.appliance.core.detectors.pose_convention import PoseConvention
from probewatch.appliance.core.detectors.slow_slip import SLIPS_S, SlowSlip
from probewatch.appliance.core.detectors.split_slip import SplitSlip
from probewatch.appliance.core.detectors.witness import Witness
from probewatch.appliance.core.motion import analyse, quick, wants_keyframe
from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.evidence import Evidence
from probewatch.appliance.core.quality.judgement import Judgement, bounded, judge
from probewatch.appliance.core.quality.point_error import Bounds
from probewatch.appliance.core.quality.proposal import propose
from probewatch.appliance.core.quality.report import LineReport
from probewatch.appliance.core.quality.solution_schedule import SolutionSchedule
from probewatch.appliance.core.quality.verification import VerificationStatus
from probewatch.appliance.core.registration.averaging import FrameAveraging
from probewatch.appliance.core.registration.pyramid import Bits
from probewatch.appliance.core.registration.realtime_tracker import RealTimeTracker, Tracked
from probewatch.appliance.core.times import MOST_APART_NS
from probewatch.appliance.limits import TRACKER_STALE_MS, Limits
from probewatch.appliance.types import Calibration, Check, Fault, Kind, Motion, StampedPair, Verdict, VerdictKind
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import Frame, Matrix4, Pose

REPORTS_FAULTS = (Fault.SCALE,)

_QUICK_PICTURES = 4
"""Number of pictures by whose poses the hand is called quick. With two, tracker noise of .1 mm alone makes one picture
in ten of a slow circle quick; more ask for a hand that is quick for longer. Not varied."""
_SIZE_PERCENT = 0.1
"""Limit, %, that is reported with a picture of another size, which fails however little it differs: 1 px of 640 is .16
%."""
_GAP_NS = MOST_APART_NS
"""Time, ns, without a live picture of tissue and its pose, after which whatever a hand can change counts as changed. A
shorter one asks for new motion whenever a hand passes before the markers; a longer one leaves time to bend them unseen.
It is the longest time between two poses that are bridged: beyond it no picture has a pose, and the slip watch begins
again. A grabber faster than the scanner may repeat a picture for as long."""


class Line:
    """Watches one calibration, the reference. It takes frames and poses in the order in which they came.

    step() accepts any frame: one of another size than the reference's is a scale fault, one that is not an 8-bit grey
    picture is NOT_VERIFIED with the reason. stale_ns: how long a tracker may repeat one pose while the picture moves.
    relative_pose: as of `Witness`. motion: the latest motion that was sorted, None before the first."""

    def __init__(
        self,
        reference: Calibration,
        limits: Limits,
        stale_ns: int = round(TRACKER_STALE_MS * 1e6),
        relative_pose: Matrix4 | None = None,
    ) -> None:
        self._reference, self._limits = reference, limits
        self._frame_gate, self._pose_gate = StampGate(), StampGate()
        self._pairing = Pairing()
        aspect = float(reference.scale_mm_per_px[1] / reference.scale_mm_per_px[0])
        self._tracker = RealTimeTracker(aspect, float(reference.scale_mm_per_px[1]))
        self._averaging = FrameAveraging()
        self._poses_before: deque[Matrix4] = deque(maxlen=_QUICK_PICTURES)
        self._evidence = Evidence(reference, limits, PathWindow(reference))
        self._frozen = FrozenVideo(round(limits.frozen_ms * 1e6))
        self._no_picture = NoPicture()
        self._witness = Witness(limits, relative_pose)
        self._picture_chain = PictureChain(
            limits, reference, lambda: self._tracker.mask, lambda: self._averaging.none, _GAP_NS
        )
        self._detectors: tuple[Detector, ...] = (
            self._picture_chain,
            DepthRuler(lambda: self._tracker.mask, limits.scale_percent, limits.confidence_sigma),
            FanWatch(reference, limits, self._evidence.checks),
            MarkerSlip(limits, reference),
            SplitSlip(limits, reference),
            *(SlowSlip(limits, reference, over_s) for over_s in SLIPS_S),
            self._frozen,
            self._no_picture,
            FrozenTracker(stale_ns),
            PoseConvention(lambda: self._evidence.explanation),
            ExchangedProbe(self._evidence.checks, limits.confidence_sigma),
            self._witness,
        )
        self._judgement = Judgement(limits.required_age_s.names)
        self._known_poses: tuple[tuple[int, Matrix4], ...] = ()
        self._schedule = SolutionSchedule()
        self._sighted_ns: int | None = None
        self._broke = False
        self._frames = self._poses = self._paired = 0
        self.motion: Motion | None = None

    @property
    def mask(self) -> Bits | None:
        """Returns where the registration looks, (h, w) bool; None until it has learnt what never moves."""
        return self._tracker.mask

    @property
    def averaged(self) -> float:
        """Returns the share of the last picture that the scanner leaves in the next, as the pictures show it; 0 for
        none."""
        return self._averaging.share

    @property
    def nats(self) -> float | None:
        """Returns `Evidence.nats`."""
        return self._evidence.nats

    @property
    def stationary_spans(self) -> tuple[tuple[int, int], ...]:
        """Returns `StationaryTime.spans`."""
        return self._evidence.stationary.spans

    @property
    def reference(self) -> Calibration:
        """Returns the calibration that is watched."""
        return self._reference

    @property
    def relative_pose(self) -> Matrix4 | None:
        """Returns `Witness.relative_pose`."""
        return self._witness.relative_pose

    def step(self, sample: Frame | Pose) -> tuple[Verdict, ...]:
        """Takes the next sample; returns one verdict for each frame that it settles."""
        gate = self._count(sample)
        checked = gate.step(sample.stamp.t_ns)
        if checked is StampCheck.REFUSED:
            return self._refused(sample)
        if checked is StampCheck.WENT_BACKWARDS:
            self._turn_back(sample)
        if isinstance(sample, Pose):
            sample = checked_pose(sample)
            self._take_pose(sample)
        return tuple(self._settled(item) for item in self._pairing.step(sample))

    def point_bounds(self, t_ns: int, at_mm: Array) -> Bounds | None:
        """Returns the bounds at (n, 3) places in the axes of the picture, mm from its middle. Of such bounds, the worst
        and the median are the error of a point in the verdict at t_ns, which is the last one."""
        return self._evidence.points.at(t_ns, self._status, at_mm)

    def report(self) -> LineReport:
        """Returns what the whole session showed; frames still waiting for a pose stay unpaired."""
        self._pairing.finish()
        session = self._evidence.finish()
        verdict = self._judgement.overall(
            (*self._believed(self._evidence.final(session)), *self._detected()), self._evidence.lack
        )
        return LineReport(
            frames=self._frames,
            poses=self._poses,
            paired=self._paired,
            unpaired=dict(self._pairing.unpaired),
            latency=next((check for check in verdict.checks if check.name == "latency"), None),
            estimate=self._evidence.estimate,
            motions=self._evidence.motions,
            follow=self._evidence.follow,
            second_opinion=session.second_opinion(),
            checks=verdict.checks,
            verdict=verdict,
            required=self._evidence.required,
            proposal=propose(verdict.checks, self._reference, 0.0),
            limits=self._limits,
        )

    def constant_latency(self) -> Check:
        """Returns `Evidence.constant_latency` of the whole session; frames still waiting for a pose stay unpaired."""
        self._pairing.finish()
        return self._evidence.constant_latency()

    def _count(self, sample: Frame | Pose) -> StampGate:
        if isinstance(sample, Pose):
            self._poses += 1
            return self._pose_gate
        self._frames += 1
        return self._frame_gate

    def _refused(self, sample: Frame | Pose) -> tuple[Verdict, ...]:
        """Settles a frame whose stamp cannot be believed at the time of the last one that could. In a stream of such
        frames that time does not advance, and what was shown would never grow old, so it is discarded once the stream
        is lost."""
        if isinstance(sample, Pose):
            return ()
        if self._frame_gate.lost:
            self._unverify()
        self._pairing.unpaired[StampCheck.REFUSED.value] += 1
        return (self._judged(self._frame_gate.last_ns or 0, self._checks()),)

    def _turn_back(self, sample: Frame | Pose) -> None:
        """Discards what is stamped at or after this sample, as it was stamped in the future."""
        t_ns = sample.stamp.t_ns
        if isinstance(sample, Pose):
            self._pairing.forget_poses(t_ns)
            self._evidence.forget_poses(t_ns)
            for detector in self._detectors:
                detector.forget_poses(t_ns)
        else:
            self._averaging.restart()
            self._pairing.forget_frames(t_ns)
            self._evidence.forget(t_ns)
            for detector in self._detectors:
                detector.forget_pictures(t_ns)

    def _take_pose(self, pose: Pose) -> None:
        if pose.matrix is not None:
            self._evidence.window.poses.add(pose.stamp.t_ns, pose.matrix)
            for detector in self._detectors:
                detector.pose(pose)

    def _settled(self, item: StampedPair | Unpaired) -> Verdict:
        t_ns = item.frame.stamp.t_ns
        self._paired += isinstance(item, StampedPair)
        self._note_gap(t_ns)
        if refusal := refused_picture(item.frame.image):
            self._lose_sight(t_ns)
            status = self._status
            shown_ns = status.verified_ns, status.expires_ns
            return self._with_point_error(
                Verdict(t_ns, VerdictKind.NOT_VERIFIED, self._detected(), None, refusal, *shown_ns)
            )
        height, width = item.frame.image.shape
        if (width, height) != self._reference.image_size_px:
            return self._judged(t_ns, (self._wrong_size(width, height),))
        self._frozen.compare(t_ns, item.frame.image)
        if not self._frozen.repeats:
            self._watch(item)
        else:
            self._averaging.repeat()
            self._seen(Observation(t_ns, item.frame.image, repeated=True))
            if self._frozen.repeats_ns > _GAP_NS:
                self._lose_sight(t_ns)
        self._note_sight(item)
        self._solve(t_ns, isinstance(item, StampedPair))
        self._evidence.check_obvious_flip()
        return self._judged(t_ns, self._checks())

    def _note_gap(self, t_ns: int) -> None:
        """Discards what was shown, of every parameter, after a gap in sight."""
        if self._sighted_ns is not None and not 0 <= t_ns - self._sighted_ns <= _GAP_NS:
            self._unverify()

    def _note_sight(self, item: StampedPair | Unpaired) -> None:
        """Notes whether tissue and pose are present together, in a picture that continues the chain of those that
        showed the calibration; where they are shown not to be, what was shown is discarded."""
        blind = any(
            check.fault.kind in (Kind.SIGHT, Kind.DEVICE) and check.verdict is not VerdictKind.OK
            for check in self._detected()
        )
        linked = self._picture_chain.linked or self._frozen.repeats
        if self._evidence.status.verified_ns is not None:
            self._broke = not linked
        if (blind and self._sighted_ns is not None) or (not linked and self._sighted_ns is None):
            self._unverify()
        elif not blind and linked and isinstance(item, StampedPair) and not self._frozen.repeats:
            self._sighted_ns = item.frame.stamp.t_ns

    def _unverify(self) -> None:
        self._evidence.lose_sight()
        self._sighted_ns = None

    def _checks(self) -> tuple[Check, ...]:
        return (*self._believed(self._evidence.checks()), *self._detected())

    def _believed(self, checks: tuple[Check, ...]) -> tuple[Check, ...]:
        """Returns the checks, those of a scale not verified while it is open whether the scanner averages. Behind one
        that does, what leaves the plane looks shorter than it is, so motion shows no scale, neither right nor wrong."""
        if self._averaging.known:
            return checks
        return tuple(
            replace(check, verdict=VerdictKind.NOT_VERIFIED) if check.fault is Fault.SCALE else check
            for check in checks
        )

    @property
    def _status(self) -> VerificationStatus:
        """Returns the verification status; nothing is verified while motion can show no scale."""
        status = self._evidence.status
        return status if self._averaging.known else replace(status, verified_ns=None, expires_ns=None)

    def _judged(self, t_ns: int, checks: tuple[Check, ...]) -> Verdict:
        return self._with_point_error(judge(t_ns, checks, self._status, self._broke))

    def _with_point_error(self, verdict: Verdict) -> Verdict:
        """Returns the verdict with the error of a point as of now."""
        point = self._evidence.points.now(verdict.t_ns, self._status)
        verdict = bounded(verdict, point, self._limits.point_mm)
        self._judgement.note(verdict)
        return verdict

    def _detected(self) -> tuple[Check, ...]:
        return tuple(check for detector in self._detectors for check in detector.checks())

    def _lose_sight(self, t_ns: int) -> None:
        """Ends the chain, as a probe that has rested for long may go on anywhere."""
        self._tracker.restart()
        self._averaging.restart()
        self._poses_before.clear()
        for detector in self._detectors:
            detector.pause(t_ns)

    def _watch(self, item: StampedPair | Unpaired) -> None:
        item = self._undone(item)
        frame = item.frame
        self._tracker.may = self._evidence.window.registered_as
        tracked = self._tracker.step(frame.image, frame.sequence)
        seen = observed(item.frame, item.matrix if isinstance(item, StampedPair) else None, tracked, self._reference)
        motion = self._analyse(item, tracked) if isinstance(item, StampedPair) else None
        if isinstance(item, StampedPair):
            self._evidence.stationary.step(frame.stamp.t_ns, item.matrix, self._tracker)
            self._evidence.points.pace.step(frame.stamp.t_ns, item.matrix)
        if self._seen(seen):
            self._tracker.renew_keyframe()
            self._evidence.restart()
        elif motion is not None and motion.usable and self._tracker.settled:
            water = self._no_picture.texture is not None and self._no_picture.texture.water
            self._evidence.window.add(replace(motion, tissue=None) if water else motion)

    def _undone(self, item: StampedPair | Unpaired) -> StampedPair | Unpaired:
        """Returns the same with a picture that holds nothing of those before it. Where the share changes, what was made
        of earlier pictures says nothing and is discarded."""
        frame = item.frame
        if isinstance(item, StampedPair):
            self._poses_before.append(item.matrix)
        else:
            self._poses_before.clear()
        hurries = len(self._poses_before) == _QUICK_PICTURES and quick(self._reference, self._poses_before)
        image, changed = self._averaging.step(frame.image, frame.sequence, self._tracker.mask, hurries)
        if changed:
            self._tracker.restart()
            self._evidence.restart()
        return item if image is frame.image else replace(item, frame=replace(frame, image=image))

    def _analyse(self, pair: StampedPair, tracked: Tracked) -> Motion:
        """Sorts the motion and lets it steer the keyframe.

        The Real-time Tracker may have made the picture before its keyframe, so the pose of that one is kept as well."""
        own = (pair.frame.sequence, pair.matrix)
        keyframe = next((pose for pose in self._known_poses if pose[0] == tracked.keyframe), own)
        motion = self.motion = analyse(tracked, pair, self._reference, keyframe[1])
        renew = tracked.registration is not None and wants_keyframe(motion, tracked.registration.overlap)
        if renew:
            self._tracker.renew_keyframe()
        self._known_poses = (own if renew else keyframe, own)
        return motion

    def _seen(self, seen: Observation) -> bool:
        """Gives the picture to each detector; returns whether one of them has seen the geometry change."""
        changed = [detector.see(seen) for detector in self._detectors]
        return any(changed)

    def _solve(self, t_ns: int, paired: bool) -> None:
        begun_ns = self._schedule.step(self._evidence, t_ns, paired)
        if begun_ns is not None:
            for detector in self._detectors:
                detector.on_verified(self._evidence.shows, begun_ns)

    def _wrong_size(self, width: int, height: int) -> Check:
        wanted = self._reference.image_size_px
        change = 100.0 * (width / wanted[0] - 1) or 100.0 * (height / wanted[1] - 1)
        return Check("picture-size", Fault.SCALE, change, 0.0, "%", _SIZE_PERCENT, VerdictKind.FAULT)
