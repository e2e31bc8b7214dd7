"""The slip watch: what leaps, what the pictures say to it, and what is made of it."""

from collections.abc import Callable

import numpy as np
import pytest

from probewatch.appliance.core.detectors.leap import fit_leap, retraced
from probewatch.appliance.core.detectors.marker_slip import MarkerSlip
from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.core.motion import plane_step, predicted_motion
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import VerdictKind
from probewatch.drivers.rigid import Array, inverse, rigid, rotation_from_vector, vector_from_rotation
from probewatch.drivers.samples import Pose, PoseStatus, Stamp
from tests.support.motions import TRUTH

X = rigid(TRUTH.rotation, TRUTH.offset_mm)
PICTURE = np.zeros((4, 4), np.uint8)
FPS = 30.0
Hand = Callable[[float], Array]
"""s → (6,) way of the picture plane, mm, and its turn, rad."""


def bent(axis: int, deg: float) -> Array:
    """(4, 4) by what the sensor's pose is multiplied when the body is bent about an axis of the picture."""
    turn = rotation_from_vector(np.deg2rad(deg) * np.eye(3)[axis])
    return inverse(X) @ rigid(turn @ TRUTH.rotation, TRUTH.offset_mm)


def slid(axis: int, mm: float) -> Array:
    return inverse(X) @ rigid(TRUTH.rotation, TRUTH.offset_mm + mm * np.eye(3)[axis])


REST, BENT, SLID = np.eye(4), bent(1, 5.0), slid(0, 7.0)


def sweep(t_s: float) -> Array:
    return np.array([3.0 * np.sin(2 * t_s), 2.0 * np.cos(3 * t_s), 10.0 * t_s, 0, 0, 0.05 * np.sin(4 * t_s)])


def gesture(t_s: float) -> Array:
    turns = 0.14 * np.sin(2 * np.pi * t_s / np.array([1.9, 1.7, 1.5]))
    return np.r_[5 * np.sin(np.pi * t_s), 2 * np.sin(2 * np.pi * t_s / 0.75), 0, turns]


class Cart:
    """Poses and pictures of a hand; the picture sees all of it but what leaves the plane. late_s: of the poses.

    away_s: (n, 2) from when until when no pose comes.
    """

    def __init__(self, hand: Hand = sweep, hz: float = 60.0, noise_mm: float = 0.1, late_s: float = 0.0) -> None:
        self.slip = MarkerSlip(Limits(), TRUTH)
        self._hand, self._hz, self._noise_mm, self._late_s = hand, hz, noise_mm, late_s
        self._random = np.random.default_rng(1)
        self._poses = self._pictures = 0
        self.away_s = np.zeros((0, 2))
        self.doubts: list[float] = []
        self.faults: list[tuple[float, str]] = []

    def plane(self, t_s: float) -> Array:
        row = self._hand(t_s)
        return rigid(rotation_from_vector(row[3:]), row[:3])

    def late(self, late_s: float) -> "Cart":
        """The poses to come are of so long before."""
        self._late_s = late_s
        return self

    def go(self, until_s: float, body: Array = REST, likeness: float = 0.9, sees: bool = True) -> "Cart":
        """Go on until then with the marker sitting so."""
        while self._pictures / FPS < until_s:
            t_s = self._pictures / FPS
            while (self._poses + 0.5) / self._hz <= t_s + 1 / self._hz:
                self._pose((self._poses + 0.5) / self._hz, body)
                self._poses += 1
            motion = inverse(self.plane(t_s - 1 / FPS)) @ self.plane(t_s)
            moved = np.r_[motion[:2, 3], vector_from_rotation(motion[:3, :3])[2]] if sees else None
            seen = Observation(round(t_s * 1e9), PICTURE, False, sees, moved=moved, likeness=likeness)
            if self.slip.see(seen):
                self.doubts.append(t_s)
            self.faults += [(t_s, c.fault.value) for c in self.slip.checks() if c.verdict is VerdictKind.FAULT]
            self._pictures += 1
        return self

    def _pose(self, t_s: float, body: Array) -> None:
        noise = self._random.standard_normal(6) * ([self._noise_mm] * 3 + [self._noise_mm * 0.0035] * 3)
        shaken = rigid(rotation_from_vector(noise[3:]), noise[:3])
        if np.any((self.away_s[:, 0] <= t_s) & (t_s < self.away_s[:, 1])):
            return
        matrix = self.plane(t_s - self._late_s) @ X @ body @ shaken
        self.slip.pose(Pose(Stamp(round(t_s * 1e9), 0), self._poses, matrix, 0.1, PoseStatus.OK))

    @property
    def first(self) -> str | None:
        return self.faults[0][1] if self.faults else None


