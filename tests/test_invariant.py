"""The contact never outlives its evidence: what the package `tests.invariant` asserts, and the holes it has to find."""

import pytest

from tests.invariant.cart import ORIGIN_NS, Cart
from tests.invariant.circumstances import Pictures, Poses
from tests.invariant.machine import CLOSED_AGAIN_WITHIN_S, room_test
from tests.invariant.oracle import OLDEST_NS
from tests.invariant.scenarios import DISTURBANCES, bend_unseen, incident, verified_cart
from tests.invariant.world import BENT, ELSEWHERE, FLIPPED, MAGNIFIED, NONE, Change

OLDEST_S = OLDEST_NS / 1e9
AN_HOUR_NS = 3600 * 10**9
SLOW = 15.0
"""Frames per second of the quick ones: the promise is the same, and half the pictures take half the time."""


def outlasting(disturbance: str, seed: int = 1) -> None:
    incident(disturbance, seed, OLDEST_S + 2, fps=SLOW)


def test_hole_1_the_contact_does_not_outlive_one_good_pose_in_twelve() -> None:
    outlasting("one pose in twelve")


@pytest.mark.parametrize("stream", ["frame", "pose"])
def test_hole_2_one_stamp_in_the_future_does_not_end_pairing(stream: str) -> None:
    cart = verified_cart(1, fps=SLOW)
    cart.false_stamp(stream, AN_HOUR_NS)
    cart.run(1.0)
    assert cart.line.motion is not None
    age_s = cart.t_s - (cart.line.motion.stamp.t_ns - ORIGIN_NS) / 1e9
    assert age_s < 0.5, "a second of good samples has not brought pairing back"


@pytest.mark.parametrize("stream", ["frame", "pose"])
def test_hole_2_a_bend_after_one_stamp_in_the_future_is_found(stream: str) -> None:
    cart = verified_cart(1, fps=SLOW)
    cart.false_stamp(stream, AN_HOUR_NS)
    cart.run(0.5)
    bend_unseen(cart)
    cart.run(17.0)
    assert not cart.closed


@pytest.mark.parametrize("pictures", ["noise", "black"])
def test_hole_3_the_contact_does_not_outlive_the_last_picture_of_tissue(pictures: str) -> None:
    outlasting(pictures)


def test_hole_4_what_contradicts_the_reference_opens_the_contact_before_it_is_named() -> None:
    Cart(1, change=ELSEWHERE, fps=SLOW).run(15.0)


@pytest.mark.parametrize("change", [ELSEWHERE], ids=str)
def test_hole_5_a_fault_that_is_still_there_does_not_go_back_to_ok(change: Change) -> None:
    """Somebody acknowledges whatever halts."""
    cart = Cart(1, change=change, fps=SLOW, enforced=False)
    cart.run(30.0)
    assert [broken for _, broken in cart.broken if broken.clause == "c"] == [], cart.told()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("disturbance", DISTURBANCES)
def test_a_bend_that_no_motion_shows_opens_the_contact_for_good(disturbance: str, seed: int) -> None:
    """130 s: open when the last motion that showed the calibration is 30 s and one tick old, and never closed again."""
    cart = incident(disturbance, seed, 130.0)
    assert [moment.closed for moment in cart.moments].count(True) == 1, cart.told()


@pytest.mark.parametrize("change", [FLIPPED, MAGNIFIED, BENT], ids=str)
def test_liveness_a_fault_that_is_undone_lets_the_contact_close_again(change: Change) -> None:
    cart = verified_cart(2, fps=SLOW)
    cart.change(change)
    cart.run(6.0)
    assert not cart.closed
    cart.change(NONE)
    assert cart.run(CLOSED_AGAIN_WITHIN_S, until=lambda: cart.closed), cart.told()


@pytest.mark.parametrize(
    "bad",
    [{"poses": Poses.MISSING}, {"poses": Poses.ONE_IN_TWELVE}, {"pictures": Pictures.NOISE}],
    ids=["probe out of sight", "one pose in twelve", "noise"],
)
def test_liveness_after_a_disturbance_the_contact_closes_again(bad: dict[str, object]) -> None:
    cart = verified_cart(3, fps=SLOW)
    cart.meet(**bad)
    cart.run(5.0)
    cart.meet(pictures=Pictures.GENUINE, poses=Poses.GENUINE)
    assert cart.run(CLOSED_AGAIN_WITHIN_S, until=lambda: cart.closed), cart.told()


def test_no_sequence_lets_the_contact_outlive_its_evidence() -> None:
    room_test(examples=3, steps=4)()
