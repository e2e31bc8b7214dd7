"""The overlay mask on rendered pictures: what the scanner draws is left out, tissue stays in."""

from functools import cache

import cv2
import numpy as np
import pytest

from probewatch.appliance.core.registration.overlay import OverlayMask
from probewatch.appliance.core.registration.pyramid import pyramid
from probewatch.appliance.core.registration.realtime_tracker import RealTimeTracker
from probewatch.drivers.samples import GreyImage
from probewatch.drivers.twins.scene.world import World
from tests.paper import sweeps
from tests.support.rendered import SMALL, sweep, world

Bits = np.ndarray


@cache
def drawn(seed: int) -> tuple[Bits, Bits, Bits]:
    """(h, w) bool each: bright text, the lit side of the sector's border, and tissue well away from both."""
    shown = world(seed, SMALL).frame(0, 0).astype(np.int16)
    bare = world(seed, SMALL, overlay=False).frame(0, 0).astype(np.int16)
    text, outside = shown - bare > 40, (shown == 0) & (bare > 40)
    border = grown(outside, 1) & ~outside & (bare > 60)
    return text, border, ~grown(text | outside, 4)


def grown(bits: Bits, by_px: int) -> Bits:
    size = 2 * by_px + 1
    return cv2.dilate(bits.astype(np.uint8), np.ones((size, size), np.uint8)) > 0


def learnt(pictures: list[GreyImage], frames: int) -> Bits:
    overlay = OverlayMask()
    for image in pictures[:frames]:
        overlay.step(pyramid(image))
    assert overlay.settled
    assert overlay.mask is not None
    return ~overlay.mask


@cache
def pictures(seed: int) -> list[GreyImage]:
    return sweep(world(seed, SMALL), 16)


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.thorough)])
def test_a_first_guess_after_seven_pictures_leaves_no_text_and_no_border(seed: int) -> None:
    text, border, tissue = drawn(seed)
    masked = learnt(pictures(seed), 7)
    assert masked[text].mean() >= 0.9
    assert masked[border].mean() >= 0.98
    assert masked[tissue].mean() <= 0.4


@pytest.mark.parametrize("seed", [1, 2])
def test_after_sixteen_pictures_tissue_is_spared(seed: int) -> None:
    text, border, tissue = drawn(seed)
    masked = learnt(pictures(seed), 16)
    assert masked[text].mean() >= 0.9
    assert masked[border].mean() >= 0.98
    assert masked[tissue].mean() <= 0.02


def test_a_still_probe_teaches_nothing() -> None:
    still = World(1, "still", settings=SMALL)
    overlay = OverlayMask()
    assert not any(overlay.step(pyramid(still.frame(k / 30, k))) for k in range(20))
    assert overlay.mask is None
    assert not overlay.settled


@pytest.mark.parametrize("size_px", [(320, 240), (20, 14)])
def test_pictures_without_structure_teach_nothing(size_px: tuple[int, int]) -> None:
    overlay = OverlayMask()
    for grey in range(0, 200, 10):
        overlay.step(pyramid(np.full(size_px[::-1], grey, np.uint8)))
    assert overlay.mask is None or overlay.mask.all()


def test_the_caller_is_told_of_every_change_and_of_nothing_else() -> None:
    overlay = OverlayMask()
    before = None
    for image in pictures(1):
        changed = overlay.step(pyramid(image))
        assert changed == (overlay.mask is not before)
        before = overlay.mask
    assert before is not None
    assert before.shape == (240, 320)


def test_text_that_appears_later_is_learnt_too() -> None:
    seen = world(1)
    overlay = OverlayMask()
    word = np.zeros((240, 320), np.uint8)
    cv2.putText(word, "FREEZE?", (120, 120), cv2.FONT_HERSHEY_SIMPLEX, 0.6, 250, 1)
    for k in range(75):
        image = seen.frame(k / 30, k)
        overlay.step(pyramid(cv2.max(image, word) if k >= 20 else image))
    assert overlay.mask is not None
    assert (~overlay.mask)[word > 200].mean() >= 0.8


@pytest.mark.parametrize(
    "headings_deg",
    [
        pytest.param(np.linspace(0, 180, 40), id="turning", marks=pytest.mark.thorough),
        pytest.param(np.zeros(40), id="lateral"),
    ],
)
def test_a_slow_sweep_with_coarse_pixels_is_not_taken_for_overlay(headings_deg: Bits) -> None:
    """0.4 px a picture, along the wide side of the speckle: nothing is drawn there, so nothing may be left out."""
    tracker = RealTimeTracker(float(sweeps.SCALE[1] / sweeps.SCALE[0]))
    masked = []
    for k, image in enumerate(sweeps.sweep(4, headings_deg).pictures):
        tracker.step(image, k)
        mask = tracker._overlay.mask
        masked.append(0.0 if mask is None else 1 - mask.mean())
    assert tracker.settled
    assert max(masked) <= 0.25
