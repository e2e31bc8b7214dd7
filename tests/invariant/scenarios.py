"""Incidents with a name: a bend with a slide that nothing shows, behind every disturbance there is."""

from collections.abc import Mapping
from typing import Any

from probewatch.appliance.limits import AT_REST_S, RequiredAges
from tests.invariant.cart import POSE_MS, Cart
from tests.invariant.circumstances import Pictures, Poses, Stamps
from tests.invariant.oracle import MAX_AGE_NS, SHIPPED
from tests.invariant.world import BENT_AND_SLID

VERIFIED_WITHIN_S = 20.0

DISTURBANCES: Mapping[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "one pose in twelve": ({"poses": Poses.ONE_IN_TWELVE},) * 2,
    "every second pose missing": ({"poses": Poses.ONE_IN_TWO},) * 2,
    "three poses a second": ({"poses": Poses.SLOW},) * 2,
    "poses of NaN": ({"poses": Poses.NAN},) * 2,
    "noise": ({"pictures": Pictures.NOISE},) * 2,
    "black": ({"pictures": Pictures.BLACK},) * 2,
    "flicker": ({"pictures": Pictures.FLICKER},) * 2,
    "in the future": ({"frame_stamps": Stamps.FUTURE}, {"pose_stamps": Stamps.FUTURE}),
    "in the past": ({"frame_stamps": Stamps.PAST}, {"pose_stamps": Stamps.PAST}),
    "all alike": ({"frame_stamps": Stamps.ALIKE}, {"pose_stamps": Stamps.ALIKE}),
    "at rest": ({"moving": False},) * 2,
}
"""Name → circumstances of the first and of the second seed: of stamps those of the pictures, then of the poses."""


def verified_cart(
    seed: int,
    *,
    fps: float = 30.0,
    max_age_ns: int = MAX_AGE_NS,
    asked: RequiredAges = SHIPPED,
    discerning: bool = True,
    at_rest_s: float = AT_REST_S,
    pose_ms: float = POSE_MS,
) -> Cart:
    """A healthy cart whose contact has been closed for a second."""
    cart = Cart(
        seed,
        fps=fps,
        pose_ms=pose_ms,
        max_age_ns=max_age_ns,
        asked=asked,
        discerning=discerning,
        at_rest_s=at_rest_s,
    )
    assert cart.run(VERIFIED_WITHIN_S, until=lambda: cart.closed), cart.told()
    cart.run(1.0)
    return cart


def bend_unseen(cart: Cart) -> None:
    """The marker body is bent and slides while it is out of sight for half a second."""
    kept = cart.circumstances.poses
    cart.meet(poses=Poses.MISSING)
    cart.run(0.3)
    cart.change(BENT_AND_SLID)
    cart.run(0.2)
    cart.meet(poses=kept)


def incident(
    disturbance: str, seed: int, *, fps: float = 30.0, max_age_ns: int = MAX_AGE_NS, discerning: bool = True
) -> Cart:
    """Verified, disturbed half a second later, bent unseen."""
    cart = verified_cart(seed, fps=fps, max_age_ns=max_age_ns, discerning=discerning)
    cart.meet(**DISTURBANCES[disturbance][(seed - 1) % 2])
    cart.run(0.5)
    bend_unseen(cart)
    return cart
