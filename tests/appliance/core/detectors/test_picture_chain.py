"""Changes of the picture's geometry between two frames: named where they stay, and not where one picture is spoilt."""

from collections.abc import Callable
from itertools import accumulate, pairwise

import cv2
import numpy as np
import pytest

from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.core.detectors.picture_chain import PictureChain
from probewatch.appliance.core.detectors.picture_change import PictureChange
from probewatch.appliance.core.registration.realtime_tracker import Warp
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration, VerdictKind
from probewatch.drivers.rigid import rigid
from probewatch.drivers.samples import GreyImage, Matrix4

FRAME_NS = 33_000_000
WAITS_NS = 300_000_000
BREATH_MM_PER_S = 12.0
"""Of a quick deep breath: one of 12 mm, fifteen a minute, has 9.4."""
CALM = 8
"""Pictures that were followed before anything happens."""


QUICK_PX = np.array([20.0, -8.0])
"""Between two pictures: 30 mm/s at 30 Hz, of a picture 16 mm wide."""


MM_PER_PX = 0.1
REFERENCE = Calibration(np.eye(3), (1, 1), np.full(2, MM_PER_PX), np.zeros(3), (320, 240))
"""The marker body sits in the picture's middle, in its axes."""


def event() -> PictureChain:
    return PictureChain(Limits(scale_percent=5.0), REFERENCE, lambda: None, lambda: True, WAITS_NS)


def step(
    detector: PictureChain,
    t_ns: int,
    image: GreyImage,
    followed: bool = False,
    warp: Warp | None = None,
    pose: Matrix4 | None = None,
) -> PictureChange | None:
    return detector.step(Observation(t_ns, image, repeated=False, followed=followed, warp=warp, pose=pose))


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


def followed_quickly(pictures: list[GreyImage]) -> PictureChain:
    detector = event()
    for k, image in enumerate(pictures):
        step(detector, k * FRAME_NS, image, k > 0, (QUICK_PX, 0.0) if k else None)
    return detector


STRETCHES = [(1.1, 1.0), (0.9, 1.0), (1.0, 1.1), (1.0, 0.9), (1.06, 1.0), (1.0, 0.94), (1.15, 1.0), (0.93, 0.93)]
WORSE = {0.93: -7.0, 0.94: -6.0, 1.15: 15.0, 1.06: 6.0, 1.1: 10.0, 0.9: -10.0}
STILL = (np.zeros(2), 0.0)


def watching(pictures: list[GreyImage], course: tuple[np.ndarray, float]) -> PictureChain:
    """All of them followed, each with its way since the one before."""
    detector = event()
    for k, image in enumerate(pictures):
        step(detector, k * FRAME_NS, image, k > 0, course if k else None)
    assert told(detector) == {VerdictKind.OK}
    return detector


def zoom_of(detector: PictureChain) -> tuple[VerdictKind, float]:
    return next((check.verdict, check.value) for check in detector.checks() if check.name == "picture-zoom")


@pytest.mark.parametrize("followed", [True, False])
@pytest.mark.parametrize("about", [(0.5, 0.5), (0.5, 0.0), (0.0, 0.0)])
@pytest.mark.parametrize(("across", "down"), STRETCHES)
def test_a_stretch_is_seen_at_once_whether_or_not_the_picture_was_followed(across, down, about, followed) -> None:
    """Also where the registration took it for another place, as it does with small ones."""
    calm, changed = watching([speckle()] * CALM, STILL), stretched(speckle(), across, down, about)
    warp = (np.array([1.5, -2.0]), 0.01) if followed else None
    change = step(calm, CALM * FRAME_NS, changed, followed, warp)
    assert change is not None
    assert change.zoom == pytest.approx((across, down), abs=0.015)
    assert zoom_of(calm)[0] is VerdictKind.NOT_VERIFIED
    step(calm, (CALM + 1) * FRAME_NS, changed, True, STILL)
    worse = WORSE[across if across != 1 else down]
    assert zoom_of(calm) == (VerdictKind.FAULT, pytest.approx(worse, abs=1.5))


@pytest.mark.parametrize(("across", "down"), STRETCHES[:4])
def test_one_stretched_picture_is_never_a_fault(across, down) -> None:
    calm = watching([speckle()] * CALM, STILL)
    step(calm, CALM * FRAME_NS, stretched(speckle(), across, down), True, STILL)
    for k in range(1, 4):
        step(calm, (CALM + k) * FRAME_NS, speckle(), True, STILL)
        assert told(calm) == {VerdictKind.OK}


