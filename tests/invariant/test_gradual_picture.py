"""A picture that becomes another gradually while the probe rests, so that each is like the one before."""

import pytest

from tests.invariant.cart import Cart
from tests.invariant.circumstances import GRADUAL, Manner
from tests.invariant.oracle import GRADUAL_WITHIN_NS
from tests.invariant.scenarios import verified_cart
from tests.invariant.world import ANOTHER_ASPECT, CORNERED, FLIPPED, NONE, SHEARED, SHIFTED, TURNED, ZOOMED, Change

LONG_S = 12.0
AT_ONCE_S, STAYS_S = 0.3, 5.0
"""Two looks at it; and for how long the contact is watched afterwards."""


def resting_cart() -> Cart:
    cart = verified_cart(1)
    cart.meet(moving=False)
    cart.run(2.0)
    assert cart.closed, cart.told()
    return cart


def open_within(change: Change, manner: Manner, over_s: float, within_s: float) -> None:
    """And for good."""
    cart = resting_cart()
    cart.break_picture(change, manner, over_s)
    assert cart.run(over_s + within_s, until=lambda: not cart.closed), cart.told()
    assert not cart.run(STAYS_S, until=lambda: cart.closed), cart.told()


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("change", "manner", "over_s"),
    [
        (SHIFTED, Manner.FADED, 0.3),
        (SHIFTED, Manner.FADED, 0.1),
        (TURNED, Manner.FADED, 0.3),
        (SHEARED, Manner.FADED, 0.1),
        (CORNERED, Manner.FADED, 0.8),
        (FLIPPED, Manner.FADED, 1.2),
        (ZOOMED, Manner.FADED, 3.0),
        (SHIFTED, Manner.AVERAGED, 0.4),
        (FLIPPED, Manner.WIPED_IN_STEPS, 1.8),
    ],
)
def test_what_fades_or_is_wiped_opens_the_contact_at_once(change: Change, manner: Manner, over_s: float) -> None:
    open_within(change, manner, over_s, AT_ONCE_S)


@pytest.mark.slow
@pytest.mark.parametrize("manner", GRADUAL)
@pytest.mark.parametrize("over_s", [0.3, 1.2, 3.0])
@pytest.mark.parametrize("change", [SHIFTED, CORNERED, ANOTHER_ASPECT, FLIPPED, ZOOMED])
def test_no_change_however_gradual_outlasts_a_breath(change: Change, manner: Manner, over_s: float) -> None:
    open_within(change, manner, over_s, GRADUAL_WITHIN_NS / 1e9)


@pytest.mark.thorough
def test_an_animation_of_seconds_is_named() -> None:
    """12 % in 3 s are 3 % within the second over which what is animated quickly is added up."""
    cart = resting_cart()
    cart.break_picture(Change("zoomed by 12 %", magnified=(1.12, 1.12)), Manner.ANIMATED, 3.0)
    assert cart.run(3.0, until=lambda: not cart.closed), cart.told()
    cart.run(0.2)
    assert cart.alarm is not None
    assert cart.alarm.fault == "scale", cart.told()


@pytest.mark.thorough
def test_a_picture_that_stays_as_it_is_keeps_the_contact_closed() -> None:
    cart = resting_cart()
    cart.break_picture(NONE, Manner.FADED, 1.0)
    assert not cart.run(LONG_S, until=lambda: not cart.closed), cart.told()
