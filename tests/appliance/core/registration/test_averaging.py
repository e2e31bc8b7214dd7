"""Pictures averaged with a known share are taken apart again; those that were not averaged are left as they are."""

from collections.abc import Callable, Iterable, Sequence
from functools import cache
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import pytest

from probewatch.appliance.core.registration.averaging import FrameAveraging
from probewatch.drivers.samples import GreyImage

SHAPE = (180, 240)
EVERYWHERE = np.ones(SHAPE, bool)
SHARES = (0.3, 0.5, 0.7)
FRAMES = 24


@cache
def field(seed: int, rows: int = SHAPE[0]) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Speckle, a few px long and wider than high, in grey levels."""
    white = np.random.default_rng((7, seed)).standard_normal((rows, SHAPE[1])).astype(np.float32)
    smooth = cv2.GaussianBlur(white, (0, 0), 3.0, sigmaY=1.5)
    return np.asarray(120 + 25 * smooth / smooth.std(), np.float32)


def grey(picture: np.ndarray[Any, np.dtype[np.float32]]) -> GreyImage:
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def quick(count: int = FRAMES, first: int = 0) -> list[GreyImage]:
    """Of a hand so quick that no picture has anything of the 39 before it."""
    return [grey(field(first + k % 40)) for k in range(count)]


def averaged(pictures: Sequence[GreyImage], share: float) -> list[GreyImage]:
    """As the scanner shows them, after another; it does not round what it keeps."""
    shown, mean = [], field(999)
    for picture in pictures:
        mean = np.float32(share) * mean + np.float32(1 - share) * picture
        shown.append(grey(mean))
    return shown


def taken(
    averaging: FrameAveraging, pictures: Iterable[GreyImage], first: int = 0, hurries: bool = True
) -> list[GreyImage]:
    return [averaging.step(one, first + k, EVERYWHERE, hurries)[0] for k, one in enumerate(pictures)]


def learnt(share: float) -> FrameAveraging:
    """One that has been shown this share; the last picture it saw is of field 23."""
    averaging = FrameAveraging()
    taken(averaging, averaged(quick(), share))
    assert averaging.share == pytest.approx(share, abs=0.02)
    return averaging


@pytest.mark.parametrize("share", SHARES)
def test_the_share_is_told_and_what_is_left_of_other_pictures_is_taken_off(share: float) -> None:
    averaging, fresh = FrameAveraging(), quick()
    shown = averaged(fresh, share)
    found = taken(averaging, shown)
    assert averaging.known
    assert averaging.share == pytest.approx(share, abs=0.02)
    error, blur = (np.std(one[-1].astype(float) - fresh[-1]) for one in (found, shown))
    assert error < 2.5
    assert error < blur / 4


@pytest.mark.parametrize("share", SHARES)
def test_a_share_needs_twelve_quick_pictures_and_says_when_it_is_believed(share: float) -> None:
    averaging = FrameAveraging()
    shown = averaged(quick(30), share)[6:]
    changes = [k for k, one in enumerate(shown) if averaging.step(one, k, EVERYWHERE, True)[1]]
    assert changes == [14]


def still() -> list[GreyImage]:
    random = np.random.default_rng(3)
    return [grey(field(1) + random.normal(0, 2, SHAPE).astype(np.float32)) for _ in range(60)]


def steady(rows_px: float) -> list[GreyImage]:
    """A slide down the picture at one speed."""
    tissue = field(2, rows=2000)
    middle = (SHAPE[1] / 2, 500)
    return [grey(cv2.getRectSubPix(tissue, SHAPE[::-1], (middle[0], middle[1] + k * rows_px))) for k in range(60)]


def changing(per_picture: float) -> list[GreyImage]:
    """A sweep out of the plane at one speed: speckle that changes alike each time."""
    pictures = np.array([field(100 + k) - 120 for k in range(60)])
    apart = (np.arange(60)[:, None] - np.arange(60)) * per_picture
    weights = np.exp(-(apart**2))
    mixed = np.einsum("nk,kij->nij", weights, pictures) / np.sqrt((weights**2).sum(axis=1))[:, None, None]
    return [grey(120 + one) for one in mixed.astype(np.float32)]


def noisy_repeats() -> list[GreyImage]:
    """A scanner of half the rate before an analogue grabber: what is repeated is not the same."""
    random = np.random.default_rng(4)
    return [grey(one + random.normal(0, 3, SHAPE).astype(np.float32)) for one in quick(30) for _ in range(2)]


def blended() -> list[GreyImage]:
    """A converter of rates that mixes each two neighbours."""
    pictures = quick(61)
    return [grey((a.astype(np.float32) + b) / 2) for a, b in pairwise(pictures)]


def in_front_of(share: float) -> list[GreyImage]:
    """Quick tissue behind a pattern that stands still, such as a haze of the near field."""
    return [grey(120 + share * (field(5) - 120) + (1 - share) * (one.astype(np.float32) - 120)) for one in quick(60)]


def in_two_ways() -> list[GreyImage]:
    """Tissue whose upper half goes along with the face, the lower less: as if each were averaged in its own way."""
    upper, lower = averaged(quick(60), 0.5), averaged(quick(60), 0.3)
    return [np.vstack([a[:90], b[90:]]) for a, b in zip(upper, lower, strict=True)]


def adaptive() -> list[GreyImage]:
    """A scanner that averages now more, now less."""
    shares, mean, shown = np.random.default_rng(6).uniform(0.15, 0.75, 60), field(999), []
    for share, picture in zip(shares, quick(60), strict=True):
        mean = np.float32(share) * mean + np.float32(1 - share) * picture
        shown.append(grey(mean))
    return shown


def of_four() -> list[GreyImage]:
    """A scanner that shows a mean of the last four, and nothing of those before."""
    pictures, weights = np.array([field(k % 40) - 120 for k in range(63)]), np.array([0.03, 0.25, 0.4, 1.0])
    weights /= np.sqrt(np.sum(weights**2))
    return [grey(120 + np.tensordot(weights.astype(np.float32), pictures[k : k + 4], 1)) for k in range(60)]


def through_jpeg(picture: GreyImage, quality: int) -> GreyImage:
    coded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE), np.uint8)


WITHOUT: dict[str, Callable[[], list[GreyImage]]] = {
    "quick": lambda: quick(60),
    "still": still,
    "slide": lambda: steady(3.0),
    "slow slide": lambda: steady(0.7),
    "sweep": lambda: changing(0.3),
    "quick sweep": lambda: changing(0.6),
    "quicker sweep": lambda: changing(0.9),
    "noisy repeats": noisy_repeats,
    "blended": blended,
    "haze": lambda: in_front_of(0.4),
    "coded": lambda: [through_jpeg(one, 30) for one in quick(60)],
    "mean of four": of_four,
    "in two ways": in_two_ways,
    "adaptive": adaptive,
    "hardly": lambda: averaged(quick(60), 0.05),
    "freeze": lambda: [*quick(30), *[quick(1)[0]] * 30],
}


@pytest.mark.parametrize("pictures", WITHOUT.values(), ids=WITHOUT)
def test_where_nothing_was_averaged_pictures_are_handed_on_as_they_are(
    pictures: Callable[[], list[GreyImage]],
) -> None:
    """Though the tracker has called all of them quick, as one without any sense may."""
    averaging, shown = FrameAveraging(), pictures()
    found = taken(averaging, shown)
    assert averaging.share == 0
    assert all(one is other for one, other in zip(found, shown, strict=True))


def test_a_hand_that_is_not_quick_tells_no_share() -> None:
    averaging = FrameAveraging()
    taken(averaging, averaged(quick(60), 0.5), hurries=False)
    assert averaging.share == 0
    assert not averaging.known


def test_quick_pictures_here_and_there_tell_no_share() -> None:
    """A tracker's noise calls some quick."""
    averaging = FrameAveraging()
    for k, one in enumerate(averaged(quick(240), 0.5)):
        averaging.step(one, k, EVERYWHERE, k % 12 == 0)
    assert averaging.share == 0