@pytest.mark.parametrize(("across", "down"), STRETCHES[:4])
def test_a_stretch_during_quick_motion_is_seen(across, down) -> None:
    pictures = sweep(CALM + 2)
    detector = watching(pictures[:CALM], (QUICK_PX, 0.0))
    step(detector, CALM * FRAME_NS, stretched(pictures[CALM], across, down), True, (0.7 * QUICK_PX, 0.02))
    step(detector, (CALM + 1) * FRAME_NS, stretched(pictures[CALM + 1], across, down), True, (QUICK_PX, 0.0))
    assert zoom_of(detector)[0] is VerdictKind.FAULT


def test_a_picture_that_was_followed_badly_but_is_not_stretched_is_no_change() -> None:
    """The hand turned, or the registration went astray: parts of the picture have not moved apart."""
    calm = watching([speckle()] * CALM, STILL)
    assert step(calm, CALM * FRAME_NS, speckle(), True, (np.array([9.0, 5.0]), 0.0)) is None
    grainy = speckle().astype(np.float32) + np.random.default_rng(5).normal(0, 60, (240, 320))
    assert step(calm, (CALM + 1) * FRAME_NS, np.clip(grainy, 0, 255).astype(np.uint8), True, STILL) is None
    assert told(calm) == {VerdictKind.OK}


def told(detector: PictureChain) -> set[VerdictKind]:
    return {check.verdict for check in detector.checks()}


def shown(
    detector: PictureChain, pictures: list[GreyImage], followed: list[bool], start: int = 0
) -> list[set[VerdictKind]]:
    """What is told after each."""
    said = []
    for k, (image, seen) in enumerate(zip(pictures, followed, strict=True), start):
        step(detector, k * FRAME_NS, image, seen)
        said.append(told(detector))
    return said


@pytest.fixture
def calm() -> PictureChain:
    detector = event()
    assert shown(detector, [speckle()] * CALM, [True] * CALM) == [{VerdictKind.OK}] * CALM
    return detector


@pytest.mark.parametrize("how", SPOILT)
def test_what_stays_is_named_with_the_second_picture(how: str, calm: PictureChain) -> None:
    changed = SPOILT[how](speckle())
    first, second, third = shown(calm, [changed] * 3, [False, True, True], CALM)
    assert first == {VerdictKind.OK, VerdictKind.NOT_VERIFIED}
    assert second == third == {VerdictKind.OK, VerdictKind.FAULT}


@pytest.mark.parametrize("how", SPOILT)
def test_one_spoilt_picture_is_never_a_fault(how: str, calm: PictureChain) -> None:
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


def test_a_picture_that_comes_late_confirms_nothing_back(calm: PictureChain) -> None:
    """After a gap the picture before says nothing: what was seen to change stays changed."""
    step(calm, CALM * FRAME_NS, speckle()[:, ::-1].copy(), False)
    step(calm, (CALM + 30) * FRAME_NS, speckle(), False)
    assert told(calm) == {VerdictKind.OK, VerdictKind.FAULT}


def about(image: GreyImage, zoom: float, place: tuple[float, float]) -> GreyImage:
    return stretched(image, zoom, zoom, place)


BLACK = np.zeros((240, 320), np.uint8)


def other(share: float, seed: int = 9) -> GreyImage:
    """The speckle with so much of another in it: correlated by the root of what is left."""
    noise = np.random.default_rng(seed).normal(size=(240, 320)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.5)
    own = speckle().astype(np.float32) - 128
    mixed = np.sqrt(1 - share) * own + np.sqrt(share) * 45 * smooth / smooth.std()
    return np.clip(128 + mixed, 0, 255).astype(np.uint8)


def moved_by(way_mm: tuple[float, float]) -> Matrix4:
    """Sensor → tracker of a probe whose tissue went so far, with the reference above."""
    return np.asarray(rigid(np.eye(3), -np.array([*way_mm, 0.0])))


def layered() -> GreyImage:
    """Coarse speckle, as layers are: it is alike though it lies a few px beside."""
    return np.asarray(cv2.resize(speckle((60, 80)), (320, 240), interpolation=cv2.INTER_CUBIC), np.uint8)


def turned(image: GreyImage, across_deg: float, down_deg: float) -> GreyImage:
    """Lines across and lines down turned by so much about the middle."""
    across, down = np.tan(np.deg2rad([across_deg, down_deg]))
    M, middle = np.array([[1.0, -down], [across, 1.0]]), (np.array(image.shape[::-1]) - 1) / 2
    return cv2.warpAffine(image, np.column_stack([M, middle - M @ middle]), image.shape[::-1]).astype(np.uint8)