@pytest.mark.parametrize("hand", [sweep, gesture])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(("body", "fault"), [(lambda k: bent(k, -3.5), "rotation"), (lambda k: slid(k, 5.0), "offset")])
def test_a_leap_about_and_along_each_axis_is_named_within_a_fifth_of_a_second(hand, axis, body, fault) -> None:
    cart = Cart(hand).go(1.0).go(1.4, body(axis))
    assert cart.first == fault
    assert cart.faults[0][0] <= 1.2
    assert cart.doubts == [cart.faults[0][0]]
    failed = {check.name: check.value for check in cart.slip.checks() if check.verdict is VerdictKind.FAULT}
    names = ["marker-turn"] if fault == "rotation" else ["marker-shift", *["marker-elevational"] * (axis == 2)]
    assert [*failed] == names
    assert [*failed.values()] == pytest.approx([3.5 if fault == "rotation" else 5.0] * len(names), abs=0.5)


@pytest.mark.parametrize(("across_mm", "told"), [(-6.0, True), (3.0, False)])
def test_what_of_a_slide_is_across_the_picture_is_told_apart(across_mm, told) -> None:
    """Motion does not recover that."""
    cart = Cart().go(1.0).go(1.4, slid(0, 5.0) @ slid(2, across_mm))
    checks = {check.name: check for check in cart.slip.checks()}
    assert checks["marker-shift"].verdict is VerdictKind.FAULT
    assert checks["marker-elevational"].value == pytest.approx(across_mm, abs=0.5)
    assert (checks["marker-elevational"].verdict is VerdictKind.FAULT) is told


def test_what_a_bend_shifts_is_left_for_motion_to_measure() -> None:
    cart = Cart().go(1.0).go(1.4, slid(2, 6.0) @ bent(0, 6.0))
    checks = {check.name: check for check in cart.slip.checks()}
    assert abs(checks["marker-elevational"].value) > 5
    assert [name for name, check in checks.items() if check.verdict is VerdictKind.FAULT] == ["marker-turn"]


@pytest.mark.parametrize("hz", [20.0, 30.0, 120.0])
@pytest.mark.parametrize(("body", "fault"), [(bent(0, 6.0), "rotation"), (slid(2, 10.0), "offset")])
def test_so_it_is_with_slow_and_quick_trackers(hz, body, fault) -> None:
    assert Cart(hz=hz).go(1.0).go(1.5, body).first == fault


@pytest.mark.parametrize("late_s", [-0.06, 0.06])
def test_a_tracker_that_is_late_within_its_limit_changes_nothing(late_s) -> None:
    cart = Cart(gesture, late_s=late_s).go(4.0)
    assert (cart.faults, cart.doubts) == ([], [])
    assert cart.go(4.4, SLID).first == "offset"


def trembling(t_s: float) -> Array:
    """A straight sweep, along which a slide would pass for a lag but for the tremor of the hand."""
    hz = np.array([1.3, 2.1, 3.4, 1.1, 2.7, 4.2])
    return np.r_[0, 0, 15 * t_s, 0, 0, 0] + np.r_[np.full(3, 0.4), np.full(3, 0.004)] * np.sin(2 * np.pi * hz * t_s)


@pytest.mark.parametrize("hand", [gesture, trembling])
@pytest.mark.parametrize(("hz", "noise_mm"), [(60.0, 0.1), (60.0, 0.25), (20.0, 0.1), (120.0, 0.05)])
@pytest.mark.parametrize("late_s", [0.1, 0.25, 0.45, 0.95])
def test_poses_that_fall_back_are_doubted_and_no_slip(hand, hz, noise_mm, late_s) -> None:
    """They repeat what went before; motion tells the lag."""
    cart = Cart(hand, hz, noise_mm).go(1.5).late(late_s).go(2.5)
    assert cart.faults == []
    assert len(cart.doubts) <= 1
    if hand is gesture and hz > 20.0:
        assert [1.5 < t_s < 1.7 for t_s in cart.doubts] == [True]


