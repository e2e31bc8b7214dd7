"""Small recordings for tests, and where the real ones are."""

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from probewatch.drivers.recordings.metaimage_writing import SequenceItem
from probewatch.drivers.samples import Frame, GreyImage, Matrix4, Pose

SIZE_PX = (7, 5)
REPLAYED_PX = (48, 32)
PERIOD_NS = 80_000_000
START_NS = 2_588_141_729_000
NWIRE_IMAGE_TO_PROBE = np.array(
    [
        [-0.0094, -0.0739, -0.0028, -103.5322],
        [0.0774, -0.0076, -0.0049, -43.1227],
        [0.0046, -0.0032, 0.0760, -93.3],
        [0, 0, 0, 1],
    ]
)
"""Pixel → mm in the marker body's frame, as published with the recording NwirePhantomFreehand."""


def plus_file(name: str) -> Path:
    """A real recording of the PLUS toolkit; skips the test, saying so, where the data are absent."""
    default = Path(__file__).parents[3] / "shared" / "data" / "plus"
    path = Path(os.environ.get("PROBEWATCH_PLUS_DATA", default)) / name
    if not path.exists():
        pytest.skip(f"no PLUS test data: {path} is absent (set PROBEWATCH_PLUS_DATA)")
    return path


def with_late_poses(samples: Iterable[Frame | Pose], late_s: float) -> list[Frame | Pose]:
    """The samples in order of their stamps, those of the poses later by so much."""

    def late(pose: Pose) -> Pose:
        return replace(pose, stamp=replace(pose.stamp, t_ns=pose.stamp.t_ns + round(late_s * 1e9)))

    stamped = [late(sample) if isinstance(sample, Pose) else sample for sample in samples]
    return sorted(stamped, key=lambda sample: sample.stamp.t_ns)


def picture(index: int, size_px: tuple[int, int] = SIZE_PX) -> GreyImage:
    """Every pixel differs from its neighbours, so no flip goes unseen."""
    width, height = size_px
    return np.random.default_rng(index).integers(0, 256, (height, width), dtype=np.uint8)


def turn(angle_rad: float, x_mm: float = 0.0, y_mm: float = 0.0) -> Matrix4:
    """(4, 4) rotation about z and a translation."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin, 0, x_mm], [sin, cos, 0, y_mm], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def items(count: int = 4, size_px: tuple[int, int] = SIZE_PX) -> list[SequenceItem]:
    """Frames 80 ms apart, each with a probe pose and a reference pose."""
    return [
        SequenceItem(
            START_NS + index * PERIOD_NS,
            picture(index, size_px),
            {"ProbeToTracker": turn(0.1 * index, 10.0 * index, 2), "ReferenceToTracker": turn(0.5, 0, 3)},
            sequence=100 + 2 * index,
        )
        for index in range(count)
    ]


def in_vivo_file(name: str) -> Path:
    """A real recording of a liver with a convex probe, from beside the PLUS data; skips the test where it is absent."""
    default = Path(__file__).parents[3] / "shared" / "data" / "plus"
    path = Path(os.environ.get("PROBEWATCH_PLUS_DATA", default)).parent / "in-vivo" / name
    if not path.exists():
        pytest.skip(f"no in-vivo test data: {path} is absent (set PROBEWATCH_PLUS_DATA to the folder beside it)")
    return path
