"""Breaks of the picture and blank pictures: what the chain takes for a change, and what for no link."""

from collections.abc import Callable

import numpy as np
import pytest

from probewatch.appliance.core.detectors.picture_chain import PictureChain
from probewatch.appliance.types import VerdictKind
from probewatch.drivers.rigid import rigid
from probewatch.drivers.samples import GreyImage
from tests.appliance.core.detectors.test_picture_chain import (
    BLACK,
    CALM,
    FRAME_NS,
    MM_PER_PX,
    SPOILT,
    STILL,
    WAITS_NS,
    about,
    event,
    layered,
    moved_by,
    other,
    shown,
    speckle,
    step,
    stretched,
    told,
    turned,
    watching,
)


@pytest.fixture
def calm() -> PictureChain:
    detector = event()
    assert shown(detector, [speckle()] * CALM, [True] * CALM) == [{VerdictKind.OK}] * CALM
    return detector


def torn(before: GreyImage, after: GreyImage) -> GreyImage:
    """The upper half of one, the lower of the other."""
    return np.vstack([before[: before.shape[0] // 2], after[before.shape[0] // 2 :]])


def other_gain(image: GreyImage) -> GreyImage:
    return np.clip(image * 1.3 + 10.0, 0, 255).astype(np.uint8)


BROKEN: dict[str, tuple[Callable[[GreyImage], GreyImage], str]] = {
    **{name: (how, "picture-zoom" if name == "zoomed" else "picture-flip") for name, how in SPOILT.items()},
    "zoomed twice": (lambda image: about(image, 2.0, (0.5, 0.0)), "picture-zoom"),
    "zoomed out": (lambda image: about(image, 0.65, (0.5, 0.0)), "picture-zoom"),
    "zoomed about a region of interest": (lambda image: about(image, 1.3, (0.3, 0.7)), "picture-zoom"),
    "a preset: depth, flip and gain": (
        lambda image: other_gain(about(image, 0.75, (0.5, 0.0))[:, ::-1]),
        "picture-flip",
    ),
}


@pytest.mark.parametrize("blank", [0, 1, 6, 8])
@pytest.mark.parametrize("how", BROKEN)
def test_a_break_is_named_whatever_lies_between(how: str, blank: int, calm: PictureChain) -> None:
    """Black pictures for up to a quarter of a second."""
    change, check = BROKEN[how]
    for k in range(blank):
        assert step(calm, (CALM + k) * FRAME_NS, BLACK) is None
        assert not calm.linked
    changed = change(speckle())
    first, second = shown(calm, [changed] * 2, [False, True], CALM + blank)
    assert VerdictKind.NOT_VERIFIED in first
    assert VerdictKind.FAULT in second
    assert check in {one.name for one in calm.checks() if one.verdict is VerdictKind.FAULT}


@pytest.mark.parametrize("how", BROKEN)
def test_a_torn_picture_hides_no_break(how: str) -> None:
    """Also where the registration follows it, and what comes after it."""
    calm = watching([speckle()] * CALM, STILL)
    changed = BROKEN[how][0](speckle())
    step(calm, CALM * FRAME_NS, torn(speckle(), changed), True, STILL)
    step(calm, (CALM + 1) * FRAME_NS, changed, True, STILL)
    step(calm, (CALM + 2) * FRAME_NS, changed, True, STILL)
    assert VerdictKind.FAULT in told(calm)


def test_another_scene_is_no_link_and_begins_a_chain_once_nobody_waits(calm: PictureChain) -> None:
    for k in range(1, 9):
        assert step(calm, (CALM - 1 + k) * FRAME_NS, other(1.0), k > 1, STILL) is None
        assert not calm.linked
    assert step(calm, CALM * FRAME_NS + WAITS_NS, other(1.0), True, STILL) is None
    assert calm.linked
    assert told(calm) == {VerdictKind.OK}


@pytest.mark.parametrize("blank", [0, 1, 8])
@pytest.mark.parametrize("changed", [0.0, 0.4, 0.6])
def test_the_same_tissue_goes_on_with_the_chain_though_its_speckle_changed(
    changed: float, blank: int, calm: PictureChain
) -> None:
    for k in range(blank):
        step(calm, (CALM + k) * FRAME_NS, BLACK)
    step(calm, (CALM + blank) * FRAME_NS, other(changed))
    assert calm.linked
    assert told(calm) == {VerdictKind.OK}


@pytest.mark.parametrize(("way_mm", "linked"), [(0.3, False), (1.2, True)])
def test_a_hand_that_sweeps_past_at_once_ends_no_chain(way_mm: float, linked: bool) -> None:
    """Out of the plane, from one picture to the next: where it goes slower, other tissue is another picture."""
    calm = event()
    for k in range(CALM):
        step(calm, k * FRAME_NS, speckle(), k > 0, STILL if k else None, rigid(np.eye(3), np.zeros(3)))
    step(calm, CALM * FRAME_NS, other(1.0), pose=rigid(np.eye(3), np.array([0.0, 0.0, way_mm])))
    assert calm.linked is linked


def test_a_sweep_explains_no_other_picture_after_a_blank() -> None:
    calm = event()
    for k in range(CALM):
        step(calm, k * FRAME_NS, speckle(), k > 0, STILL if k else None, rigid(np.eye(3), np.zeros(3)))
    step(calm, CALM * FRAME_NS, BLACK, pose=rigid(np.eye(3), np.array([0.0, 0.0, 2.0])))
    step(calm, (CALM + 1) * FRAME_NS, other(1.0), pose=rigid(np.eye(3), np.array([0.0, 0.0, 4.0])))
    assert not calm.linked


def on_the_screen(wide: GreyImage, moved_mm: float) -> GreyImage:
    """The picture of a probe that rests, moved to the right."""
    left = 90 - round(moved_mm / MM_PER_PX)
    return wide[:, left : left + 320].copy()


@pytest.mark.parametrize(("moved_mm", "linked"), [(3.8, False), (1.0, True)])
def test_after_a_blank_tissue_has_gone_no_further_than_tissue_goes(moved_mm: float, linked: bool) -> None:
    """In a tenth of a second a breath moves it by a millimetre; the limit of the offset is 4 mm."""
    wide, calm = speckle((240, 500)), event()
    for k in range(CALM):
        step(calm, k * FRAME_NS, on_the_screen(wide, 0.0), k > 0, STILL if k else None, moved_by((0.0, 0.0)))
    step(calm, (CALM + 3) * FRAME_NS, on_the_screen(wide, moved_mm), pose=moved_by((0.0, 0.0)))
    assert calm.linked is linked


@pytest.mark.parametrize(
    ("across_deg", "down_deg", "linked"),
    [(4.0, 4.0, False), (0.0, 5.0, False), (5.0, 0.0, False), (0.0, 19.0, False), (1.0, 1.0, True)],
)
def test_after_a_blank_a_picture_that_was_turned_or_sheared_is_no_link(
    across_deg: float, down_deg: float, linked: bool
) -> None:
    """The limit of the rotation is 3°."""
    coarse, calm = layered(), event()
    for k in range(CALM):
        step(calm, k * FRAME_NS, coarse, k > 0, STILL if k else None, moved_by((0.0, 0.0)))
    step(calm, (CALM + 3) * FRAME_NS, turned(coarse, across_deg, down_deg), pose=moved_by((0.0, 0.0)))
    assert calm.linked is linked


def test_breaks_that_each_move_the_picture_a_little_move_it_no_further_than_the_limit() -> None:
    wide, calm, t_ns = speckle((240, 500)), event(), 0
    linked = list[bool]()
    for moved_mm in (0.0, 1.5, 3.0, 4.5):
        for k in range(CALM):
            step(calm, t_ns, on_the_screen(wide, moved_mm), k > 0, STILL if k else None, moved_by((0.0, 0.0)))
            linked += [calm.linked] if k == 0 else []
            t_ns += FRAME_NS
        t_ns += 4 * FRAME_NS
    assert linked == [True, True, True, False]


@pytest.mark.parametrize(("told_mm", "linked"), [(0.0, False), (6.0, True)])
def test_tissue_that_is_elsewhere_than_the_tracker_says_is_no_link(told_mm: float, linked: bool) -> None:
    """The picture has gone 6 mm across, by a hand or on the screen: the limit of the offset is 4 mm."""
    wide = speckle((240, 500))
    calm = event()
    for k in range(CALM):
        step(calm, k * FRAME_NS, wide[:, 90:410].copy(), k > 0, STILL if k else None, moved_by((0.0, 0.0)))
    step(calm, (CALM + 3) * FRAME_NS, wide[:, 30:350].copy(), pose=moved_by((told_mm, 0.0)))
    assert calm.linked is linked


def test_a_menu_over_a_third_of_the_picture_ends_no_chain(calm: PictureChain) -> None:
    menu = speckle()
    menu[:, 220:] = np.where(np.indices((240, 100)).sum(axis=0) // 8 % 2, 230, 20)
    for k in range(20):
        step(calm, (CALM + k) * FRAME_NS, menu, k > 0, STILL)
        assert calm.linked
    for k in range(20, 25):
        step(calm, (CALM + k) * FRAME_NS, speckle(), k > 20, STILL)
        assert calm.linked
    assert told(calm) == {VerdictKind.OK}


def test_a_break_is_seen_across_a_stamp_that_was_wrong(calm: PictureChain) -> None:
    """Pictures were stamped wrongly and are forgotten; what follows goes on from the last of them."""
    step(calm, CALM * FRAME_NS, speckle(), True, STILL)
    calm.forget_pictures((CALM - 1) * FRAME_NS)
    shown(calm, [speckle()[:, ::-1].copy()] * 2, [False, True], CALM)
    assert told(calm) == {VerdictKind.OK, VerdictKind.FAULT}


@pytest.mark.parametrize(("pressed_mm", "named"), [(0.0, True), (2.4, False)])
def test_a_stretch_that_the_press_of_the_face_explains_has_no_name(pressed_mm: float, named: bool) -> None:
    """It is a change all the same. The face went down by a tenth of the picture's height while it was black: tissue is
    strained by up to as much.
    """
    calm, face = event(), moved_by((0.0, 0.0))
    for k in range(CALM):
        step(calm, k * FRAME_NS, speckle(), k > 0, STILL if k else None, face)
    for k in range(6):
        step(calm, (CALM + k) * FRAME_NS, BLACK, pose=face)
    strained, face = stretched(speckle(), 1.0, 0.92, (0.5, 1.0)), moved_by((0.0, pressed_mm))
    assert step(calm, (CALM + 6) * FRAME_NS, strained, pose=face) is not None
    step(calm, (CALM + 7) * FRAME_NS, strained, True, STILL, face)
    assert (VerdictKind.FAULT in told(calm)) is named