@pytest.mark.parametrize("mm", [-5.0, 5.0])
def test_a_slide_along_the_way_of_the_hand_is_named(mm) -> None:
    """Back by a third of a second of its way, or on by as much."""
    assert Cart(trembling).go(1.5).go(2.0, slid(2, mm)).first == "offset"


def test_after_poses_have_fallen_back_a_slip_is_named_still() -> None:
    assert Cart(gesture).go(1.5).late(0.1).go(2.0).go(2.5, SLID).first == "offset"


@pytest.mark.parametrize("hand", [sweep, gesture])
@pytest.mark.parametrize(("hz", "noise_mm"), [(20.0, 0.25), (60.0, 0.1), (60.0, 0.25)])
def test_a_steady_hand_leaps_nowhere(hand, hz, noise_mm) -> None:
    cart = Cart(hand, hz, noise_mm).go(10.0)
    assert (cart.faults, cart.doubts) == ([], [])


def knocked(way: Array) -> Hand:
    return lambda t_s: sweep(t_s) + way * (t_s >= 1.0)


@pytest.mark.parametrize("way", [[5.0, 0, 0, 0, 0, 0], [0, -6.0, 0, 0, 0, 0], [2.0, 2.0, 0, 0, 0, 0.1]])
def test_a_leap_that_the_picture_shows_is_the_probe_s(way) -> None:
    cart = Cart(knocked(np.array(way))).go(2.0)
    assert (cart.faults, cart.doubts) == ([], [])


@pytest.mark.parametrize("sees", [True, False])
def test_a_leap_that_no_picture_can_witness_is_doubted_and_not_named(sees) -> None:
    cart = Cart(knocked(np.array([0, 0, 5.0, 0, 0, 0]))).go(0.97).go(1.05, likeness=0.2, sees=sees).go(2.0)
    assert cart.faults == []
    assert len(cart.doubts) == 1


def test_a_twist_after_which_the_picture_is_less_alike_is_the_probe_s() -> None:
    cart = Cart(knocked(np.array([0, 0, 0, 0, 0.08, 0]))).go(0.97).go(1.4, likeness=0.6).go(2.0)
    assert cart.faults == []


@pytest.mark.parametrize("pictures", [1, 2])
@pytest.mark.parametrize("hz", [30.0, 60.0])
def test_an_outlier_that_leaps_back_is_no_slip(pictures, hz) -> None:
    cart = Cart(hz=hz).go(1.0).go(1.0 + pictures / FPS, SLID).go(2.0)
    assert (cart.faults, cart.doubts) == ([], [])


@pytest.mark.parametrize("hand", [sweep, gesture])
@pytest.mark.parametrize("body", [slid(2, 5.0), slid(0, -9.0), bent(0, 3.5), bent(1, 7.0)])
@pytest.mark.parametrize("away_s", [0.1, 0.17, 0.23])
def test_a_leap_while_the_tracker_was_away_is_doubted_where_a_hand_could_have_gone_as_far(hand, body, away_s) -> None:
    """The pictures went on, and show none of it."""
    cart = Cart(hand)
    cart.away_s = np.array([[1.5 - away_s / 2, 1.5 + away_s / 2]])
    cart.go(1.5).go(2.2, body)
    assert len(cart.doubts) == 1
    assert cart.doubts[0] <= 1.5 + away_s / 2 + 0.2


@pytest.mark.parametrize("hand", [sweep, gesture, trembling])
@pytest.mark.parametrize("away_s", [0.1, 0.17, 0.23])
def test_a_hand_that_goes_on_while_the_tracker_is_away_is_not_doubted(hand, away_s) -> None:
    cart = Cart(hand)
    cart.away_s = np.arange(1.0, 20.0, 0.83)[:, None] + [0.0, away_s]
    assert cart.go(20.0).doubts == []


def test_a_leap_of_the_hand_while_the_tracker_was_away_is_in_the_picture() -> None:
    """6 mm within .2 s, as fast as a hand suddenly goes."""
    way = np.array([5.0, 3.0, 0, 0, 0, 0.05])
    cart = Cart(lambda t_s: sweep(t_s) + way * np.clip((t_s - 1.0) / 0.2, 0, 1))
    cart.away_s = np.array([[1.0, 1.2]])
    assert cart.go(2.0).doubts == []


def test_readings_five_times_a_second_are_too_few_to_doubt_a_hand() -> None:
    assert Cart(gesture, hz=5.0).go(30.0).doubts == []