def animated(across: float, down: float, pictures: int = 15) -> list[GreyImage]:
    """Over half a second, about the middle; then it stays."""
    shares = np.minimum(np.arange(1, pictures + 6) / pictures, 1.0)
    return [stretched(speckle(), across**share, down**share) for share in shares]


@pytest.mark.parametrize("zoom", [1.3, 1.15, 0.8])
def test_an_animated_zoom_is_named(zoom: float, calm: PictureChain) -> None:
    """The registration follows each of its pictures."""
    changes = [step(calm, (CALM + k) * FRAME_NS, image, True, STILL) for k, image in enumerate(animated(zoom, zoom))]
    assert any(change is not None for change in changes)
    assert zoom_of(calm)[0] is VerdictKind.FAULT
    assert zoom_of(calm)[1] == pytest.approx(100 * (zoom - 1), abs=11.0), "the last 7 % may be left"


@pytest.mark.parametrize(("across", "down"), [(1.2, 1.0), (1.0, 1.2)])
def test_an_animated_stretch_is_a_change_without_a_name(across: float, down: float, calm: PictureChain) -> None:
    """Tissue under a hand that presses is strained along one axis as well."""
    pictures = animated(across, down)
    changes = [step(calm, (CALM + k) * FRAME_NS, image, True, STILL) for k, image in enumerate(pictures)]
    assert PictureChange() in changes
    assert told(calm) == {VerdictKind.OK}


def fading(before: GreyImage, after: GreyImage, pictures: int, stays: int) -> list[GreyImage]:
    shares = np.minimum(np.arange(1, pictures + stays) / pictures, 1.0)
    return [np.asarray(cv2.addWeighted(before, 1 - share, after, share, 0), np.uint8) for share in shares]


@pytest.mark.parametrize("pictures", [3, 8, 18])
@pytest.mark.parametrize(("across_deg", "down_deg"), [(5.0, 5.0), (8.0, 8.0), (-12.0, -12.0), (20.0, 20.0), (0.0, 9.0)])
def test_what_fades_into_a_turned_or_sheared_picture_at_rest_is_a_change_without_a_name(
    across_deg: float, down_deg: float, pictures: int
) -> None:
    """About its middle a turned picture is like the one before."""
    coarse, at_rest = layered(), moved_by((0.0, 0.0))
    shown = [*[coarse] * 30, *fading(coarse, turned(coarse, across_deg, down_deg), pictures, 12)]
    calm = event()
    changes = [step(calm, k * FRAME_NS, image, k > 0, STILL if k else None, at_rest) for k, image in enumerate(shown)]
    assert PictureChange() in changes[30:]
    assert changes[:30] == [None] * 30
    assert told(calm) == {VerdictKind.OK}


@pytest.mark.parametrize(("across", "down", "named"), [(0.96, 1.14, False), (1.0, 1.2, False), (1.2, 1.2, True)])
def test_what_fades_into_a_picture_that_is_stretched_along_one_axis_is_a_change_without_a_name(
    across: float, down: float, named: bool
) -> None:
    """A breath strains soft tissue so; a scanner's zoom is alike along both."""
    before, at_rest = speckle(), moved_by((0.0, 0.0))
    shown = [*[before] * 30, *fading(before, stretched(before, across, down), 4, 20)]
    calm = event()
    changes = [step(calm, k * FRAME_NS, image, k > 0, STILL if k else None, at_rest) for k, image in enumerate(shown)]
    assert changes[:30] == [None] * 30
    assert any(change is not None for change in changes[30:])
    assert (zoom_of(calm)[0] is VerdictKind.FAULT) is named


@pytest.mark.parametrize("pictures", [3, 8, 18])
@pytest.mark.parametrize("moved_mm", [4.8, -6.0, 9.0])
def test_what_fades_into_a_picture_that_was_moved_is_a_change_without_a_name(moved_mm: float, pictures: int) -> None:
    """The limit of the offset is 4 mm, the picture 32 mm wide; the registration sees nothing of it."""
    wide, at_rest = speckle((240, 520)), moved_by((0.0, 0.0))
    before, after = (wide[:, left : left + 320].copy() for left in (100, 100 - round(moved_mm / MM_PER_PX)))
    shown = [*[before] * 30, *fading(before, after, pictures, 24)]
    calm = event()
    changes = [step(calm, k * FRAME_NS, image, k > 0, STILL if k else None, at_rest) for k, image in enumerate(shown)]
    assert PictureChange() in changes[30:]
    assert changes[:30] == [None] * 30


