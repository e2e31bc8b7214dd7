"""Times that hardly go on: by them whatever was shown stays young, and a slip is seen as late as they are."""

from typing import Any

import pytest

from probewatch.appliance.supervision.alarms import BEHIND
from probewatch.appliance.supervision.policy import BEHIND_NS
from tests.invariant.cart import Cart
from tests.invariant.circumstances import Stamps
from tests.invariant.oracle import TICK_NS
from tests.invariant.scenarios import bend_unseen, verified_cart
from tests.invariant.world import BENT_AND_SLID

SLOW = 15.0
"""Frames per second, as in test_invariant."""
WITHIN_S = (BEHIND_NS + TICK_NS) / 1e9


def slowed(stamps: Stamps, streams: tuple[str, ...], moving: bool) -> Cart:
    cart = verified_cart(1, fps=SLOW)
    slow: dict[str, Any] = {f"{stream}_stamps": stamps for stream in streams}
    cart.meet(moving=moving, **slow)
    return cart


@pytest.mark.thorough
@pytest.mark.parametrize("moving", [False, True], ids=["at rest", "moving"])
@pytest.mark.parametrize("streams", [("frame",), ("frame", "pose")], ids=["pictures", "both"])
def test_a_bend_behind_times_that_crawl_opens_the_contact(streams: tuple[str, ...], moving: bool) -> None:
    cart = slowed(Stamps.CRAWLING, streams, moving)
    cart.run(0.3)
    cart.change(BENT_AND_SLID)
    assert cart.run(WITHIN_S, until=lambda: not cart.closed), cart.told()
    cart.run(10.0, until=lambda: cart.closed)
    assert not cart.closed, cart.told()


@pytest.mark.thorough
def test_a_bend_that_nobody_saw_behind_times_that_crawl_opens_the_contact() -> None:
    cart = slowed(Stamps.CRAWLING, ("frame", "pose"), moving=False)
    bend_unseen(cart)
    assert cart.run(WITHIN_S, until=lambda: not cart.closed), cart.told()
    cart.run(10.0, until=lambda: cart.closed)
    assert not cart.closed, cart.told()


@pytest.mark.thorough
def test_pictures_of_a_clock_that_is_slow_verify_nothing_once_they_are_a_second_behind() -> None:
    cart = slowed(Stamps.HALF_AS_FAST, ("frame",), moving=False)
    assert cart.run(2 * WITHIN_S, until=lambda: not cart.closed), cart.told()
    assert cart.moments[-1].reason == BEHIND
    cart.run(4.0)
    cart.change(BENT_AND_SLID)
    cart.run(10.0, until=lambda: cart.closed)
    assert not cart.closed, cart.told()
