"""Tracks what a live scan has seen so far: takes samples of the feed, and gives the running calibration and small
pictures to review.

Not safe for two threads at once; the session has the lock.
"""

import hashlib
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from probewatch.appliance.core.path.latency import Latency
from probewatch.appliance.crosswire.crossing import ROUGH_SCALE_MM_PER_PX, Crossing
from probewatch.appliance.crosswire.offset import ScanRefused, renewed
from probewatch.appliance.crosswire.running import Refusal, Running, RunningCalibration
from probewatch.appliance.crosswire.scan import CrosswireScan, Look, View
from probewatch.appliance.types import PARAMETERS, Calibration, Vector
from probewatch.drivers.samples import Frame, GreyImage, Pose, PoseStatus
from probewatch.tools.recalibration.steps import CheckStep, Estimate, Sound
from probewatch.tools.shared.crosswire_review import compared, difference_in_sigmas

_REMEMBERED = 40
"""Pictures that a view may still be cut out of: .7 s at 60 Hz. A view is settled .25 s after its passage."""
_HALF_PX = 48
"""Half the side, px, of the cut-out of a view that is kept for the review: two spots of a crossing and some margin."""
_UNSEEN_NS = 1_000_000_000
"""Nanoseconds without a good pose before it is reported: turning the probe away for a second is part of a scan. Less
reports trouble where there is none.
"""