def test_a_share_is_told_where_the_depth_is_dark() -> None:
    averaging = FrameAveraging()
    for k, one in enumerate(averaged(quick(), 0.5)):
        dark = np.random.default_rng(k).integers(0, 2, (60, SHAPE[1]), np.uint8)
        averaging.step(np.vstack([one[:120], dark]), k, EVERYWHERE, True)
    assert averaging.share == pytest.approx(0.5, abs=0.03)


def test_a_share_is_told_where_the_grabber_codes() -> None:
    averaging = FrameAveraging()
    taken(averaging, [through_jpeg(one, 40) for one in averaged(quick(), 0.5)])
    assert averaging.share == pytest.approx(0.5, abs=0.03)


def test_without_a_mask_no_share_is_told_and_with_it_what_stands_still_is_left_out() -> None:
    averaging, blind = FrameAveraging(), FrameAveraging()
    shown = averaged(quick(), 0.5)
    mask = EVERYWHERE.copy()
    mask[:, :100] = False
    for k, one in enumerate(shown):
        one[:, :100] = grey(field(50))[:, :100]
        averaging.step(one, k, mask, True)
        blind.step(one, k, None, True)
    assert averaging.share == pytest.approx(0.5, abs=0.02)
    assert blind.share == 0


def test_that_there_is_no_share_shows_by_speckle_that_has_gone_on_by_half_a_cell() -> None:
    averaging = FrameAveraging()
    taken(averaging, steady(3.0)[:10], hurries=False)
    assert averaging.known
    assert averaging.share == 0


