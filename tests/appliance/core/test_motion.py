"""The Motion Analyzer: what each program of the hand is called, and when the keyframe changes."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

from probewatch.appliance.core.line import Line
from probewatch.appliance.core.motion import analyse, predicted_motion, quick, sort_motion, wants_keyframe
from probewatch.appliance.core.registration.keyframe import Registration
from probewatch.appliance.core.registration.realtime_tracker import Tracked
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Motion, MotionKind, StampedPair
from probewatch.drivers.rigid import inverse, rigid, rotation_from_vector, vector_from_rotation
from probewatch.drivers.samples import Frame, Matrix4, Stamp
from probewatch.drivers.twins.scene.trajectory import PROGRAMS
from tests.drivers.test_rigid import poses
from tests.support.motions import TRUTH
from tests.support.rendered import SMALL
from tests.support.sessions import kept, session

X = rigid(TRUTH.rotation, TRUTH.offset_mm)
HOME = np.eye(4)
STILL, TRANSLATION, PLANAR = MotionKind.STILL, MotionKind.TRANSLATION, MotionKind.PLANAR
OUT_OF_PLANE, TOO_FAST, DECORRELATED = MotionKind.OUT_OF_PLANE, MotionKind.TOO_FAST, MotionKind.DECORRELATED


def sensor(picture_pose: Matrix4) -> Matrix4:
    """Sensor → tracker for a picture → tissue pose, the tracker standing in the tissue."""
    return picture_pose @ X


def place(x_mm: float = 0, y_mm: float = 0, z_mm: float = 0) -> Matrix4:
    return rigid(np.eye(3), np.array([x_mm, y_mm, z_mm]))


def tracked(
    u_px: tuple[float, float] = (0, 0),
    turn_deg: float = 0.0,
    correlation: float = 0.97,
    step_px: tuple[float, float] = (0, 0),
) -> Tracked:
    u = np.array(u_px, dtype=float)
    found = Registration(u, np.deg2rad(turn_deg), 1.0, 0.0, np.eye(3), correlation, 1.0, True)
    return Tracked(1, 0, found, (u, found.alpha_rad), (np.array(step_px, dtype=float), 0.0))


def kinds(program: str, seed: int, duration_s: float = 2.2) -> Counter[MotionKind]:
    """Kinds of the motions that the line sorted once it knew the overlay."""
    world = kept(seed, program, settings=SMALL)
    line = Line(replace(TRUTH, image_size_px=(SMALL.width_px, SMALL.height_px)), Limits())
    found: dict[int, MotionKind] = {}
    for sample in session(world, duration_s):
        line.step(sample)
        if line.motion is not None and line.motion.sequence >= 12:
            found[line.motion.sequence] = line.motion.kind
    return Counter(found.values())


@given(poses, poses)
def test_the_predicted_motion_moves_tissue_as_the_two_picture_poses_do(first: Matrix4, second: Matrix4) -> None:
    """Eq. 1: A = X B X⁻¹ is the motion P_2⁻¹ P_1 of a static point between the two pictures."""
    t_a, turn = predicted_motion(TRUTH, sensor(first), sensor(second))
    A = inverse(second) @ first
    np.testing.assert_allclose(t_a, A[:3, 3], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(turn), np.linalg.norm(vector_from_rotation(A[:3, :3])), atol=1e-7)


def turned(turn_deg: float) -> Matrix4:
    """About the middle of the picture, in its plane."""
    return rigid(rotation_from_vector(np.array([0, 0, np.deg2rad(turn_deg)])), np.zeros(3))


@pytest.mark.parametrize(
    ("way", "expected"),
    [
        ([place(1.6 * k) for k in range(4)], True),
        ([place(1.4 * k) for k in range(4)], False),
        ([place(0, 0.5 * k) for k in range(4)], True),
        ([place(0, 0.4 * k) for k in range(4)], False),
        ([place(1.2 * k, 0.3 * k) for k in range(4)], True),
        ([place(0, 0, 3.0 * k) for k in range(4)], False),
        ([place(), place(), place(), place(0, 1.3)], False),
        ([place(), place(0, 0.7), place(0, 1.4), place(0, 1.4)], False),
        ([turned(20 * k) for k in range(4)], True),
        ([turned(1 * k) for k in range(4)], False),
        ([place(1.6)], False),
    ],
)
def test_a_hand_is_quick_where_all_of_the_picture_goes_on_by_more_than_its_speckle(way, expected: bool) -> None:
    assert quick(TRUTH, [sensor(one) for one in way]) is expected


PREDOMINANT = {
    "still": {STILL},
    "lateral": {TRANSLATION},
    "rotation": {PLANAR, STILL},
    "elevational": {OUT_OF_PLANE, STILL},
    "sweep": {TRANSLATION, PLANAR},
    "gestured": {TRANSLATION, PLANAR},
    "freehand": {OUT_OF_PLANE, TRANSLATION, PLANAR, STILL},
    "guided": {OUT_OF_PLANE, TRANSLATION, PLANAR, STILL},
}
"""STILL stands beside others because every keyframe begins with motion too small to name."""


QUICK = {"still", "elevational", "guided"}


@pytest.mark.parametrize(
    "program", [one if one in QUICK else pytest.param(one, marks=pytest.mark.thorough) for one in PROGRAMS]
)
def test_every_program_of_the_hand_is_sorted_as_what_it_is(program: str) -> None:
    counted = kinds(program, seed=2)
    expected = sum(counted[kind] for kind in PREDOMINANT[program])
    assert expected >= 0.75 * counted.total(), counted
    moving = {kind: number for kind, number in counted.items() if kind is not STILL}
    if program != "still":
        first = {"rotation": PLANAR} | dict.fromkeys(("lateral", "sweep", "gestured"), TRANSLATION)
        assert max(moving, key=moving.__getitem__) is first.get(program, OUT_OF_PLANE), counted
    if program == "elevational":
        assert counted[TRANSLATION] + counted[PLANAR] == 0, counted


@pytest.mark.parametrize(
    ("seen", "probe", "kind"),
    [
        (tracked((1.8, 0)), place(0.144), STILL),
        (tracked((1.9, 0)), place(0.152), TRANSLATION),
        (tracked((0, 2.2)), place(0, 0.154), TRANSLATION),
        (tracked((30, 0), 0.69), place(2.4), TRANSLATION),
        (tracked((30, 0), 0.71), place(2.4), PLANAR),
        (tracked((0, 0), -0.71), place(), PLANAR),
        (tracked((0, 0), correlation=0.9), place(0, 0, 0.26), OUT_OF_PLANE),
        (tracked((0, 0), correlation=0.9), place(0, 0, 0.24), STILL),
        (tracked((0, 0), correlation=0.96), place(0, 0, 5), STILL),
        (tracked((10, 0), correlation=0.9), place(0.8, 0, 0.85), OUT_OF_PLANE),
        (tracked((10, 0), correlation=0.9), place(0.8, 0, 0.75), TRANSLATION),
        (tracked((5, 0), step_px=(0, 40.1)), place(), TOO_FAST),
        (tracked((5, 0), step_px=(0, 39.9)), place(), TRANSLATION),
        (Tracked(1, 0, None, (np.zeros(2), 0.0), None, "lost"), place(), DECORRELATED),
    ],
)
def test_kinds_at_their_bounds(seen: Tracked, probe: Matrix4, kind: MotionKind) -> None:
    assert sort_motion(seen, TRUTH, sensor(HOME), sensor(probe)) is kind


def motion(seen: Tracked) -> Motion:
    stamp = Stamp(5, 0)
    pair = StampedPair(stamp, Frame(stamp, 3, np.zeros((2, 2), np.uint8)), sensor(HOME), 0)
    return analyse(seen, pair, TRUTH, sensor(HOME))


def test_what_the_solver_must_not_see_says_why() -> None:
    lost = motion(Tracked(4, 3, None, (np.zeros(2), 0.0), None, "picture without structure"))
    fast = motion(tracked((5, 0), step_px=(50, 0)))
    good = motion(tracked((5, 0)))
    assert (lost.usable, lost.reason, lost.chain) == (False, "picture without structure", 4)
    assert (fast.usable, fast.reason) == (False, "too fast")
    assert (good.usable, good.reason, good.sequence, good.keyframe) == (True, "", 3, 0)


@pytest.mark.parametrize(
    ("seen", "overlap", "wanted"),
    [
        (tracked((5, 0)), 1.0, False),
        (tracked((5, 0), correlation=0.80), 0.85, False),
        (tracked((5, 0), correlation=0.79), 1.0, True),
        (tracked((5, 0)), 0.84, True),
        (tracked((60, 0)), 1.0, False),
        (tracked((42, 43)), 1.0, True),
        (tracked((5, 0), correlation=0.5, step_px=(41, 0)), 0.5, False),
        (Tracked(1, 0, None, (np.zeros(2), 0.0), None, "lost"), 0.0, False),
    ],
)
def test_the_keyframe_changes_at_the_end_of_likeness_overlap_or_reach(
    seen: Tracked, overlap: float, wanted: bool
) -> None:
    assert wants_keyframe(motion(seen), overlap) is wanted


@pytest.mark.parametrize(("correlation", "wanted"), [(0.7, False), (0.69, True)])
def test_out_of_the_plane_a_worse_likeness_will_do(correlation: float, wanted: bool) -> None:
    out = replace(motion(tracked((1, 0), correlation=correlation)), kind=OUT_OF_PLANE)
    assert wants_keyframe(out, 1.0) is wanted
