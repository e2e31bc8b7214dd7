"""A marker body that is bent and slides out of the plane while the tracker is away for a moment, again and again, or
reads seldom: samples to contact."""

import numpy as np
import pytest

from probewatch.drivers.rigid import inverse, rigid, rotation_from_vector
from tests.invariant.circumstances import Poses
from tests.invariant.scenarios import verified_cart
from tests.invariant.world import X_REFERENCE, Change

POSE_S = 1 / 60
PLANE = rigid(rotation_from_vector(np.deg2rad([0.0, 7.0, 0.0])), np.array([0.0, 0.0, 9.0]))
BENT_ACROSS = Change("bent by 7° about axial and slid by 9 mm across", inverse(X_REFERENCE) @ PLANE @ X_REFERENCE)
"""Nothing in the plane, where motion and the watch for slow slips would see it soon."""
_HALF = rigid(rotation_from_vector(np.deg2rad([0.0, 3.5, 0.0])), np.array([0.0, 0.0, 4.5]))
HALF_ACROSS = Change("half of that", inverse(X_REFERENCE) @ _HALF @ X_REFERENCE)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("missing", "moving"),
    [(11, False), (16, False), *(pytest.param(*one, marks=pytest.mark.thorough) for one in [(15, False), (16, True)])],
)
def test_the_contact_opens_on_a_slip_while_no_pose_came(missing: int, moving: bool) -> None:
    """For 200, 267 and 283 ms, up to 300 from picture to picture: open within .2 s of the next pose."""
    cart = verified_cart(1)
    cart.meet(moving=moving)
    cart.run(2.0)
    assert cart.closed
    cart.meet(poses=Poses.GONE)
    cart.run(missing * POSE_S / 2)
    cart.change(BENT_ACROSS)
    cart.run(missing * POSE_S / 2)
    cart.meet(poses=Poses.GENUINE)
    assert cart.run(0.2, until=lambda: not cart.closed), cart.told()


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("away_s", "bright", "slips_in", "moving"), [(0.183, 1, 4, False), (0.183, 1, 2, True), (0.15, 3, 2, False)]
)
def test_the_contact_opens_on_a_slip_amid_a_flicker(away_s: float, bright: int, slips_in: int, moving: bool) -> None:
    """Gaps that are each bridged, with a few poses between: no history tells what the hand did."""
    cart = verified_cart(1)
    cart.meet(moving=moving)
    cart.run(2.0)
    assert cart.closed
    for gap in range(5):
        cart.meet(poses=Poses.GONE)
        cart.run(away_s / 2)
        if gap == slips_in:
            cart.change(BENT_ACROSS)
            slipped_s = cart.t_s
        cart.run(away_s / 2)
        cart.meet(poses=Poses.GENUINE)
        cart.run(bright * POSE_S)
    left_s = slipped_s + 0.6 - cart.t_s
    assert not cart.closed or cart.run(left_s, until=lambda: not cart.closed), cart.told()


@pytest.mark.thorough
@pytest.mark.parametrize(("every_ms", "moving"), [(120, True), (160, False), (235, True)])
def test_the_contact_opens_on_a_slip_between_two_readings_of_a_slow_tracker(every_ms: int, moving: bool) -> None:
    """Within three readings: the hand could have gone so far, and the pictures do not show that it did."""
    cart = verified_cart(2, pose_ms=every_ms)
    cart.meet(moving=moving)
    cart.run(2.0)
    assert cart.closed
    cart.change(BENT_ACROSS)
    assert cart.run(0.1 + 3 * every_ms / 1000, until=lambda: not cart.closed), cart.told()


@pytest.mark.thorough
@pytest.mark.parametrize("moving", [False, True])
def test_the_contact_opens_on_a_slip_in_two_steps_one_reading_apart(moving: bool) -> None:
    """At 20 poses a second, as a clamp gives way within 50 ms: the second step hid the first."""
    cart = verified_cart(1, pose_ms=50.0)
    cart.meet(moving=moving)
    cart.run(2.0)
    assert cart.closed
    cart.change(HALF_ACROSS)
    cart.run(0.05)
    cart.change(BENT_ACROSS)
    assert cart.run(0.4, until=lambda: not cart.closed), cart.told()


@pytest.mark.thorough
@pytest.mark.parametrize(("bright", "moving"), [(2, False), (3, False), (2, True)])
def test_the_contact_opens_on_a_slip_in_halves_in_two_neighbouring_gaps(bright: int, moving: bool) -> None:
    """Each within what a hand could have gone in .15 s, and poses between that hid the first from the second."""
    cart = verified_cart(1)
    cart.meet(moving=moving)
    cart.run(2.0)
    assert cart.closed
    for slipped in (HALF_ACROSS, BENT_ACROSS):
        cart.meet(poses=Poses.GONE)
        cart.run(0.075)
        cart.change(slipped)
        cart.run(0.075)
        cart.meet(poses=Poses.GENUINE)
        cart.run(bright * POSE_S)
    assert not cart.closed or cart.run(0.2, until=lambda: not cart.closed), cart.told()