@dataclass(slots=True)
class Scanned:
    """Holds the state of one scan. reference: the calibration in force when the scan began, None where there is none.
    wanted: whole, all eight parameters; zeta, the last of them alone, the others as the reference has them.

    sound, latency, estimate: the results of the steps before: the effect of the water, the latency of the tracker where
    it was measured, and what motion without a phantom showed of the calibration. check: that of the step after, None
    before it.

    thumbnails: for each view, what was around the crossing. last: what the newest picture showed. lost: the number of
    samples that the feed did not deliver.
    """

    reference: Calibration | None
    wanted: str
    scan: CrosswireScan
    scale_mm_per_px: tuple[float, float] = ROUGH_SCALE_MM_PER_PX
    sound: Sound = field(default_factory=lambda: Sound(None))
    latency: Latency | None = None
    estimate: Estimate | None = None
    check: CheckStep | None = None
    running: RunningCalibration | None = None
    thumbnails: list[GreyImage] = field(default_factory=list)
    last: Look | None = None
    lost: int = 0
    pose_trouble: str = ""
    _looks: deque[Look] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))
    _recent: deque[Frame] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))
    _seen_ns: int | None = None
    _state: Running | None = None
    _stale: bool = True

    @classmethod
    def begun(
        cls,
        reference: Calibration | None,
        wanted: str,
        sound: Sound | None = None,
        latency: Latency | None = None,
        estimate: Estimate | None = None,
    ) -> "Scanned":
        """Returns a scan that has seen nothing yet."""
        scale = ROUGH_SCALE_MM_PER_PX
        if reference is not None:
            lateral, axial = reference.scale_mm_per_px
            scale = float(lateral), float(axial)
        scan = CrosswireScan(0.0 if latency is None else 1e3 * latency.value_s, scale)
        return cls(reference, wanted, scan, scale, sound or Sound(None), latency, estimate)

    def take(self, sample: Frame | Pose, checking: bool = False) -> None:
        """Takes the next sample of the feed. checking: whether it is of the other crossing."""
        if isinstance(sample, Frame):
            self._recent.append(sample)
        else:
            self._note_pose(sample)
        if checking and self.check is not None:
            self.check.scan.step(sample)
        else:
            for view in self.scan.step(sample):
                self.settle(view)
        last = self.last = (self.check if checking and self.check is not None else self).scan.last
        if last is not None and (not self._looks or self._looks[-1] is not last):
            self._looks.append(last)

    def settle(self, view: View) -> None:
        """Adds the view of a passage of the scan, which is as good as over."""
        self._running().add(view)
        self._stale = True
        self.thumbnails.append(self._cut(view.t_ns, view.centre_px))

    def look_at(self, t_ns: int) -> dict[str, Any] | None:
        """Returns what was found in the picture of that time, None where it was not one of the last."""
        return next((look_fields(look) for look in self._looks if look.t_ns == t_ns), None)

    def strike(self, index: int, struck: bool) -> None:
        """Leaves a view out, or takes it back. Raises IndexError."""
        if not 0 <= index < len(self.thumbnails):
            raise IndexError(f"there is no view {index + 1}")
        self._running().strike(index, struck)
        self._stale = True

    def correct(self, index: int, centre_px: tuple[float, float]) -> None:
        """Puts the crossing of a view elsewhere. Raises IndexError, ValueError."""
        if not 0 <= index < len(self.thumbnails):
            raise IndexError(f"there is no view {index + 1}")
        self._running().correct(index, centre_px)
        self._stale = True

    @property
    def sha256(self) -> str:
        """Returns the SHA-256 of all views, struck out or not: time, place in the picture, pose."""
        digest = hashlib.sha256()
        for view in () if self.running is None else self.running.views:
            digest.update(f"{view.t_ns} {view.centre_px.tolist()} {view.matrix.tolist()}\n".encode())
        return digest.hexdigest()

    @property
    def state(self) -> Running | None:
        """Returns the solution of the views, None before the first; solves again only where something has changed."""
        if self._stale and self.running is not None:
            self._state, self._stale = self.running.state(self.scan.misses_mm), False
        return self._state

    def refusals(self) -> tuple[Refusal, ...]:
        """Returns what stands against taking the calibration now."""
        state = self.state
        if state is None:
            return ()
        if self.wanted == "whole":
            return state.refusals
        return tuple(one for one in state.refusals if one.parameter in ("", "rotation-lateral", "rotation-axial"))

    def begin_check(self, known_mm: Vector | None) -> None:
        """Begins the check at the crossing elsewhere. Raises ScanRefused where there is nothing to check yet."""
        self._in_water()
        assert self.state is not None
        assert self.state.whole is not None
        stated_s = 0.0 if self.latency is None else self.latency.value_s
        self.check = CheckStep(1e3 * (stated_s + self.state.whole.latency_s), self.scale_mm_per_px, known_mm)

    def checked(self) -> dict[str, Any] | None:
        """Returns how far the calibration of these views is off at the second crossing; None if it was not scanned."""
        state = self.state
        if self.check is None or state is None or state.whole is None or self.refusals():
            return None
        return self.check.fields(self._in_water(), state.whole.crossing_mm)

    def check_record(self) -> str:
        """Returns the record of the check for the provenance. Raises ScanRefused where the other point was not scanned,
        or does not pass.
        """
        found = self.checked()
        if found is None or found["why"] or self.check is None or self.state is None or self.state.whole is None:
            what = "it was not made" if found is None else str(found["why"])
            raise ScanRefused(what, "check at another point", "Make it, or say why it cannot be made")
        return self.check.record(self._in_water(), self.state.whole.crossing_mm)

    def calibration(self) -> Calibration:
        """Returns the calibration to be taken, as in tissue. Raises ScanRefused where the scan does not support it."""
        return self.sound.for_tissue(self._in_water())

    def _in_water(self) -> Calibration:
        state = self.state
        found = self.refusals()
        if state is None or state.whole is None or found:
            what, remedy = (found[0].what, found[0].remedy) if found else ("no view of the crossing yet", "Scan it")
            raise ScanRefused(what, "cross-wire scan", remedy)
        if self.wanted == "whole":
            whole = state.whole.calibration
            face_mm = None if self.reference is None else self.reference.face_radius_mm
            return replace(whole, face_radius_mm=face_mm)
        if self.reference is None or state.closed is None:
            raise ScanRefused("ζ alone needs a calibration in force", "cross-wire scan", "Solve all of it")
        return renewed(self.reference, state.closed)

    def _running(self) -> RunningCalibration:
        if self.running is None:
            assert self.scan.size_px is not None
            size_px = self.scan.size_px
            if self.latency is None:
                self.running = RunningCalibration(size_px, self.reference)
            else:
                self.running = RunningCalibration(size_px, self.reference, latency_sigma_s=self.latency.sigma_s)
        return self.running

    def _note_pose(self, pose: Pose) -> None:
        t_ns = pose.stamp.t_ns
        if pose.status is PoseStatus.OK or self._seen_ns is None:
            self._seen_ns = t_ns
            if pose.status is PoseStatus.OK:
                self.pose_trouble = ""
        elif t_ns - self._seen_ns > _UNSEEN_NS:
            self.pose_trouble = f"the tracker does not see the probe: {pose.reason or pose.status.value}"

    def _cut(self, t_ns: int, centre_px: Any) -> GreyImage:
        frame = min(self._recent, key=lambda one: abs(one.stamp.t_ns - t_ns))
        column, row = (round(float(one)) for one in centre_px)
        padded = np.pad(frame.image, _HALF_PX)
        return padded[row : row + 2 * _HALF_PX, column : column + 2 * _HALF_PX].copy()


