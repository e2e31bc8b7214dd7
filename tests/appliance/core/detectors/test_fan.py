"""A convex picture's fan is measured with honest sigmas; where a border is hidden, or there is none, it says so."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from probewatch.appliance.core.detectors.fan import Fan, fan_in
from probewatch.appliance.core.detectors.fan_borders import (
    APEX_X,
    APEX_Y,
    ASPECT,
    BOTTOM,
    BOTTOM_RADIUS,
    FACE_RADIUS,
    LEFT_SLOPE,
)
from probewatch.appliance.core.detectors.fan_change import change_between
from probewatch.drivers.recordings.replay import open_recording
from probewatch.drivers.samples import Frame, GreyImage
from tests.support.fans import HEIGHT, STYLES, WIDTH, FanStyle, a_fan, fan_picture
from tests.support.recordings import in_vivo_file, plus_file
from tests.support.rulers import grabbed

GRABBERS = ((0.0, 0.0, 0), (3.0, 0.7, 0), (2.0, 0.6, 75), (5.0, 0.0, 0))
SIZE_PX = (WIDTH, HEIGHT)
CHANGES = (
    ((1.01, 1.0), (0.0, 0.0)),
    ((1.0, 0.99), (0.0, 0.0)),
    ((1.03, 0.98), (2.0, -4.0)),
    ((1.0, 1.0), (5.0, 0.0)),
    ((1.0, 1.0), (0.0, -5.0)),
    ((0.9, 0.9), (0.0, -10.0)),
)


def known(image: GreyImage) -> Fan:
    found = fan_in(image)
    assert found is not None
    return found


@pytest.mark.parametrize("style", STYLES)
def test_apex_opening_radii_and_aspect_are_measured_within_their_sigmas(style: FanStyle) -> None:
    found = known(fan_picture(style, 1, 0))
    off, sigma = found.numbers - style.numbers, np.sqrt(np.diag(found.covariance))
    assert np.all(np.abs(off) < 3 * sigma)
    assert sigma[ASPECT] < 0.02
    assert sigma[FACE_RADIUS] < 0.03 * style.face_px


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize(("stretch", "shift_px"), CHANGES)
def test_a_stretch_and_a_shift_are_told_apart_and_measured(
    style: FanStyle, stretch: tuple[float, float], shift_px: tuple[float, float]
) -> None:
    before, now = known(fan_picture(style, 1, 0)), known(fan_picture(style.changed(stretch, shift_px), 1, 1))
    change = change_between(before, now, SIZE_PX)
    assert change is not None
    np.testing.assert_allclose(change.stretch, np.log(stretch), atol=0.003)
    np.testing.assert_allclose(change.shift_px, shift_px, atol=0.8)


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("zoom", [1.05, 0.95])
def test_another_depth_leaves_the_lower_arc_where_it_was_and_is_measured(style: FanStyle, zoom: float) -> None:
    before, now = known(fan_picture(style, 1, 0)), known(fan_picture(style.deeper(zoom), 1, 1))
    change = change_between(before, now, SIZE_PX)
    assert change is not None
    assert change.deeper
    assert np.all(np.abs(change.stretch - np.log(zoom)) < 4 * change.sigmas[:2])


@pytest.mark.parametrize("style", STYLES)
def test_a_narrower_sector_is_no_stretch(style: FanStyle) -> None:
    before = known(fan_picture(style, 1, 0))
    for narrower in (
        replace(style, left_deg=0.85 * style.left_deg, right_deg=0.85 * style.right_deg),
        replace(style, left_deg=0.96 * style.left_deg, right_deg=0.96 * style.right_deg),
        replace(style, right_deg=0.9 * style.right_deg),
    ):
        assert change_between(before, known(fan_picture(narrower, 1, 1)), SIZE_PX) is None


def test_a_dark_depth_hides_the_lower_arc_alone() -> None:
    style = replace(STYLES[0], floor_grey=0.0, fades=-0.6)
    found = known(fan_picture(style, 1, 0))
    assert BOTTOM not in found.borders
    assert np.isnan(found.numbers[BOTTOM_RADIUS])
    off = found.numbers - style.numbers
    assert np.all(np.abs(off[:BOTTOM_RADIUS]) < 3 * np.sqrt(np.diag(found.covariance))[:BOTTOM_RADIUS])


@pytest.mark.parametrize("shadow", [(18.0, 31.0, 0.25), (-31.0, -15.0, 0.3), (-90.0, 90.0, 0.1)])
def test_no_fan_is_guessed_where_a_shadow_hides_a_side(shadow: tuple[float, float, float]) -> None:
    for seed in range(4):
        assert fan_in(fan_picture(replace(STYLES[0], floor_grey=0.0, hidden=(shadow,)), seed, 0)) is None


def plain(inside: np.ndarray) -> GreyImage:
    """(HEIGHT, WIDTH) uint8 of grains where it is inside."""
    grains = np.random.default_rng(3).rayleigh(60, (HEIGHT // 3, WIDTH // 4)).clip(5, 255).astype(np.uint8)
    return np.where(inside, cv2.resize(grains, (WIDTH, HEIGHT)), 0).astype(np.uint8)


def shapes() -> dict[str, GreyImage]:
    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    within = (rows > 20) & (rows < 460)
    return {
        "rectangle": plain(within & (columns > 80) & (columns < 560)),
        "full": plain(np.ones((HEIGHT, WIDTH), np.bool_)),
        "leaning": plain(within & (columns > 40 + 0.3 * rows) & (columns < 420 + 0.3 * rows)),
        "trapezoid": plain(within & (np.abs(columns - 320) < 120 + 0.35 * rows)),
        "disc": plain(np.hypot(columns - 320, rows - 240) < 200),
        "black": np.zeros((HEIGHT, WIDTH), np.uint8),
        "white": np.full((HEIGHT, WIDTH), 255, np.uint8),
        "noise": np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH), np.uint8),
        "small": np.random.default_rng(1).integers(0, 256, (16, 16), np.uint8),
    }


@pytest.mark.parametrize("name", [*shapes()])
def test_other_shapes_have_no_fan(name: str) -> None:
    assert fan_in(shapes()[name]) is None


@pytest.mark.parametrize("name", ["fCal_Test_Validation_3NWires_fCal2.0.igs.mha", "NwirePhantomFreehand.igs.mha"])
def test_recordings_of_wires_in_water_have_no_fan(name: str) -> None:
    frames = [sample for sample in open_recording(plus_file(name)).samples() if isinstance(sample, Frame)]
    assert [fan_in(frame.image) for frame in frames[::5]] == [None] * len(frames[::5])


def test_the_fan_of_a_convex_probe_on_a_liver_is_as_published() -> None:
    """Apex, radius of the face and opening angle as they were read off the recording by hand."""
    path = in_vivo_file("liver-first-half.igs.mha")
    frames = [sample for sample in open_recording(path).samples() if isinstance(sample, Frame)]
    for frame in frames[::7]:
        found = known(frame.image)
        assert found.numbers[APEX_X] == pytest.approx(369.4, abs=1)
        assert found.numbers[APEX_Y] == pytest.approx(-139.3, abs=1.5)
        assert found.numbers[FACE_RADIUS] == pytest.approx(161.3, abs=1.5)
        assert found.numbers[ASPECT] == pytest.approx(1, abs=0.01)
        np.testing.assert_allclose(np.degrees(np.arctan(found.numbers[LEFT_SLOPE:ASPECT])), 30.28, atol=0.3)


@pytest.mark.thorough
def test_sigmas_are_honest_over_many_fans_and_grabbers() -> None:
    z, changes = [], []
    for seed in range(160):
        random, grabber = np.random.default_rng((seed, 5)), GRABBERS[seed % 4]
        style = a_fan(random)
        stretch, shift_px = 1 + random.uniform(-0.015, 0.015, 2), random.uniform(-6, 6, 2)
        other = style.changed((stretch[0], stretch[1]), (shift_px[0], shift_px[1]))
        found = fan_in(grabbed(fan_picture(style, seed, 0), seed, 0, *grabber))
        now = fan_in(grabbed(fan_picture(other, seed, 1), seed, 1, *grabber))
        if found is None:
            continue
        with np.errstate(invalid="ignore"):
            z.append((found.numbers - style.numbers) / np.sqrt(np.diag(found.covariance)))
        change = None if now is None else change_between(found, now, SIZE_PX)
        if change is not None:
            changes.append(
                (np.concatenate([change.stretch - np.log(stretch), change.shift_px - shift_px]), change.sigmas)
            )
    rms = np.sqrt(np.nanmean(np.square(z), axis=0))
    off, sigmas = np.array([one for one, _ in changes]), np.array([one for _, one in changes])
    print(f"found {len(z)} of 160, RMS z {np.round(rms, 2)}; {len(changes)} changes, RMS z", end=" ")
    print(np.round(np.sqrt(np.mean((off / sigmas) ** 2, axis=0)), 2), "median sigma", np.median(sigmas, axis=0))
    assert len(z) >= 150
    assert len(changes) >= 145
    assert np.all((rms > 0.3) & (rms < 1.3))
    assert np.all(np.sqrt(np.mean((off / sigmas) ** 2, axis=0)) < 1.3)
