"""A long rest teaches the noise of a rest. The motion after it is not accused of being none."""

import pytest

from tests.invariant.cart import Cart
from tests.invariant.circumstances import Manner
from tests.invariant.machine import CLOSED_AGAIN_WITHIN_S, GESTURE_DEG
from tests.invariant.world import CORNERED, NONE, SHRUNK

_MENDED_BY = (
    (CORNERED, Manner.WIPED, 3.0, 3.0),
    (NONE, Manner.FADED, 0.3, 12.0),
    (CORNERED, Manner.AVERAGED, 0.8, 1.5),
    (NONE, Manner.WIPED, 0.8, 12.0),
)
"""Change, manner, how long it takes and how long the probe rests afterwards, s."""


@pytest.mark.thorough
def test_a_scale_that_is_mended_in_a_rest_leaves_no_offset() -> None:
    """Found by the random sequences: the first two seconds of motion after it were named `offset` by −35 mm."""
    cart = Cart(122, change=SHRUNK, tilt_deg=GESTURE_DEG, attended=False, received=True)
    cart.run(7.0)
    cart.false_stamp("frame", 5_000_000_000)
    cart.run(1.0)
    cart.meet(moving=False)
    for change, manner, over_s, rests_s in _MENDED_BY:
        cart.run(2.0)
        cart.break_picture(change, manner, over_s)
        cart.run(over_s + rests_s)
    cart.run(37.0)
    cart.attended, moved_s = True, cart.t_s
    cart.meet(moving=True)
    assert cart.run(CLOSED_AGAIN_WITHIN_S, until=lambda: cart.closed), cart.told()
    assert [moment for moment in cart.moments if moment.t_s > moved_s and "offset" in moment.reason] == []
