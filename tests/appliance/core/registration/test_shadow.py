"""Shadows along the beam: left out of the fit with their edges, and nothing else."""

import cv2
import numpy as np
import pytest

from probewatch.appliance.core.registration.keyframe import Keyframe
from probewatch.appliance.core.registration.pyramid import pyramid
from probewatch.appliance.core.registration.shadow import Shadows
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import GreyImage

HEIGHT, WIDTH = 300, 400
COLUMNS, ROWS = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
TURNED_DEG = 0.3
"""Between two pictures of a probe that is rocked by hand."""


def speckle(turned_deg: float = 0.0) -> Array:
    """Amplitude of speckle, turned about the middle of the picture."""
    random = np.random.default_rng(5)
    side = 2 * WIDTH
    field = random.normal(size=(2, side, side)).astype(np.float32)
    real, imaginary = (cv2.GaussianBlur(part, (0, 0), 6.0, sigmaY=2.5) for part in field)
    amplitude = np.hypot(real, imaginary)
    matrix = cv2.getRotationMatrix2D((side / 2, side / 2), turned_deg, 1.0)
    matrix[:, 2] -= (side - WIDTH) / 2, (side - HEIGHT) / 2
    return np.asarray(cv2.warpAffine(amplitude / amplitude.mean(), matrix, (WIDTH, HEIGHT)))


def shown(amplitude: Array) -> GreyImage:
    """As a scanner does, 50 dB, with the receiver's noise."""
    noise = np.random.default_rng(6).normal(0, 2, amplitude.shape)
    return np.clip(150 + 102 * np.log10(np.maximum(amplitude, 1e-3)) + noise, 0, 255).astype(np.uint8)


def rib(left_px: float, right_px: float, top_px: float = 90.0) -> Array:
    """(h, w) what a bone leaves of the echoes: nothing below it, with soft edges."""
    inside = np.clip((COLUMNS - left_px) / 6, 0, 1) * np.clip((right_px - COLUMNS) / 6, 0, 1)
    return np.asarray(1 - 0.99 * inside * (top_px <= ROWS))


def lit(amplitude: Array) -> Array:
    found = Shadows().outside(pyramid(shown(amplitude)), None)
    return np.ones((HEIGHT, WIDTH), bool) if found is None else found


def test_a_shadow_is_left_out_with_its_edges_and_little_else() -> None:
    seen = lit(speckle() * rib(150, 215))
    assert not seen[130:280, 149:216].any()
    beside = (COLUMNS < 125) | (COLUMNS > 240)
    assert seen[beside].mean() > 0.99


def test_what_rings_below_gas_is_a_shadow_too() -> None:
    gain = rib(150, 215)
    bands = 0.35 * (1 - gain) * (0.6 + 0.4 * np.cos(2 * np.pi * ROWS / 18))
    seen = lit(speckle() * gain + bands)
    assert not seen[130:280, 150:215].any()


@pytest.mark.parametrize("slope", [-0.3, 0.3])
def test_a_shadow_of_a_fan_slants(slope: float) -> None:
    aside = (ROWS - 150) * slope
    inside = np.clip((COLUMNS - 150 - aside) / 6, 0, 1) * np.clip((215 + aside - COLUMNS) / 6, 0, 1)
    seen = lit(speckle() * (1 - 0.99 * inside * (ROWS >= 90)))
    assert seen[130:280][inside[130:280] > 0.2].mean() < 0.02


def test_a_vessel_is_no_shadow() -> None:
    vessel = np.hypot((COLUMNS - 180) / 1.6, ROWS - 150) < 30
    assert lit(speckle() * np.where(vessel, 0.01, 1.0)).all()


def test_wires_in_water_lie_in_no_shadow() -> None:
    water = np.full((HEIGHT, WIDTH), 1e-3)
    for column, row in ((90, 80), (200, 110), (300, 90), (150, 220)):
        water += np.exp(-((COLUMNS - column) ** 2 / 50 + (ROWS - row) ** 2 / 12))
    assert lit(water).all()


def test_what_may_not_be_seen_stays_so() -> None:
    mask = COLUMNS > 60
    seen = Shadows().outside(pyramid(shown(speckle() * rib(250, 315))), mask)
    assert seen is not None
    assert not seen[~mask].any()
    assert seen[100:, 61:200].all()


def test_a_shadow_that_does_not_turn_hides_no_turn_of_the_tissue() -> None:
    """Two ribs: .286° of .3° were seen, and .14° where tissue may give way."""
    ribs = rib(60, 130) * rib(260, 330)
    home = pyramid(shown(speckle() * ribs))
    keyframe = Keyframe(home, 1.0, Shadows().outside(home, None))
    found = keyframe.register(pyramid(shown(speckle(TURNED_DEG) * ribs)))
    turned_deg = [abs(np.degrees(reading.alpha_rad)) for reading in found.readings]
    assert turned_deg == pytest.approx([TURNED_DEG] * 4, abs=0.012)


def test_what_is_black_beside_a_sector_is_no_shadow() -> None:
    sector = np.abs(COLUMNS - 200) < 100 + 0.3 * ROWS
    text = (np.abs(ROWS - 20) < 8) & (np.abs(COLUMNS - 30) < 25) & (COLUMNS % 6 < 3)
    assert lit(np.where(sector, speckle(), 0) + text).all()


def test_at_the_side_there_is_a_shadow_where_the_sector_was_lit_before() -> None:
    shadows, off = Shadows(), np.clip((300 - COLUMNS) / 6, 0, 1)
    everywhere = np.ones((HEIGHT, WIDTH), bool)
    assert shadows.outside(pyramid(shown(speckle())), everywhere) is everywhere
    seen = shadows.outside(pyramid(shown(speckle() * off)), everywhere)
    assert seen is not None
    assert not seen[:, 294:].any()
    assert seen[:, :270].all()


def test_the_share_in_which_tissue_is_seen_is_without_black_and_without_shadows() -> None:
    """.7 of a picture of which the right is black, and half a window beyond; less where a rib is in view."""
    shadows, seen = Shadows(), np.ones((HEIGHT, WIDTH), bool)
    dark = np.where(COLUMNS < 0.7 * WIDTH, 1.0, 1e-3)
    assert shadows.clear_share == 1
    shadows.outside(pyramid(shown(speckle() * dark)), seen)
    assert shadows.clear_share == pytest.approx(0.715, abs=0.03)
    shadows.outside(pyramid(shown(speckle() * dark * rib(100, 165))), seen)
    assert 0.45 < shadows.clear_share < 0.62


def test_text_beside_the_sector_that_was_not_yet_known_as_such_does_not_make_it_wider() -> None:
    sector = np.abs(COLUMNS - 200) < 100 + 0.3 * ROWS
    text = (np.abs(COLUMNS - 200) < 112 + 0.3 * ROWS) & ~sector & (COLUMNS % 6 < 3) & (np.abs(ROWS - 240) < 10)
    shadows, amplitude = Shadows(), np.where(sector, speckle(), 0) + text
    shadows.outside(pyramid(shown(amplitude)), None)
    mask = ~text
    assert shadows.outside(pyramid(shown(amplitude)), mask) is mask
