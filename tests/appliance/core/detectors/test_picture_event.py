"""Changes of the picture's geometry between two frames: named where they stay, and not where one picture is spoilt."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from appliance.core.detectors.picture_event import PictureEvent
from appliance.types import VerdictKind
from drivers.samples import GreyImage

FRAME_NS = 33_000_000
CALM = 8
"""Pictures that were followed before anything happens."""


QUICK_PX = np.array([20.0, -8.0])
"""Between two pictures: 30 mm/s at 30 Hz, of a picture 16 mm wide."""


def speckle(shape: tuple[int, int] = (240, 320)) -> GreyImage:
    noise = np.random.default_rng(4).normal(size=shape).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.5)
    return np.asarray(np.clip(128 + 45 * smooth / smooth.std(), 0, 255), dtype=np.uint8)


def sweep(pictures: int) -> list[GreyImage]:
    """Of a quick hand: what lies in the picture goes by QUICK_PX."""
    wide = speckle((480, 700))
    starts = [(np.array([350, 120]) - k * QUICK_PX).astype(int) for k in range(pictures)]
    return [wide[row : row + 240, column : column + 320].copy() for column, row in starts]


def zoomed(image: GreyImage) -> GreyImage:
    """As a shallower depth setting shows it, from the middle of the top edge."""
    M = np.array([[1.2, 0, -0.1 * (image.shape[1] - 1)], [0, 1.2, 0]])
    return cv2.warpAffine(image, M, image.shape[::-1]).astype(np.uint8)


def stretched(image: GreyImage, across: float, down: float, about: tuple[float, float] = (0.5, 0.5)) -> GreyImage:
    """As a grabber shows it that scales the two axes differently. about: share of width and height that stays."""
    factors, place = np.array([across, down]), np.array(about) * np.array(image.shape[::-1])
    M = np.column_stack([np.diag(factors), place * (1 - factors)])
    return cv2.warpAffine(image, M, image.shape[::-1]).astype(np.uint8)


SPOILT: dict[str, Callable[[GreyImage], GreyImage]] = {
    "mirrored": lambda image: image[:, ::-1].copy(),
    "upside down": lambda image: image[::-1].copy(),
    "zoomed": zoomed,
}


def followed_quickly(pictures: list[GreyImage]) -> PictureEvent:
    detector = PictureEvent(5.0, 1.0)
    for k, image in enumerate(pictures):
        detector.step(k * FRAME_NS, image, k > 0, (QUICK_PX, 0.0) if k else None)
    return detector


STRETCHES = [(1.1, 1.0), (0.9, 1.0), (1.0, 1.1), (1.0, 0.9), (1.06, 1.0), (1.0, 0.94), (1.15, 1.0), (0.93, 0.93)]
WORSE = {0.93: -7.0, 0.94: -6.0, 1.15: 15.0, 1.06: 6.0, 1.1: 10.0, 0.9: -10.0}
STILL = (np.zeros(2), 0.0)


def watching(pictures: list[GreyImage], course: tuple[np.ndarray, float]) -> PictureEvent:
    """All of them followed, each with its way since the one before."""
    detector = PictureEvent(5.0, 1.0)
    for k, image in enumerate(pictures):
        detector.step(k * FRAME_NS, image, k > 0, course if k else None)
    assert told(detector) == {VerdictKind.OK}
    return detector


def zoom_of(detector: PictureEvent) -> tuple[VerdictKind, float]:
    return next((check.verdict, check.value) for check in detector.checks() if check.name == "picture-zoom")


@pytest.mark.parametrize("followed", [True, False])
@pytest.mark.parametrize("about", [(0.5, 0.5), (0.5, 0.0), (0.0, 0.0)])
@pytest.mark.parametrize(("across", "down"), STRETCHES)
def test_a_stretch_is_seen_at_once_whether_or_not_the_picture_was_followed(across, down, about, followed) -> None:
    """Also where the registration took it for another place, as it does with small ones."""
    calm, changed = watching([speckle()] * CALM, STILL), stretched(speckle(), across, down, about)
    warp = (np.array([1.5, -2.0]), 0.01) if followed else None
    change = calm.step(CALM * FRAME_NS, changed, followed, warp)
    assert change is not None
    assert change.zoom == pytest.approx((across, down), abs=0.015)
    assert zoom_of(calm)[0] is VerdictKind.NOT_VERIFIED
    calm.step((CALM + 1) * FRAME_NS, changed, True, STILL)
    worse = WORSE[across if across != 1 else down]
    assert zoom_of(calm) == (VerdictKind.FAULT, pytest.approx(worse, abs=1.5))


@pytest.mark.parametrize(("across", "down"), STRETCHES[:4])
def test_one_stretched_picture_is_never_a_fault(across, down) -> None:
    calm = watching([speckle()] * CALM, STILL)
    calm.step(CALM * FRAME_NS, stretched(speckle(), across, down), True, STILL)
    for k in range(1, 4):
        calm.step((CALM + k) * FRAME_NS, speckle(), True, STILL)
        assert told(calm) == {VerdictKind.OK}


@pytest.mark.parametrize(("across", "down"), STRETCHES[:4])
def test_a_stretch_during_quick_motion_is_seen(across, down) -> None:
    pictures = sweep(CALM + 2)
    detector = watching(pictures[:CALM], (QUICK_PX, 0.0))
    detector.step(CALM * FRAME_NS, stretched(pictures[CALM], across, down), True, (0.7 * QUICK_PX, 0.02))
    detector.step((CALM + 1) * FRAME_NS, stretched(pictures[CALM + 1], across, down), True, (QUICK_PX, 0.0))
    assert zoom_of(detector)[0] is VerdictKind.FAULT


def test_a_picture_that_was_followed_badly_but_is_not_stretched_is_no_change() -> None:
    """The hand turned, or the registration went astray: parts of the picture have not moved apart."""
    calm = watching([speckle()] * CALM, STILL)
    assert calm.step(CALM * FRAME_NS, speckle(), True, (np.array([9.0, 5.0]), 0.0)) is None
    grainy = speckle().astype(np.float32) + np.random.default_rng(5).normal(0, 60, (240, 320))
    assert calm.step((CALM + 1) * FRAME_NS, np.clip(grainy, 0, 255).astype(np.uint8), True, STILL) is None
    assert told(calm) == {VerdictKind.OK}


def told(detector: PictureEvent) -> set[VerdictKind]:
    return {check.verdict for check in detector.checks()}


def shown(
    detector: PictureEvent, pictures: list[GreyImage], followed: list[bool], start: int = 0
) -> list[set[VerdictKind]]:
    """What is told after each."""
    said = []
    for k, (image, seen) in enumerate(zip(pictures, followed, strict=True), start):
        detector.step(k * FRAME_NS, image, seen)
        said.append(told(detector))
    return said


@pytest.fixture
def calm() -> PictureEvent:
    detector = PictureEvent(5.0, 1.0)
    assert shown(detector, [speckle()] * CALM, [True] * CALM) == [{VerdictKind.OK}] * CALM
    return detector


@pytest.mark.parametrize("how", SPOILT)
def test_what_stays_is_named_with_the_second_picture(how: str, calm: PictureEvent) -> None:
    changed = SPOILT[how](speckle())
    first, second, third = shown(calm, [changed] * 3, [False, True, True], CALM)
    assert first == {VerdictKind.OK, VerdictKind.NOT_VERIFIED}
    assert second == third == {VerdictKind.OK, VerdictKind.FAULT}


@pytest.mark.parametrize("how", SPOILT)
def test_one_spoilt_picture_is_never_a_fault(how: str, calm: PictureEvent) -> None:
    first, *after = shown(calm, [SPOILT[how](speckle()), *[speckle()] * 6], [False, False, *[True] * 5], CALM)
    assert first == {VerdictKind.OK, VerdictKind.NOT_VERIFIED}
    assert after == [{VerdictKind.OK}] * 6


@pytest.mark.parametrize("how", SPOILT)
def test_a_change_during_quick_motion_is_seen(how: str) -> None:
    pictures = sweep(CALM + 3)
    detector = followed_quickly(pictures[:CALM])
    first, second, _ = shown(detector, [SPOILT[how](one) for one in pictures[CALM:]], [False, True, True], CALM)
    assert first == {VerdictKind.OK, VerdictKind.NOT_VERIFIED}
    assert second == {VerdictKind.OK, VerdictKind.FAULT}


@pytest.mark.parametrize("how", SPOILT)
def test_one_spoilt_picture_during_quick_motion_is_never_a_fault(how: str) -> None:
    pictures = sweep(CALM + 3)
    detector = followed_quickly(pictures[:CALM])
    said = shown(detector, [SPOILT[how](pictures[CALM]), *pictures[CALM + 1 :]], [False, False, True], CALM)
    assert said == [{VerdictKind.OK, VerdictKind.NOT_VERIFIED}, {VerdictKind.OK}, {VerdictKind.OK}]


def test_quick_motion_alone_is_no_change() -> None:
    """Also where nobody could follow it."""
    pictures = sweep(CALM + 3)
    detector = followed_quickly(pictures[:CALM])
    assert shown(detector, pictures[CALM:], [False] * 3, CALM) == [{VerdictKind.OK}] * 3


def test_a_picture_that_comes_late_confirms_nothing_back(calm: PictureEvent) -> None:
    """After a gap the picture before says nothing: what was seen to change stays changed."""
    calm.step(CALM * FRAME_NS, speckle()[:, ::-1].copy(), False)
    calm.step((CALM + 30) * FRAME_NS, speckle(), False)
    assert told(calm) == {VerdictKind.OK, VerdictKind.FAULT}
