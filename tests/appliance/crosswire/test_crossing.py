"""The wire crossing in single pictures: sub-pixel centre, honest sigma, and every reason to refuse."""

import cv2
import numpy as np
import pytest

from probewatch.appliance.crosswire.crossing import Crossing, Missed, NoCrossing, find_crossing
from probewatch.appliance.crosswire.drawings import Drawings
from probewatch.drivers.twins.scene.world import World, WorldSettings

SHAPE = (240, 320)
SIGMA_PX = np.array([8.0, 2.5])


def spot(centre_px, peak_db=55.0, turn_deg=0.0):
    """Intensity of one wire."""
    rows, columns = np.indices(SHAPE)
    cos, sin = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    x, y = columns - centre_px[0], rows - centre_px[1]
    along, across = cos * x + sin * y, -sin * x + cos * y
    return 10 ** (peak_db / 10) * np.exp(-((along / SIGMA_PX[0]) ** 2) - (across / SIGMA_PX[1]) ** 2)


def refusal(image, drawn=None) -> NoCrossing:
    missed = find_crossing(image, drawn)
    assert isinstance(missed, Missed), missed
    return missed.reason


def picture(*intensities, noise_grey=0.0, seed=0, gain_db=0.0):
    """Log-compressed over 60 dB, with noise of the size of a speckle."""
    random = np.random.default_rng(seed)
    grey = 255 / 60 * (10 * np.log10(sum(intensities, np.full(SHAPE, 1.0))) + gain_db)
    noise = cv2.GaussianBlur(random.standard_normal(SHAPE), (0, 0), 0.85)
    return np.clip(np.round(grey + noise_grey * noise / noise.std()), 0, 255).astype(np.uint8)


def crossed(centre_px, **options):
    return picture(spot(centre_px, turn_deg=12), spot(centre_px, turn_deg=-9), **options)


def found(image, drawn=None) -> Crossing:
    crossing = find_crossing(image, drawn)
    assert isinstance(crossing, Crossing), crossing
    return crossing


@pytest.mark.parametrize("centre_px", [(150.0, 120.0), (160.37, 100.81), (99.5, 77.25)])
@pytest.mark.parametrize("gain_db", [0, 12])
def test_centre_is_found_to_a_twentieth_of_a_pixel_also_when_saturated(centre_px, gain_db) -> None:
    image = crossed(centre_px, gain_db=gain_db)
    assert (image.max() == 255) == (gain_db == 12)
    np.testing.assert_allclose(found(image).centre_px, centre_px, atol=0.05)


@pytest.mark.thorough
def test_stated_sigma_covers_the_scatter_that_noise_makes_and_a_fifth_of_the_width() -> None:
    centres = np.array([found(crossed((160.4, 100.8), noise_grey=6, seed=seed)).centre_px for seed in range(150)])
    example = found(crossed((160.4, 100.8), noise_grey=6, seed=1))
    stated = np.sqrt(np.diag(example.covariance_px))
    assert np.all(np.abs(centres.mean(axis=0) - [160.4, 100.8]) < 0.1)
    assert np.all(stated > centres.std(axis=0))
    assert stated.max() < 0.2 * example.spread_px + 1.6 * centres.std(axis=0).max()


def test_the_spot_is_narrowest_when_the_wires_lie_on_one_another() -> None:
    spreads = [
        found(picture(spot((160 - apart, 120), turn_deg=12), spot((160 + apart, 120), turn_deg=-9))).spread_px
        for apart in (0, 1, 2, 3, 4, 5)
    ]
    assert np.all(np.diff(spreads) > 0)


@pytest.mark.parametrize("apart_px", [12, 20, 60])
@pytest.mark.parametrize("weaker_db", [0, 6])
def test_two_wires_apart_are_no_crossing(apart_px, weaker_db) -> None:
    image = picture(spot((160 - apart_px, 120)), spot((160 + apart_px, 118), 55.0 - weaker_db))
    assert refusal(image) is NoCrossing.PARTED


def test_an_empty_tank_holds_no_crossing() -> None:
    assert refusal(np.zeros(SHAPE, np.uint8)) is NoCrossing.ABSENT
    assert refusal(np.full(SHAPE, 255, np.uint8)) is NoCrossing.ABSENT
    assert refusal(picture(noise_grey=8)) is NoCrossing.ABSENT
    assert refusal(picture(spot((150, 120), 12))) is NoCrossing.ABSENT


