"""A marker body that is bent and slides out of the plane while the tracker is away for a moment: samples to contact."""

import numpy as np
import pytest

from drivers.rigid import inverse, rigid, rotation_from_vector
from tests.invariant.circumstances import Poses
from tests.invariant.scenarios import verified_cart
from tests.invariant.world import X_REFERENCE, Change

POSE_S = 1 / 60
PLANE = rigid(rotation_from_vector(np.deg2rad([0.0, 7.0, 0.0])), np.array([0.0, 0.0, 9.0]))
BENT_ACROSS = Change("bent by 7° about axial and slid by 9 mm across", inverse(X_REFERENCE) @ PLANE @ X_REFERENCE)
"""Nothing in the plane, where motion and the watch for slow slips would see it soon."""


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
