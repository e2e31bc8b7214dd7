"""What the motion says that tissue may do, from paths whose tissue is known."""

from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.path.tissue_compliance import TissueMotion
from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import DRAGS, PRESSES, Calibration, TissuePath
from probewatch.drivers.rigid import Array, rigid, rotation_from_vector
from tests.support.motions import TRUTH, planar_path, tilting_path
from tests.support.windows import elevational_path, filled

ALL = DRAGS | PRESSES
LIMIT = Limits().scale_percent / 100


def window(seconds: float, follows: float = 0.0, drags: float = 0.0, noise: float = 1.0) -> PathWindow:
    """Of a hand that moves in the plane. follows, drags: shares of a press and of a slide by which skin goes along.
    noise: of what a picture of 21 mm in depth shows, as large as it was found there.
    """
    return with_tissue(filled(planar_path, seconds), follows, drags, noise)


def with_tissue(
    plain: PathWindow, follows: float = 0.0, drags: float = 0.0, noise: float = 1.0, reference: Calibration = TRUTH
) -> PathWindow:
    """Path k of the tissue is k px beside that of the picture."""
    random, found = np.random.default_rng(1), PathWindow(reference)
    found.poses = plain.poses
    for motion in plain._seen:
        tilt_rad = (1 - follows) * motion.path_rad + random.normal(0, 7e-4 * noise)
        drag_px = -drags * motion.path_px[0] + random.normal(0, 1.5 * noise, 4)
        path_px = np.array([motion.path_px + k for k in range(4)])
        tissue = TissuePath(path_px, np.full(4, motion.path_rad), drag_px, tilt_rad)
        found.add(replace(motion, tissue=tissue))
    return found


@pytest.mark.parametrize(
    ("follows", "drags", "may"),
    [(0.0, 0.0, 0), (0.0, 0.4, DRAGS), (0.15, 0.0, ALL), (0.6, 0.0, ALL), (0.6, 0.4, ALL), (-0.2, 0.0, ALL)],
)
def test_what_ten_seconds_show(follows: float, drags: float, may: int) -> None:
    assert window(10.0, follows, drags).look_at_tissue(0.0, LIMIT) == may


@pytest.mark.parametrize(("rows", "drags", "may"), [(640, 0.0, PRESSES), (640, 0.4, ALL), (480, 0.0, ALL)])
def test_only_deep_pictures_tell_skin_that_does_not_drag_over_tissue_that_follows(
    rows: int, drags: float, may: int
) -> None:
    """45 mm and 34: in shallow ones what is pressed out sideways would pass for a wrong axial scale."""
    reference = replace(TRUTH, image_size_px=(640, rows))
    plain = filled(planar_path, 10.0, truth=reference, reference=reference)
    assert with_tissue(plain, 0.6, drags, reference=reference).look_at_tissue(0.0, LIMIT) == may


def test_until_it_is_shown_tissue_may_do_all() -> None:
    assert PathWindow(TRUTH).tissue == ALL
    assert window(1.0).look_at_tissue(0.0, LIMIT) == ALL
    assert window(10.0, noise=60.0).look_at_tissue(0.0, LIMIT) == ALL
    assert with_tissue(filled(elevational_path, 10.0)).look_at_tissue(0.0, LIMIT) == ALL


def path(window: PathWindow) -> Array:
    return window.samples(0.0).u_px - np.array([motion.path_px for motion in window._seen])


@pytest.mark.parametrize(("drags", "may"), [(0.0, 0), (0.4, DRAGS)])
def test_the_path_is_the_one_of_such_tissue_and_parts_of_a_window_have_it_as_well(drags: float, may: int) -> None:
    whole = window(10.0, drags=drags)
    whole.look_at_tissue(0.0, LIMIT)
    part = whole.since(whole.now_ns - 500_000_000)
    assert part.tissue == may
    for each in whole, part, whole.as_now():
        np.testing.assert_allclose(path(each), may)
        assert each.samples(0.0).rigid


def test_what_was_shown_stands_until_motion_contradicts_it() -> None:
    known = window(10.0)
    assert known.look_at_tissue(0.0, LIMIT) == 0
    motions = list(known._seen)
    still = replace(motions[-1], stamp=replace(motions[-1].stamp, t_ns=motions[-1].stamp.t_ns + 35_000_000_000))
    known.add(still)
    assert len(known) == 1
    assert known.look_at_tissue(0.0, LIMIT) == 0, "nothing of it is in the window any more"
    known.restart()
    assert known.tissue == 0, "the tissue is the same under another calibration"
    known.restart()
    known.forget_tissue()
    assert known.tissue == ALL


def rigid_window() -> PathWindow:
    known = window(10.0)
    known.look_at_tissue(0.0, LIMIT)
    return known


def test_rigid_tissue_is_known_by_a_tracker_that_is_late() -> None:
    """By .2 s the picture tilts before the tracker turns."""
    late = with_tissue(filled(planar_path, 10.0, late_s=0.2))
    assert late.look_at_tissue(0.0, LIMIT) == ALL
    assert late.look_at_tissue(0.2, LIMIT) == 0


@pytest.mark.parametrize("late_s", [0.1, 0.2, 0.45])
def test_rigid_tissue_stays_rigid_as_a_tracker_begins_to_lag(late_s: float) -> None:
    late = with_tissue(filled(planar_path, 10.0, late_s=late_s))
    late.take_tissue(rigid_window())
    assert late.look_at_tissue(0.0, LIMIT) == 0


