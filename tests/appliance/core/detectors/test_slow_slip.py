"""Tracker and picture that drift apart are doubted; tissue that breathes and a late tracker are usual."""

import numpy as np
import pytest

from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.core.detectors.slow_slip import SLIPS_S, SlowSlip
from probewatch.appliance.limits import Limits
from probewatch.drivers.rigid import Array, inverse, rigid, rotation_from_vector
from tests.support.motions import TRUTH

X = rigid(TRUTH.rotation, TRUTH.offset_mm)
PICTURE = np.zeros((4, 4), np.uint8)
FPS = 30.0


def plane(t_s: float, tissue_mm: float = 0.0) -> Array:
    return rigid(np.eye(3), np.array([5 * np.sin(2 * t_s), 2 * np.cos(3 * t_s) + tissue_mm, 4 * t_s]))


def breath_mm(t_s: float) -> float:
    return float(2 * np.sin(2 * np.pi * 0.25 * t_s))


def slipped(size: Array, share: float) -> Array:
    """(4, 4) sensor → picture with so much of the slip (6,), rad and mm."""
    return rigid(rotation_from_vector(share * size[:3]) @ TRUTH.rotation, TRUTH.offset_mm + share * size[3:])


def doubts(
    until_s: float,
    size: Array | None = None,
    from_s: float = 0.0,
    over_s: float = 0.5,
    late_s: float = 0.0,
    breathes: bool = False,
    lost_s: tuple[float, float] = (0.0, 0.0),
) -> list[float]:
    """Times at which the watch for slips of that length doubts; lost_s: from when until when no picture is followed."""
    watch, found = SlowSlip(Limits(), TRUTH, over_s), []
    random = np.random.default_rng(2)
    for k in range(1, round(until_s * FPS)):
        t_s, before_s = k / FPS, (k - 1) / FPS
        share = float(np.clip((t_s - from_s) / over_s, 0, 1))
        body = X if size is None else slipped(size, share)
        pose = plane(t_s - late_s) @ body
        pose[:3, 3] += 0.1 * random.standard_normal(3)
        there, then = (plane(one, -breath_mm(one) if breathes else 0.0) for one in (t_s, before_s))
        moved = None if lost_s[0] <= t_s < lost_s[1] else np.r_[(inverse(then) @ there)[:2, 3], 0.0]
        if watch.see(Observation(round(t_s * 1e9), PICTURE, False, moved=moved, likeness=0.9, pose=pose)):
            found.append(t_s)
    return found


TURN, ASIDE = np.deg2rad([0, 0, 3.5, 0, 0, 0]), np.array([0, 0, 0, 5.0, 0, 0])


@pytest.mark.parametrize("size", [TURN, ASIDE, -ASIDE])
def test_a_slip_over_half_a_second_is_doubted_once_and_before_it_is_complete(size) -> None:
    found = doubts(7.0, size, from_s=5.0)
    assert len(found) == 1
    assert 5.0 < found[0] <= 5.6


def test_a_slip_over_five_seconds_is_doubted() -> None:
    assert doubts(36.0, ASIDE, from_s=30.0, over_s=SLIPS_S[-1])


@pytest.mark.parametrize("over_s", SLIPS_S)
@pytest.mark.parametrize(("late_s", "breathes"), [(0.0, False), (0.06, False), (0.0, True)])
def test_what_is_usual_is_never_doubted(over_s, late_s, breathes) -> None:
    assert doubts(8 * over_s + 8, over_s=over_s, late_s=late_s, breathes=breathes) == []


def test_a_slip_while_no_picture_is_followed_is_not_seen_by_it() -> None:
    assert doubts(7.0, ASIDE, from_s=5.0, lost_s=(4.9, 5.6)) == []


def test_a_picture_that_is_shown_again_is_passed_over() -> None:
    watch = SlowSlip(Limits(), TRUTH, 0.5)
    assert not watch.see(Observation(0, PICTURE, repeated=True))
    assert watch.checks() == ()
