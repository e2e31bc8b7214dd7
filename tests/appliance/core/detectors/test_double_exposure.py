"""Two pictures that are mixed lose contrast, by a closed form; a hand that sweeps loses none."""

from itertools import pairwise

import cv2
import numpy as np
import pytest

from probewatch.appliance.core.detectors.double_exposure import DoubleExposure
from probewatch.appliance.core.detectors.picture_link import contrasts
from probewatch.appliance.core.registration.pyramid import Array32

FRAME_NS = 33_333_333
HALVED = np.log(np.sqrt(0.5))
"""Expected fall of the logarithm of the contrast, where two unlike pictures are mixed half and half."""
WINDOW = 12
"""Pictures before and after a fade."""


def speckle(seed: int, count: int, kept: float) -> list[Array32]:
    """(120, 160) pictures of a sweep, of each of which so much is alike in the next."""
    rng = np.random.default_rng(seed)
    pictures = [rng.normal(size=(120, 160))]
    for _ in range(count - 1):
        pictures.append(kept * pictures[-1] + np.sqrt(1 - kept**2) * rng.normal(size=(120, 160)))
    return [np.asarray(20 * cv2.GaussianBlur(one, (0, 0), 0.8), np.float32) for one in pictures]


def fading(seed: int, lasting: int, kept: float) -> list[Array32]:
    """From one sweep to another in so many pictures."""
    count = lasting + 2 * WINDOW
    shares = np.clip((np.arange(count) - WINDOW + 1) / lasting, 0, 1)
    both = zip(speckle(seed, count, kept), speckle(seed + 100, count, kept), shares, strict=True)
    return [np.asarray((1 - share) * one + share * other, np.float32) for one, other, share in both]


def ended(pictures: list[Array32]) -> list[int]:
    """Which of the pictures a fade ends with."""
    found, ends = DoubleExposure(), list[int]()
    for k, picture in enumerate(pictures):
        found.step(k * FRAME_NS, picture)
        if found.ended:
            ends.append(k)
            found.restart()
    return ends


def test_half_of_each_of_two_pictures_has_the_contrast_of_the_closed_form() -> None:
    one, other = (speckle(seed, 1, 0.0)[0] for seed in (1, 2))
    fell = contrasts(np.asarray((one + other) / 2, np.float32)) - (contrasts(one) + contrasts(other)) / 2
    assert np.mean(fell) == pytest.approx(HALVED, abs=3 * np.std(fell) / np.sqrt(fell.size))


@pytest.mark.parametrize("kept", [1.0, 0.9, 0.5], ids=["held", "swept", "swept quickly"])
@pytest.mark.parametrize("lasting", [3, 8, 18])
def test_a_fade_is_seen_before_a_tenth_of_a_second_has_passed_since_its_end(lasting: int, kept: float) -> None:
    for seed in range(5):
        ends = ended(fading(seed, lasting, kept))
        assert len(ends) == 1
        assert WINDOW < ends[0] <= WINDOW + lasting + 3


@pytest.mark.parametrize("kept", [1.0, 0.9, 0.5], ids=["held", "swept", "swept quickly"])
def test_a_sweep_is_none(kept: float) -> None:
    for seed in range(10):
        assert not ended(speckle(seed, 60, kept))


def test_gain_that_is_turned_is_none() -> None:
    """It has no picture before or after that is as it was."""
    pictures = speckle(1, 60, 0.9)
    gains = [1.0] * 20 + [1.8] * 20 + [0.7] * 20
    shown = [np.asarray(gain * picture, np.float32) for gain, picture in zip(gains, pictures, strict=True)]
    assert not ended(shown[:40])
    assert not ended([*shown[40:], *shown[20:40]])


def test_a_corner_that_loses_contrast_is_none() -> None:
    pictures = speckle(1, 40, 0.9)
    for picture in pictures[15:25]:
        picture[:60, :120] *= 0.3
    assert not ended(pictures)


def test_a_dip_that_lasts_longer_than_any_fade_is_none() -> None:
    pictures = speckle(1, 90, 0.9)
    dimmed = [np.asarray(0.7 * picture, np.float32) for picture in pictures[20:60]]
    assert not ended([*pictures[:20], *dimmed, *pictures[60:]])


def test_too_little_that_is_shown_decides_nothing() -> None:
    pictures = fading(1, 8, 0.9)
    for picture in pictures:
        picture[:, 30:] = 0.0
    assert not ended(pictures)


def test_it_holds_no_more_than_the_time_it_looks_back() -> None:
    found = DoubleExposure()
    for k, picture in enumerate(speckle(1, 90, 0.9)):
        found.step(k * FRAME_NS, picture)
    times_ns = [at_ns for at_ns, _ in found._levels]
    assert times_ns[-1] - times_ns[0] <= 800_000_000
    assert all(earlier < later for earlier, later in pairwise(times_ns))
