"""The contact never outlives its evidence: what the package `tests.invariant` asserts, and the holes it has to find."""

import pytest

from probewatch.appliance.core.quality.judgement import BROKE
from probewatch.appliance.supervision.alarms import HAZARDS
from tests.invariant.cart import ORIGIN_NS, Cart
from tests.invariant.circumstances import Pictures, Poses
from tests.invariant.long_run import long_run
from tests.invariant.machine import CLOSED_AGAIN_WITHIN_S, Room, room_test
from tests.invariant.oracle import STRICT, SWEPT_NS, TICK_NS
from tests.invariant.scenarios import DISTURBANCES, VERIFIED_WITHIN_S, bend_unseen, incident, verified_cart
from tests.invariant.world import BENT, ELSEWHERE, FLIPPED, NONE, SLID

AN_HOUR_NS = 3600 * 10**9
SLOW = 15.0
"""Frames per second of the quick ones: the promise is the same, and half the pictures take half the time."""


def outlasting(disturbance: str, max_age_ns: int = SWEPT_NS, *, discerning: bool = True) -> None:
    """The oracle objects where the contact is closed for longer than it may."""
    cart = incident(disturbance, 1, fps=SLOW, max_age_ns=max_age_ns, discerning=discerning)
    assert cart.run((max_age_ns + TICK_NS) / 1e9, until=lambda: not cart.closed), cart.told()


@pytest.mark.thorough
@pytest.mark.parametrize("max_age_s", [8, 30])
def test_hole_1_the_contact_does_not_outlive_one_good_pose_in_twelve(max_age_s: int) -> None:
    outlasting("one pose in twelve", max_age_s * 10**9)


@pytest.mark.slow
@pytest.mark.parametrize("stream", ["frame", "pose"])
def test_hole_2_one_stamp_in_the_future_does_not_end_pairing(stream: str) -> None:
    cart = verified_cart(1, fps=SLOW)
    cart.false_stamp(stream, AN_HOUR_NS)
    cart.run(1.0)
    assert cart.line.motion is not None
    age_s = cart.t_s - (cart.line.motion.stamp.t_ns - ORIGIN_NS) / 1e9
    assert age_s < 0.5, "a second of good samples has not brought pairing back"


@pytest.mark.slow
@pytest.mark.parametrize("stream", ["frame", "pose"])
def test_hole_2_a_bend_after_one_stamp_in_the_future_is_found(stream: str) -> None:
    cart = verified_cart(1, fps=SLOW)
    cart.false_stamp(stream, AN_HOUR_NS)
    cart.run(0.5)
    bend_unseen(cart)
    cart.run(17.0)
    assert not cart.closed


@pytest.mark.slow
@pytest.mark.parametrize("discerning", [True, False])
@pytest.mark.parametrize("pictures", ["noise", "black"])
def test_hole_3_the_contact_does_not_outlive_the_last_picture_of_tissue(pictures: str, discerning: bool) -> None:
    outlasting(pictures, discerning=discerning)


@pytest.mark.thorough
def test_hole_4_what_contradicts_the_reference_opens_the_contact_before_it_is_named() -> None:
    Cart(1, change=ELSEWHERE, fps=SLOW).run(15.0)