@pytest.mark.parametrize(("follows", "may"), [(0.0, 0), (0.5, ALL)])
def test_a_probe_that_is_held_otherwise_than_the_reference_says_is_no_softer(follows: float, may: int) -> None:
    """As another probe is: by 30°, which tilts the axis about which the picture turns."""
    turned = replace(TRUTH, rotation=rotation_from_vector(np.deg2rad([30.0, 0.0, 0.0])) @ TRUTH.rotation)
    other = with_tissue(filled(tilting_path, 10.0, reference=turned), follows, reference=turned)
    assert other.look_at_tissue(0.0, LIMIT) == may


def test_rigid_tissue_that_turns_out_to_follow_is_rigid_no_more() -> None:
    soft, known = window(20.0, follows=0.5), PathWindow(TRUTH)
    known.poses = soft.poses
    known.take_tissue(rigid_window())
    for motion in soft._seen:
        known.add(motion)
    assert known.tissue == 0
    assert known.look_at_tissue(0.0, LIMIT) == ALL


def test_motion_of_which_nothing_is_known_but_that_it_is_rigid() -> None:
    assert filled(planar_path, 1.0).tissue == 0


def hidden(follows: float) -> PathWindow:
    """Over tissue that follows by so much, and the axial scale is as much too small: ∂u_y/∂x is that of the probe."""
    plain, found = filled(planar_path, 10.0), PathWindow(TRUTH)
    found.poses = plain.poses
    for motion in with_tissue(plain)._seen:
        assert motion.tissue is not None
        found.add(replace(motion, tissue=replace(motion.tissue, path_rad=motion.tissue.path_rad * (1 - follows))))
    return found


def test_what_rigid_tissue_hides_is_what_is_known_and_what_is_not() -> None:
    assert TissueMotion(0, (0.04, 0.01)).hides == pytest.approx(np.hypot(0.03, 0.01))
    assert TissueMotion(0, (-0.02, 0.03)).hides == pytest.approx(0.03)
    assert TissueMotion(0).hides == 0.05, "nothing is known of it"
    assert TissueMotion(PRESSES, (0.2, 0.01)).hides == 0, "the model of the tissue follows it"


def test_what_rigid_tissue_hides_is_taken_from_the_motion_that_showed_it_best() -> None:
    soft, clear, vague = TissueMotion(3, (0.2, 0.001)), TissueMotion(0, (0.04, 0.01)), TissueMotion(0, (0.02, 0.05))
    assert clear.after(soft) == clear
    assert vague.after(clear) == clear
    assert clear.after(vague) == clear
    assert vague.after(soft) == vague


def test_what_rigid_tissue_hides_is_known_until_it_is_forgotten() -> None:
    known = hidden(0.03)
    known.look_at_tissue(0.0, LIMIT)
    assert known.tissue == 0
    assert known.registered_as == PRESSES, "registered as rigid it would show less"
    assert known.samples(0.0).hides == pytest.approx(0.03, abs=0.01)
    assert known.since(known.now_ns - 3_000_000_000).samples(0.0).hides == known.samples(0.0).hides
    known.forget_tissue()
    assert known.samples(0.0).hides == 0
    assert rigid_window().registered_as == 0


@pytest.mark.parametrize(("follows", "scale_limit", "presses"), [
    (0.1, LIMIT, True), (0.03, LIMIT, False), (0.03, 0.02, True), (0.0, 0.02, False),
])  # fmt: skip
def test_a_wrong_axial_scale_does_not_make_tissue_that_follows_rigid(
    follows: float, scale_limit: float, presses: bool
) -> None:
    """∂u_x/∂y tells, to within the limit of a scale."""
    assert bool(hidden(follows).look_at_tissue(0.0, scale_limit) & PRESSES) == presses


def test_what_may_be_drag_of_the_skin_does_not_hide_that_tissue_follows() -> None:
    """A hand that hardly slides does not exclude drag, and read as drag as well the shear is that of rigid tissue. So a
    hand that rocked about an oblique axis over foam closed the contact on −10 % for 9 s.
    """
    plain = filled(planar_path, 10.0)
    hidden = PathWindow(TRUTH)
    hidden.poses = plain.poses
    for motion in with_tissue(plain, drags=0.4)._seen:
        assert motion.tissue is not None
        told = np.where(np.arange(4) == PRESSES, 0.9, 1.0)
        hidden.add(replace(motion, tissue=replace(motion.tissue, path_rad=motion.tissue.path_rad * told)))
    assert hidden.look_at_tissue(0.0, LIMIT) & PRESSES


def oblique(seconds: float, aslant: float, follows: float = 0.0, drags: float = 0.0) -> PathWindow:
    """Returns the window of a hand that turns about one oblique axis. aslant: lateral turn ÷ elevational turn."""

    def path(t_s: Array) -> Array:
        turn_rad = 0.1 * np.sin(1.7 * t_s)
        turns = np.stack([aslant * turn_rad, 0 * t_s, turn_rad], axis=1)
        return rigid(rotation_from_vector(turns), planar_path(t_s)[:, :3, 3])

    return with_tissue(filled(path, seconds), follows, drags, noise=0.1)


@pytest.mark.parametrize("aslant", [0.15, 0.3, 0.5])
@pytest.mark.parametrize(("follows", "drags", "may"), [(0.0, 0.0, 0), (0.15, 0.0, ALL), (0.0, 0.4, DRAGS)])
def test_a_hand_that_turns_about_one_oblique_axis_shows_what_tissue_does(
    aslant: float, follows: float, drags: float, may: int
) -> None:
    assert oblique(20.0, aslant, follows, drags).look_at_tissue(0.0, LIMIT) == may


def test_a_turn_half_way_to_the_lateral_axis_shows_no_tissue_to_be_rigid() -> None:
    """A rotation that is wrong by its limit would pass for a share of .05."""
    assert oblique(20.0, 1.0).look_at_tissue(0.0, LIMIT) == ALL
