"""A slip out of the plane in halves, in two gaps of the tracker, is doubted; a hand that goes there is not."""

import numpy as np
import pytest

from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.core.detectors.split_slip import SplitSlip
from probewatch.appliance.limits import Limits
from probewatch.drivers.rigid import Array, inverse, rigid
from probewatch.drivers.samples import Pose, PoseStatus, Stamp
from tests.support.motions import TRUTH

X = rigid(TRUTH.rotation, TRUTH.offset_mm)
PICTURE = np.zeros((4, 4), np.uint8)
FPS, POSE_HZ = 30, 60
GAPS_S = ((3.0, 3.15), (3.2, 3.35))
HALF_MM = 4.5


def plane(t_s: float, out_mm_per_s: float) -> Array:
    """In the plane to and fro, out of it on and on."""
    return rigid(np.eye(3), np.array([5 * np.sin(2 * t_s), 2 * np.cos(3 * t_s), out_mm_per_s * t_s]))


def doubts(slipped_mm: float = 0.0, went_mm: float = 0.0, out_mm_per_s: float = 0.0) -> list[float]:
    """Times of doubts, s. slipped_mm: of the marker body across the picture in each gap. went_mm: of the hand there,
    out of the plane, which the pictures show.
    """
    watch, found, random = SplitSlip(Limits(), TRUTH), [], np.random.default_rng(3)

    def gaps_gone(t_s: float) -> float:
        return float(sum(np.clip((t_s - since) / (until - since), 0, 1) for since, until in GAPS_S))

    def hand(t_s: float) -> Array:
        return plane(t_s, out_mm_per_s) @ rigid(np.eye(3), np.array([0.0, 0.0, went_mm * gaps_gone(t_s)]))

    for k in range(1, 5 * POSE_HZ):
        t_s = k / POSE_HZ
        if not any(since < t_s < until for since, until in GAPS_S):
            slip = rigid(np.eye(3), np.array([0.0, 0.0, slipped_mm * round(gaps_gone(t_s))]))
            pose = hand(t_s) @ slip @ X
            pose[:3, 3] += 0.1 * random.standard_normal(3)
            watch.pose(Pose(Stamp(round(t_s * 1e9), 0), k, pose, 0.1, PoseStatus.OK))
        if k % (POSE_HZ // FPS) == 0:
            moved = np.r_[(inverse(hand(t_s - 1 / FPS)) @ hand(t_s))[:2, 3], 0.0]
            goes = went_mm > 0 and gaps_gone(t_s) % 1.0 > 0
            likeness, keyframe = (0.6, k) if goes else (0.99, 0)
            seen = Observation(round(t_s * 1e9), PICTURE, False, moved=moved, likeness=likeness, keyframe=keyframe)
            if watch.see(seen):
                found.append(t_s)
    return found


@pytest.mark.parametrize("out_mm_per_s", [0.0, 8.0])
def test_halves_in_two_gaps_are_doubted_once(out_mm_per_s: float) -> None:
    (t_s,) = doubts(slipped_mm=HALF_MM, out_mm_per_s=out_mm_per_s)
    assert GAPS_S[-1][1] <= t_s <= GAPS_S[-1][1] + 0.15


def test_less_than_the_limit_in_all_is_the_hands() -> None:
    assert doubts(slipped_mm=1.5) == []


def test_a_steady_hand_is_not_doubted_over_tissue_alike_everywhere() -> None:
    assert doubts(out_mm_per_s=20.0) == []


def test_a_hand_that_the_pictures_show_is_not_doubted() -> None:
    assert doubts(went_mm=HALF_MM) == []
