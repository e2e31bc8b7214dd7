"""Poses in cm are asked about: they say a tenth of what the picture moves."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.line import Line
from probewatch.appliance.limits import Limits
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.appliance.supervision.timeline import Judging
from probewatch.drivers.samples import Pose, Sample
from probewatch.drivers.twins.faults import Schedule
from probewatch.drivers.twins.scene.world import WorldSettings
from probewatch.tools.shared.recording_run import run
from tests.support.sessions import ORIGIN_NS, kept, session

SMALL = WorldSettings(width_px=400, height_px=300, scale_mm_per_px=(0.09, 0.08))
DURATION_S = 6.0


class Scaled:
    """A recording whose poses are in another unit."""

    start_ns = ORIGIN_NS
    overlap_ns = ORIGIN_NS, ORIGIN_NS + round(DURATION_S * 1e9)
    left_out: dict[str, int] = {}  # noqa: RUF012
    poses_left_out: dict[str, int] = {}  # noqa: RUF012

    def __init__(self, per_mm: float) -> None:
        self._per_mm = np.diag([per_mm, per_mm, per_mm, 1.0])

    def samples(self) -> Iterator[Sample]:
        for sample in session(kept(3, settings=SMALL), DURATION_S):
            if isinstance(sample, Pose) and sample.matrix is not None:
                moved = self._per_mm @ sample.matrix
                moved[:3, :3] = sample.matrix[:3, :3]
                yield replace(sample, matrix=moved)
            else:
                yield sample


@pytest.mark.thorough
@pytest.mark.parametrize(("per_mm", "asked"), [(1.0, False), (0.1, True)])
def test_poses_in_cm_are_asked_about(per_mm: float, asked: bool) -> None:
    reference = calibration_from_image_to_probe(kept(3, settings=SMALL).image_to_probe, (400, 300))
    report, _ = run(Scaled(per_mm), Line(reference, Limits()), Schedule(()), Judging())
    question = "; the picture moves 10 times as far as the poses say: are they in mm, or in cm?"
    assert report.verdict.reason.endswith(question) is asked