def look_fields(look: Look | None) -> dict[str, Any] | None:
    """Returns what one picture showed, in plain numbers."""
    if look is None:
        return None
    found = look.found
    if isinstance(found, Crossing):
        return {
            "t_ns": look.t_ns,
            "centre_px": [round(float(one), 2) for one in found.centre_px],
            "confidence": round(found.confidence, 2),
            "spots_px": [],
            "why": "",
        }
    spots = [[round(float(one), 1) for one in spot] for spot in found.spots_px]
    return {"t_ns": look.t_ns, "centre_px": None, "confidence": 0.0, "spots_px": spots, "why": found.reason.value}


def counts_of(scanned: Scanned) -> dict[str, Any]:
    """Returns the fields that change with every picture."""
    scan = scanned.scan
    return {
        "pictures": scan.pictures,
        "sightings": scan.sightings,
        "look": look_fields(scanned.last),
        "size_px": scan.size_px,
        "lost": scanned.lost,
        "missed": [{"why": why, "pictures": number} for why, number in scan.refused.most_common(4)],
    }


def state_fields(scanned: Scanned) -> dict[str, Any]:
    """Returns the running result in plain numbers, None where nothing is known."""
    state = scanned.state
    fields: dict[str, Any] = {
        "wanted": scanned.wanted,
        "refusals": [
            {"reason": one.reason.value, "what": one.what, "remedy": one.remedy} for one in scanned.refusals()
        ],
        "views": [],
        "result": None,
        "coverage": None,
        "compared": [],
        "check": None,
        "sound": scanned.sound.text,
        "latency_measured_ms": None if scanned.latency is None else 1e3 * scanned.latency.value_s,
    }
    if state is None or scanned.running is None:
        return fields
    residual = None if state.whole is None else state.whole.residual_mm
    # The residual has one row for each view that is not struck out, in their order.
    kept_of = iter(range(len(state.used)))
    views = []
    for index, view in enumerate(scanned.running.views):
        struck = index in state.struck
        mine = None if struck or residual is None else next(kept_of)
        off = None if mine is None or residual is None else round(float(np.linalg.norm(residual[mine])), 2)
        cloud = state.cloud_mm[index]
        views.append(
            {
                "struck": struck,
                "used": bool(state.used[index]),
                "off_mm": off,
                "confidence": round(view.confidence, 2),
                "centre_px": [round(float(one), 1) for one in view.centre_px],
                "cloud_mm": None if np.isnan(cloud).any() else [round(float(one), 3) for one in cloud],
            }
        )
    covered = state.coverage
    return fields | {
        "views": views,
        "coverage": {
            "bins": covered.bins.tolist(),
            "places": covered.places.tolist(),
            "spread_deg": [round(float(one), 1) for one in covered.spread_deg],
            "next": covered.next_motion,
        },
        "result": _result_fields(state, scanned.reference),
        "compared": [] if state.whole is None else compared(state.whole, _others(scanned, state.whole.calibration)),
        "check": scanned.checked(),
    }


def _others(scanned: Scanned, new: Calibration) -> dict[str, tuple[Vector, Vector]]:
    """Returns how far other calibrations are from the new one."""
    if scanned.reference is None:
        return {}
    others = {"in force": difference_in_sigmas(new, scanned.reference)}
    if scanned.estimate is not None:
        others["motion alone"] = scanned.estimate.less(new, scanned.reference)
    return others


def _result_fields(state: Running, reference: Calibration | None) -> dict[str, Any] | None:
    whole, closed = state.whole, state.closed
    if whole is None:
        return None
    return {
        "zeta_mm": state.zeta_mm,
        "zeta_sigma_mm": state.zeta_sigma_mm,
        "zeta_before_mm": None if reference is None else float(reference.offset_mm[2]),
        "closed_mm": None if closed is None else closed.zeta_mm,
        "closed_sigma_mm": None if closed is None else _finite(closed.zeta_sigma_mm),
        "localisation_mm": whole.localisation_mm,
        "expected_mm": _finite(whole.expected_mm),
        "latency_ms": 1e3 * whole.latency_s,
        "latency_sigma_ms": 1e3 * whole.latency_sigma_s,
        "sigma": {name: float(sigma) for name, sigma in zip(PARAMETERS, whole.sigma, strict=True)},
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def marked(calibration: Calibration, simulated: bool) -> Calibration:
    """Returns the calibration with the mark of whether it was made from simulated pictures."""
    return replace(calibration, simulated=simulated)
