"""Metal as the trackers' twins have it, beside a sweep: another world than that of `probewatch study`, and through the
whole line. What is claimed of it, and what is not.
"""

from dataclasses import replace

import pytest

from probewatch.appliance.core.line import Line
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.appliance.types import Fault, Verdict, VerdictKind
from probewatch.drivers.samples import Pose
from probewatch.drivers.twins.scene.metal import near_metal
from probewatch.drivers.twins.scene.world import WorldSettings
from tests.support.sessions import ORIGIN_NS, SWEPT, kept, session

THOROUGH, SLOW = pytest.mark.thorough, pytest.mark.slow
SMALL = WorldSettings(width_px=400, height_px=300, scale_mm_per_px=(0.09, 0.08))


def verdicts(program: str, displaced_mm: float, at_s: float, duration_s: float) -> list[Verdict]:
    """Of the line, from at_s on, when the metal begins to come. Poses at the 40 Hz of an Aurora."""
    world = kept(3, program, settings=SMALL)
    before, origin_ns = world.probe_pose(at_s), ORIGIN_NS + round(at_s * 1e9)
    line = Line(calibration_from_image_to_probe(world.image_to_probe, (400, 300)), SWEPT)
    said: list[Verdict] = []
    for sample in session(world, duration_s, pose_hz=40.0):
        since_s = (sample.stamp.t_ns - origin_ns) / 1e9
        if isinstance(sample, Pose) and sample.matrix is not None and since_s >= 0:
            sample = replace(sample, matrix=near_metal(sample.matrix, before, since_s, displaced_mm))  # noqa: PLW2901
        said += line.step(sample)
    return [verdict for verdict in said if verdict.t_ns >= origin_ns]


@pytest.mark.parametrize(
    ("displaced_mm", "named"),
    [
        pytest.param(1.0, set(), marks=THOROUGH),
        pytest.param(3.0, set(), marks=SLOW),
        pytest.param(6.0, {Fault.FIELD_DISTORTION}, marks=THOROUGH),
    ],
)
def test_metal_that_comes_while_the_probe_sweeps_ends_the_ok_and_a_strong_one_is_named(
    displaced_mm: float, named: set[Fault]
) -> None:
    """The OK is gone within three seconds of it and does not come back; `offset` may be named for moments before."""
    said, at_ns = verdicts("sweep", displaced_mm, 10.0, 18.0), ORIGIN_NS + 10 * 10**9
    assert said[0].kind is VerdictKind.OK
    assert {verdict.fault for verdict in said} - {None, Fault.OFFSET} == named
    assert all(verdict.kind is not VerdictKind.OK for verdict in said if verdict.t_ns > at_ns + 3 * 10**9)


@SLOW
@pytest.mark.parametrize(("displaced_mm", "named"), [(1.0, False), (3.0, False), (6.0, True)])
def test_what_a_sweep_makes_of_metal_that_has_lain_there_for_as_long_as_evidence_is_kept(
    displaced_mm: float, named: bool
) -> None:
    settled_ns = ORIGIN_NS + 22 * 10**9
    found = {verdict.kind for verdict in verdicts("sweep", displaced_mm, 10.0, 36.0) if verdict.t_ns > settled_ns}
    assert (VerdictKind.FAULT in found) is named
    assert VerdictKind.OK not in found


@SLOW
@pytest.mark.parametrize("program", ["still", "elevational", "rotation"])
def test_motion_that_need_not_show_the_distortion_verifies_nothing_either(program: str) -> None:
    found = {verdict.kind for verdict in verdicts(program, 12.0, 3.0, 15.0)}
    assert VerdictKind.NOT_VERIFIED in found
    assert VerdictKind.OK not in found