@pytest.mark.parametrize("swept_px", [0, 8])
def test_tissue_that_a_breath_moves_under_a_probe_at_rest_is_no_change(swept_px: int) -> None:
    """By 6 mm in half a second, and the registration follows it, also where it has just followed a quick hand."""
    wide, at_rest = speckle((240, 700)), moved_by((0.0, 0.0))
    ways_px = [swept_px] * 10 + [-round(BREATH_MM_PER_S * FRAME_NS / 1e9 / MM_PER_PX)] * 30
    starts = list(accumulate(ways_px, initial=200))
    ways = [None, *((np.array([one - other, 0.0]), 0.0) for one, other in pairwise(starts))]
    calm = event()
    for k, (left, way) in enumerate(zip(starts, ways, strict=True)):
        place = at_rest if k >= 10 else moved_by((-swept_px * (k - 10) * MM_PER_PX, 0.0))
        assert step(calm, k * FRAME_NS, wide[:, left : left + 320].copy(), k > 0, way, place) is None


def test_the_way_of_a_hand_across_blank_pictures_is_no_change() -> None:
    """20 mm/s in the plane, and a fifth of a second of black."""
    wide, calm, way = speckle((240, 800)), event(), (np.array([7.0, 0.0]), 0.0)
    for k in range(40):
        black = 20 <= k < 26
        left, place = 400 - 7 * k, moved_by((7 * k * MM_PER_PX, 0.0))
        image = BLACK if black else wide[:, left : left + 320].copy()
        followed = k > 0 and not 20 <= k <= 26
        assert step(calm, k * FRAME_NS, image, followed, way if followed else None, place) is None
        assert calm.linked is not black


@pytest.mark.parametrize(("sheared_deg", "way_mm", "voids"), [(8.0, 4.0, False), (8.0, 0.0, True), (2.0, 0.0, False)])
def test_tissue_that_a_face_drags_along_is_sheared_by_no_change(sheared_deg: float, way_mm: float, voids: bool) -> None:
    """Its lines down are slanted by the way of the face; the picture is 24 mm high."""
    calm, changes, before_px = event(), [], 0
    for k in range(50):
        share = float(np.clip((k - 30) / 8, 0.0, 1.0))
        gone_px = round(share * way_mm / MM_PER_PX)
        image = np.roll(turned(layered(), 0.0, share * sheared_deg), gone_px, axis=1)
        way = (np.array([gone_px - before_px, 0.0]), 0.0) if k else None
        changes.append(step(calm, k * FRAME_NS, image, k > 0, way, moved_by((share * way_mm, 0.0))))
        before_px = gone_px
    assert (PictureChange() in changes) is voids


def organ(share: float) -> GreyImage:
    """It slides by 6 mm under its wall, and is strained by 4 %."""
    wide = speckle((240, 600))
    image = wide[:, 140:460].copy()
    slid = np.array([[1.0, 0.0, -140.0 - 60 * share], [0.0, 1.0, 0.0]])
    image[60:] = cv2.warpAffine(wide, slid, (320, 240))[60:]
    return stretched(image, 1.04**share, 1.04**share)


def test_an_organ_that_slides_under_its_wall_is_no_zoom() -> None:
    calm = watching([organ(0.0)] * CALM, STILL)
    for k in range(24):
        way = np.array([-60 / 15 if k < 15 else 0.0, 0.0])
        picture, place = organ(min(k / 15, 1.0)), moved_by((0.0, 0.0))
        assert step(calm, (CALM + k) * FRAME_NS, picture, True, (way, 0.0), place) is None
    assert told(calm) == {VerdictKind.OK}


def test_pictures_that_hold_nothing_are_in_no_chain() -> None:
    detector = event()
    noise = np.random.default_rng(1)
    for k in range(40):
        step(detector, k * FRAME_NS, noise.integers(0, 5, (240, 320)).astype(np.uint8))
        assert not detector.linked


def test_a_stamp_far_in_the_future_begins_no_chain_for_another_picture(calm: PictureChain) -> None:
    """The line has given up what was shown when it came; it must not be shown of another picture."""
    step(calm, CALM * FRAME_NS + 60_000_000_000, speckle(), True, STILL)
    calm.forget_pictures((CALM + 1) * FRAME_NS)
    step(calm, (CALM + 1) * FRAME_NS, other(1.0))
    assert not calm.linked