@pytest.mark.slow
def test_hole_5_a_fault_that_is_still_there_does_not_go_back_to_ok() -> None:
    """Somebody acknowledges what halts; the probe rests until the measurements that showed the fault are too old."""
    cart = Cart(1, change=SLID, fps=SLOW, enforced="c")
    assert cart.run(25.0, until=lambda: cart.oracle.shown_fault is not None), cart.told()
    cart.meet(moving=False)
    cart.run(14.0)
    cart.meet(moving=True)
    cart.run(10.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("disturbance", DISTURBANCES)
def test_a_bend_that_no_motion_shows_opens_the_contact_for_good(disturbance: str, seed: int) -> None:
    """130 s: open when the last motion that showed the calibration is 30 s and one tick old, and never closed again."""
    cart = incident(disturbance, seed)
    cart.run(130.0)
    assert [moment.closed for moment in cart.moments].count(True) == 1, cart.told()


@pytest.mark.thorough
def test_a_parameter_with_an_age_of_its_own_opens_the_contact_at_that_age() -> None:
    """The axial scale may be 18 s old, all else 30 s; at rest motion shows neither."""
    cart = verified_cart(1, fps=SLOW, asked=STRICT, at_rest_s=0.0)
    cart.meet(moving=False)
    assert cart.run(18.5, until=lambda: not cart.closed), cart.told()


@pytest.mark.thorough
def test_a_rest_extends_the_ages_by_what_is_configured_and_not_by_what_nobody_saw() -> None:
    """At rest for 12 s, then turned and moved where nothing shows anything: 18 s and 10 of the rest."""
    cart = verified_cart(1, fps=SLOW, asked=STRICT, at_rest_s=10.0)
    cart.meet(moving=False)
    assert not cart.run(16.0, until=lambda: not cart.closed), cart.told()
    cart.meet(moving=True, poses=Poses.ONE_IN_TWELVE)
    assert cart.run(12.5, until=lambda: not cart.closed), cart.told()


@pytest.mark.thorough
def test_pictures_that_come_and_go_are_no_picture_within_a_second_and_one_episode() -> None:
    """Blank for 0.7 s, seen for 0.5 s: what was shown is void after a quarter of a second, then one thing is told."""
    cart = Cart(1, fps=SLOW)
    assert cart.run(VERIFIED_WITHIN_S, until=lambda: cart.closed), cart.told()
    began_s, before = cart.t_s, len(cart.moments)
    for _ in range(5):
        cart.meet(pictures=Pictures.BLACK)
        cart.run(0.7)
        cart.meet(pictures=Pictures.GENUINE)
        cart.run(0.5)
    void, moment = cart.moments[before:]
    assert (void.state, void.closed) == ("not verified", False)
    assert void.reason.startswith(f"{BROKE}; not shown yet: ")
    assert (moment.state, moment.reason) == ("not verified", HAZARDS["no-picture"].text)
    assert moment.t_s - began_s <= 1.0


@pytest.mark.slow
def test_liveness_a_fault_that_is_undone_lets_the_contact_close_again() -> None:
    """Also the bend of the body, if it is undone as visibly as it was done."""
    cart = verified_cart(2, fps=SLOW)
    for change in (FLIPPED, BENT):
        cart.change(change)
        assert cart.run(6.0, until=lambda: not cart.closed), cart.told()
        cart.run(1.0)
        cart.change(NONE)
        assert cart.run(CLOSED_AGAIN_WITHIN_S, until=lambda: cart.closed), cart.told()
        cart.run(1.0)


@pytest.mark.slow
def test_liveness_after_disturbances_the_contact_closes_again() -> None:
    cart = verified_cart(3, fps=SLOW)
    for bad in ({"poses": Poses.MISSING}, {"pictures": Pictures.NOISE}, {"pictures": Pictures.GONE}):
        cart.meet(**bad)
        cart.run(4.0)
        cart.meet(pictures=Pictures.GENUINE, poses=Poses.GENUINE)
        assert cart.run(CLOSED_AGAIN_WITHIN_S, until=lambda: cart.closed), cart.told()
        cart.run(1.0)


@pytest.mark.thorough
def test_no_sequence_lets_the_contact_outlive_its_evidence() -> None:
    """The same sequences in every run; `make invariant` tries others."""
    Room.fps, frames = SLOW, Cart.frames
    room_test(examples=4, steps=3, seed=3)()
    assert Cart.frames - frames > 1000


@pytest.mark.slow
def test_no_sequence_of_a_hundred_thousand_frames_lets_the_contact_outlive_its_evidence() -> None:
    assert long_run(seed=1, frames=100_000) >= 100_000