def test_what_has_shown_that_there_is_none_forbids_to_believe_one_for_ten_seconds() -> None:
    averaging = FrameAveraging()
    taken(averaging, steady(3.0)[:10], hurries=False)
    shown = averaged(quick(320), 0.5)
    taken(averaging, shown[:200], first=100)
    assert averaging.share == 0
    taken(averaging, shown[200:], first=300)
    assert averaging.share == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("lost", [1, 2])
def test_a_picture_that_the_grabber_has_dropped_is_reckoned_with(share: float, lost: int) -> None:
    """What is left of the last that was seen is s², s³ of it; the result is the mean of those since."""
    averaging, fresh = FrameAveraging(), quick(30)
    shown = averaged(fresh, share)
    taken(averaging, shown[:27])
    found, _ = averaging.step(shown[27 + lost], 27 + lost, EVERYWHERE, True)
    told = averaging.share
    expected = (shown[27 + lost] - told ** (1 + lost) * shown[26].astype(float)) / (1 - told ** (1 + lost))
    np.testing.assert_allclose(found, np.clip(expected, 0, 255), atol=0.6)


def test_a_picture_that_the_grabber_has_handed_on_twice_was_averaged_once() -> None:
    once, twice = learnt(0.5), learnt(0.5)
    after = averaged([*quick(), grey(field(60))], 0.5)[-1]
    twice.repeat()
    np.testing.assert_array_equal(
        once.step(after, FRAMES, EVERYWHERE, True)[0], twice.step(after, FRAMES + 1, EVERYWHERE, True)[0]
    )


@pytest.mark.parametrize("share", [0.5, 0.7])
def test_a_picture_that_holds_nothing_of_the_last_is_handed_on_and_the_next_is_undone(share: float) -> None:
    """As where the grabber has mirrored what the scanner averages."""
    averaging, fresh = FrameAveraging(), quick(26)
    shown = averaged(fresh, share)
    taken(averaging, shown[:24])
    mirrored = [np.ascontiguousarray(one[:, ::-1]) for one in shown[24:]]
    first, second = taken(averaging, mirrored, first=24)
    assert first is mirrored[0]
    assert np.std(second.astype(float) - fresh[25][:, ::-1]) < 2.5


def test_a_black_picture_and_the_one_after_it_are_handed_on() -> None:
    """A probe that is lifted off, before a scanner that begins anew."""
    averaging = learnt(0.5)
    black, after = np.zeros(SHAPE, np.uint8), grey(field(90))
    assert taken(averaging, [black, after], first=FRAMES)[0] is black
    assert taken(averaging, [black, after], first=FRAMES + 2)[1] is after


def test_the_first_picture_after_a_loss_of_sight_is_handed_on_and_the_share_stays() -> None:
    averaging = learnt(0.5)
    averaging.restart()
    after = averaged(quick(2, first=80), 0.5)
    found = taken(averaging, after, first=80)
    assert found[0] is after[0]
    assert found[1] is not after[1]


@pytest.mark.parametrize("then", [0.0, 0.3])
def test_a_share_that_the_operator_changes_is_followed(then: float) -> None:
    averaging = learnt(0.7)
    taken(averaging, averaged(quick(60, first=100), then), first=FRAMES)
    assert averaging.share == pytest.approx(then, abs=0.02)


def test_a_cross_fade_to_another_picture_is_sharp_again() -> None:
    """Another depth comes at once, as it does without averaging."""
    averaging = learnt(0.5)
    before, after = grey(field(400)), grey(cv2.resize(field(400), None, fx=1.25, fy=1.25)[:180, :240])
    shown = averaged([*quick(), *[before] * 12, *[after] * 3], 0.5)[FRAMES:]
    found = taken(averaging, shown, first=FRAMES, hurries=False)
    assert np.std(found[12].astype(float) - after) < 2.5
    assert np.std(shown[12].astype(float) - after) > 10