@pytest.mark.parametrize("hz", [5.0, 8.0, 9.0])
def test_a_step_to_the_last_reading_is_not_weighed_as_nothing_lies_behind_it(hz: float) -> None:
    """Two readings of a slow tracker: no velocity is known after the second."""
    with np.errstate(all="raise"):
        assert Cart(gesture, hz=hz).go(6.0).go(8.0, slid(2, 9.0)).doubts


def test_small_leaps_add_up() -> None:
    cart = Cart().go(1.0).go(2.0, slid(0, 2.2))
    assert cart.faults == []
    cart.go(3.0, slid(0, 4.4))
    assert cart.first == "offset"


def test_a_leap_undone_is_forgiven() -> None:
    cart = Cart().go(1.0).go(2.0, SLID)
    assert cart.first == "offset"
    cart.go(3.0)
    assert {check.verdict for check in cart.slip.checks()} == {VerdictKind.OK}


def test_a_slip_that_takes_two_readings_is_one_leap() -> None:
    cart = Cart().go(1.0).go(1.02, slid(0, 3.5)).go(1.4, SLID)
    assert cart.first == "offset"


def test_nothing_is_concluded_across_a_pause() -> None:
    cart = Cart().go(1.0)
    cart.slip.pause(round(0.99e9))
    assert cart.go(2.0, SLID).faults == []


def test_a_picture_that_is_shown_again_neither_testifies_nor_takes_anything_away() -> None:
    cart = Cart().go(1.0)
    assert not cart.slip.see(Observation(round(0.99e9), PICTURE, repeated=True))
    assert cart.go(1.4, SLID).first == "offset"


def test_a_shift_is_forgiven_once_motion_has_shown_the_offset_and_a_turn_is_not() -> None:
    cart = Cart().go(1.0).go(2.0, SLID @ BENT)
    cart.slip.on_verified(lambda fault: fault == "offset", 2_000_000_000)
    turn, shift, across = cart.slip.checks()
    assert (turn.verdict, shift.verdict, across.value) == (VerdictKind.FAULT, VerdictKind.OK, 0.0)


def test_the_step_of_a_picture_is_that_of_the_plane_in_the_earlier_axes() -> None:
    turn = rotation_from_vector(np.array([0, 0, 0.1]))
    first, second = rigid(np.eye(3), np.array([0.0, 1, 0])), rigid(turn, np.array([2.0, 1, 0]))
    t_a, turned = predicted_motion(TRUTH, first @ X, second @ X)
    u_px = t_a[:2] * TRUTH.polarity / TRUTH.scale_mm_per_px
    alpha = turned[2] * TRUTH.polarity[0] * TRUTH.polarity[1]
    assert plane_step(u_px, alpha, TRUTH) == pytest.approx([2.0, 0.0, 0.1])


def test_a_fit_of_too_few_readings_is_none_and_an_outlier_makes_none_certain() -> None:
    t_s, floor = np.arange(20) / 60, np.full(3, 0.03)
    path = np.zeros((20, 3))
    path[12] = 5.0
    found = fit_leap(t_s, path, 12, floor)
    assert found is not None
    assert found.certain < 3.0
    assert not found.clean
    assert fit_leap(t_s, path, 19, floor) is None
    assert fit_leap(t_s[:4], path[:4], 2, floor) is None
    path[12:] = 5.0
    found = fit_leap(t_s, path, 12, floor)
    assert found is not None
    assert found.size == pytest.approx([5.0, 5.0, 5.0])


def test_what_is_repeated_at_some_lag_and_what_is_not() -> None:
    random, noise = np.random.default_rng(2), np.array([0.1, 0.1])

    def way(t_s: Array) -> Array:
        return np.stack([5 * np.sin(3 * t_s), 3 * np.cos(5 * t_s)], axis=-1) + noise * random.standard_normal(
            (t_s.size, 2)
        )

    past_s, later_s = np.arange(60) / 60, 1 + np.arange(7) / 60
    past = way(past_s)
    assert retraced(past_s, past, later_s, way(later_s - 0.337), noise) < 3
    assert retraced(past_s, past, later_s, way(later_s - 0.05), noise) < 3, "beyond the lag nothing is known"
    assert retraced(past_s, past, later_s, way(later_s - 0.337) + np.array([1.5, 0]), noise) > 10
    assert retraced(past_s, past, later_s, way(later_s - 2.0), noise) > 10
    assert retraced(past_s[:2], past[:2], later_s, way(later_s), noise) == np.inf