def test_many_echoes_or_a_wall_are_unclear() -> None:
    three = picture(*(spot((80 + 80 * step, 120)) for step in range(3)))
    assert refusal(three) is NoCrossing.UNCLEAR
    wall = np.zeros(SHAPE, np.uint8)
    wall[150:170] = 220
    assert refusal(wall) is NoCrossing.UNCLEAR


@pytest.mark.parametrize("centre_px", [(5, 120), (315, 120), (160, 1), (160, 238)])
def test_half_a_spot_at_the_edge_is_refused(centre_px) -> None:
    assert refusal(crossed(centre_px)) is NoCrossing.CUT


def test_single_hot_pixels_do_not_disturb() -> None:
    image = crossed((160, 120))
    image[[30, 60, 200], [40, 250, 90]] = 255
    np.testing.assert_allclose(found(image).centre_px, (160, 120), atol=0.02)


def lettered(image):
    """What the scanner draws: text, a ruler and a bright logo."""
    drawn = image.copy()
    cv2.putText(drawn, "Gn 50", (6, 30), cv2.FONT_HERSHEY_SIMPLEX, 0.5, 255, 1, cv2.LINE_AA)
    cv2.line(drawn, (310, 10), (310, 230), 240, 2)
    drawn[200:225, 10:60] = 255
    return drawn


def test_drawings_are_learnt_and_the_wires_are_found_beside_them() -> None:
    drawings = Drawings()
    masks = [drawings.step(lettered(crossed((100 + 4 * step, 90 + 2 * step), noise_grey=3))) for step in range(25)]
    image = lettered(crossed((200.3, 140.6)))
    blind = find_crossing(image)
    assert isinstance(blind, Missed) or np.linalg.norm(blind.centre_px - [200.3, 140.6]) > 50, "the logo is brighter"
    np.testing.assert_allclose(found(image, masks[-1]).centre_px, (200.3, 140.6), atol=0.05)


def test_wires_that_have_not_moved_yet_are_not_measured() -> None:
    drawings = Drawings()
    refusals = [refusal(image, drawings.step(image)) for image in [crossed((160, 120))] * 3]
    assert refusals == [NoCrossing.ABSENT] * 3
    near = crossed((163, 121))
    assert isinstance(find_crossing(near, drawings.step(near)), Missed), "half of it lies where nothing changed"


def test_a_spot_that_touches_a_drawing_is_refused() -> None:
    drawings = Drawings()
    for step in range(25):
        drawings.step(lettered(crossed((100 + 4 * step, 90))))
    image = lettered(crossed((62, 198)))
    assert isinstance(find_crossing(image, drawings.step(image)), Missed)


def test_a_change_of_picture_size_starts_the_drawings_again() -> None:
    drawings = Drawings()
    drawings.step(np.full((50, 60), 200, np.uint8))
    assert drawings.step(np.zeros(SHAPE, np.uint8)).shape == SHAPE


@pytest.mark.parametrize("noise_db", [pytest.param(-30.0, marks=pytest.mark.thorough), -10.0])
def test_rendered_crossings_are_found_where_they_are(noise_db) -> None:
    settings = WorldSettings(noise_db=noise_db)
    world = World(seed=1, program="freehand", scene="cross-wire", settings=settings)
    drawings, seen = Drawings(), 0
    for index, t_s in enumerate(np.arange(0, 4, 1 / 15)):
        crossing_mm = (world.sensor_to_picture @ np.linalg.inv(world.probe_pose(t_s)) @ [*world.crossing_mm, 1])[:3]
        image = world.frame(t_s, index)
        result = find_crossing(image, drawings.step(image))
        if abs(crossing_mm[2]) > 1.3:
            assert isinstance(result, Missed)
        elif abs(crossing_mm[2]) < 0.3 and index > 15:
            assert isinstance(result, Crossing)
            off_mm = (result.centre_px - [319.5, 239.5]) * settings.scale_mm_per_px - crossing_mm[:2]
            assert np.linalg.norm(off_mm) < 0.06 + abs(crossing_mm[2])
            seen += 1
    assert seen >= 3
