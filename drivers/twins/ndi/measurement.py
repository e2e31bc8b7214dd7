"""Computes what a simulated tracker measures of one tool at one moment, and how its faults show in it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from probewatch.drivers.samples import Matrix4
from probewatch.drivers.trackers.marker_geometry import Points, marker_geometry
from probewatch.drivers.trackers.ndi.replies import MOST_MARKERS, Markers, Position, ToolInformation, Transform
from probewatch.drivers.twins.faults import pose_time_s, spoil_pose, spoil_witness
from probewatch.drivers.twins.scene.metal import near_metal
from probewatch.drivers.twins.tool_motion import PROBE, PoseAt, on_probe

TOOL_FAULTS = (
    "bend-marker",
    "bend-witness",
    "em-distortion",
    "interference",
    "latency",
    "marker-drift",
    "metal",
    "missing",
    "out-of-volume",
    "partial",
    "slide-marker",
    "sparse-poses",
    "witness-missing",
)
"""Names of the faults of tools. bend-witness and witness-missing strike further tools, which sit on the probe.
sparse-poses: `missing` but for one measurement in ONE_IN."""

ONE_IN = 12
"""Measurements per pose of sparse-poses: at 20 Hz one in .6 s, further apart than the pairing of pictures bridges (.25
s)."""

_OUTSIDE, _PARTLY_OUTSIDE, _INTERFERENCE = 0x0040, 0x0080, 0x0200
_NIBBLE_USED, _NIBBLE_USED_OUTSIDE, _NIBBLE_OUTSIDE = 3, 4, 5
"""Combined API: bits of the port status, and states of a marker in the tool information."""

_DRIFTING_MARKER, _DRIFT_MM_PER_S, _FURTHEST_DRIFT_MM = 2, 2.0, 5.0
"""Index, mm/s and mm. The marker with this index creeps along x, so that checks see the misfit grow; 5 mm leave an RMS
beyond 1 mm (tests/drivers/trackers/ndi/test_models.py), past the limit of 0.75."""

_DISTORTION_S, _DISTORTION_MM, _DISTORTION_INDICATOR = 2.0, (4.0, -2.5, 1.0), 2.5
"""Seconds, mm and indicator value. In two seconds the pose is off by nearly 5 mm, oblique to all axes, and the
indicator passes the limit of 1.5 before the device itself complains (tests/drivers/trackers/ndi/test_models.py). The
course is made up and not that of an Aurora."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """Holds what the tracker sees of one tool. transform: None where the tool is not seen. status: bits for the port
    status. positions_mm, outside: (n,) markers.
    """

    transform: Transform | None
    status: int = 0
    positions_mm: tuple[Position, ...] = ()
    outside: tuple[bool, ...] = ()

    @property
    def out_of_volume(self) -> bool:
        return bool(self.status & _OUTSIDE)

    @property
    def partly_outside(self) -> bool:
        return bool(self.status & _PARTLY_OUTSIDE)

    @property
    def disturbed(self) -> bool:
        return bool(self.status & _INTERFERENCE)

    def markers(self, everywhere: bool) -> Markers:
        """Returns the markers for TX and BX. everywhere: whether positions outside the volume are wanted as well."""
        pairs = zip(self.positions_mm, self.outside, strict=True)
        return Markers(self.outside, tuple(place if everywhere or not out else None for place, out in pairs))

    def information(self) -> ToolInformation:
        """Returns the tool information for TX and BX."""
        used = _NIBBLE_OUTSIDE if self.transform is None else _NIBBLE_USED_OUTSIDE
        nibbles = [used if out else _NIBBLE_USED for out in self.outside]
        return ToolInformation(0, tuple(nibbles + [0] * (MOST_MARKERS - len(nibbles))))


def faults_of(faults: Mapping[str, float], count: int) -> Mapping[str, float]:
    """Returns the faults that act on the count-th measurement of the device; name → second since which it has been
    on.
    """
    hidden = "sparse-poses" in faults and count % ONE_IN != 0
    return {**faults, "missing": faults["sparse-poses"]} if hidden else faults


def measure(
    pose_at: PoseAt, tool: str, definition: Points, fit_mm: float, t_s: float, number: int, faults: Mapping[str, float]
) -> Measurement:
    """Measures the tool at world time t_s. definition: (n, 3) mm, n 0 for a sensor without markers.

    fit_mm: error field when all is well. faults: name → world second since which it has been on; those of the probe's
    marker body, and the disturbances, act on the probe alone.
    """
    if on_probe(tool):
        return _second(pose_at, tool, definition, fit_mm, t_s, number, faults)
    active = faults if tool == PROBE else {}
    true = pose_at(tool, pose_time_s(t_s, active), number)
    if true is None or "missing" in active:
        return Measurement(None)
    pose = spoil_pose(true, active)
    if "metal" in active:
        pose = _near_metal(pose, pose_at, t_s, number, active["metal"])
    outside = tuple("out-of-volume" in active or ("partial" in active and i == 0) for i in range(len(definition)))
    status = _OUTSIDE * ("out-of-volume" in active) + _PARTLY_OUTSIDE * ("partial" in active)
    if "em-distortion" in active:
        return _distorted(pose, fit_mm, (t_s - active["em-distortion"]) / _DISTORTION_S, status)
    status += _INTERFERENCE * ("interference" in active)
    places = definition.copy()
    if "marker-drift" in active and len(places) > _DRIFTING_MARKER:
        drift_mm = _DRIFT_MM_PER_S * (t_s - active["marker-drift"])
        places[_DRIFTING_MARKER, 0] += np.clip(drift_mm, 0.0, _FURTHEST_DRIFT_MM)
    return _fitted(pose, places, definition, fit_mm, status, outside)


def _second(
    pose_at: PoseAt, tool: str, definition: Points, fit_mm: float, t_s: float, number: int, faults: Mapping[str, float]
) -> Measurement:
    """Measures a second body on the probe; the tracker is late with both."""
    true = pose_at(tool, pose_time_s(t_s, faults), number)
    if true is None or "witness-missing" in faults:
        return Measurement(None)
    return _fitted(spoil_witness(true, faults), definition, definition, fit_mm, 0, (False,) * len(definition))


def _near_metal(pose: Matrix4, pose_at: PoseAt, t_s: float, number: int, since_s: float) -> Matrix4:
    """Applies metal that the indicator value does not show."""
    before = pose_at(PROBE, since_s, number)
    return pose if before is None else near_metal(pose, before, t_s - since_s)


def _fitted(
    pose: Matrix4, places: Points, definition: Points, fit_mm: float, status: int, outside: tuple[bool, ...]
) -> Measurement:
    """Fits the definition to the markers where the tracker finds them, as the tracker does."""
    measured = places @ pose[:3, :3].T + pose[:3, 3]
    moved = not np.array_equal(places, definition)
    fitted = marker_geometry(measured, definition) if moved else None
    if fitted is not None:
        pose, fit_mm = fitted.pose, float(np.hypot(fit_mm, fitted.rms_mm))
    positions = tuple((float(x), float(y), float(z)) for x, y, z in measured.astype(np.float32))
    return Measurement(transform_of(pose, fit_mm), status, positions, outside)


def _distorted(pose: Matrix4, fit_mm: float, share: float, status: int) -> Measurement:
    """Applies metal near the field: the pose creeps away while the indicator value rises; in the end the device
    notices.
    """
    share = min(max(share, 0.0), 1.0)
    bent = pose.copy()
    bent[:3, 3] += share * np.array(_DISTORTION_MM)
    return Measurement(
        transform_of(bent, fit_mm + share * _DISTORTION_INDICATOR), status | (share == 1) * _INTERFERENCE
    )


def transform_of(matrix: Matrix4, error: float) -> Transform:
    """Returns a pose in the single precision of the protocol."""
    x, y, z, w = Rotation.from_matrix(matrix[:3, :3]).as_quat().astype(np.float32).tolist()
    tx, ty, tz = matrix[:3, 3].astype(np.float32).tolist()
    return Transform((w, x, y, z), (tx, ty, tz), float(np.float32(error)))
