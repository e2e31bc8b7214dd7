"""Provides the samples of a cross-wire scan, from a simulation or a recording."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.appliance.types import Calibration
from probewatch.drivers.errors import RecordingError
from probewatch.drivers.recordings.replay import open_recording
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Sample, Stamp
from probewatch.drivers.twins.scene.world import World
from probewatch.tools.shared.left_out import tell_left_out

_FRAME_NS = 50_000_000
_POSES_PER_FRAME = 3
"""The simulation has 20 pictures a second, which are drawn in less time than 30, and the 60 poses a second of a Polaris
Spectra."""
_ERR_NS = 100_000
"""ns, error bound of every stamp: as small as a simulated device allows, so that an uncertainty of time is not mistaken
for one of ζ."""
_SPOILED_MM = 4.0
"""mm, the shipped limit of an offset: the largest error that the service lets pass, and clearly more than the .5 mm
sigma of a scan."""


@dataclass(frozen=True, slots=True)
class ScanInput:
    """Holds the `total` samples of a scan, in time order. `size_px` is (width, height) of the pictures, `name` is
    written to the provenance, `file` is None for a simulation.
    """

    samples: Iterator[Sample]
    total: int
    size_px: tuple[int, int]
    name: str
    file: Path | None = None


def simulated(seed: int, duration_s: float, program: str = "freehand") -> ScanInput:
    """Simulates a hand that tilts the probe over a cross-wire in water, faster than real time. With the program
    "guided" the crossing appears in all parts of the picture.
    """
    world = World(seed, program, "cross-wire")
    frames = round(duration_s * 1e9 / _FRAME_NS)
    size_px = world.settings.width_px, world.settings.height_px
    return ScanInput(
        _simulated(world, frames), frames * (1 + _POSES_PER_FRAME), size_px, f"simulated world, seed {seed}"
    )


def simulated_reference() -> Calibration:
    """Returns the calibration of the simulated probe with an error of 4 mm in ζ, to try the command."""
    world = World()
    size_px = world.settings.width_px, world.settings.height_px
    calibration = calibration_from_image_to_probe(world.image_to_probe, size_px)
    offset_mm = calibration.offset_mm + np.array([0, 0, _SPOILED_MM])
    return replace(calibration, offset_mm=offset_mm, simulated=True)


def recorded(path: Path, probe: str | None, reference: str | None, orientation: str | None) -> ScanInput:
    """Opens a PLUS sequence. Raises RecordingError."""
    session = open_recording(path, probe=probe, reference=reference, orientation=orientation)
    if session.size_px is None:
        raise RecordingError("holds no pictures", str(path), "Give a recording of the cross-wire with its pictures")
    tell_left_out(session)
    return ScanInput(session.samples(), len(session), session.size_px, str(path.absolute()), path)


def _simulated(world: World, frames: int) -> Iterator[Sample]:
    for index in range(frames):
        frame_ns = index * _FRAME_NS
        yield Frame(Stamp(frame_ns, _ERR_NS), index, world.frame(frame_ns / 1e9, index))
        for half in range(_POSES_PER_FRAME):
            pose_ns = frame_ns + (2 * half + 1) * _FRAME_NS // (2 * _POSES_PER_FRAME)
            number = index * _POSES_PER_FRAME + half
            matrix = world.measured_pose(pose_ns / 1e9, number)
            yield Pose(Stamp(pose_ns, _ERR_NS), number, matrix, world.settings.tracker_sd_mm, PoseStatus.OK)
