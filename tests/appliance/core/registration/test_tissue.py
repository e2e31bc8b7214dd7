"""Registration of tissue that gives way: rendered pictures warped by a known field, and what a session learns."""

import numpy as np
import pytest

from probewatch.appliance.core.registration.keyframe import Keyframe, Reading, Registration
from probewatch.appliance.core.registration.pyramid import pyramid
from probewatch.appliance.core.registration.realtime_tracker import RealTimeTracker, acceptable
from probewatch.appliance.types import DRAGS, PRESSES
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import GreyImage
from probewatch.drivers.twins.scene.world import WorldSettings
from tests.support.deformed import deformed, displacement, faded, field_of
from tests.support.rendered import FULL, SMALL, aspect, moved, world

HOME = np.eye(4)
DRAG_MM = 12.0
PRESSED = np.array([1.0, 0, 1.5, 5.0, -1.5, 0.6])
"""px: widened, pressed by more at one side, squeezed by less with depth."""
DRAGGED = np.array([0, 5.0, 0, 0, 0, 0])
NOTHING = np.zeros(6)


def seen(seed: int, number: int, elevation_mm: float = 0.0, full: bool = True) -> GreyImage:
    settings = FULL if full else SMALL
    return world(seed, settings, overlay=False).frame_at(moved(HOME, settings, elevation_mm=elevation_mm), number)


def warped(picture: GreyImage, u_px: Array, alpha_rad: float, give_px: Array) -> tuple[GreyImage, Array]:
    """The picture after that motion, and its field."""
    settings = FULL if picture.shape == (480, 640) else SMALL
    field_px = field_of(u_px, alpha_rad, give_px, picture.shape, aspect(settings))
    return deformed(picture, field_px, DRAG_MM / settings.scale_mm_per_px[1]), field_px


def keyframe(picture: GreyImage) -> Keyframe:
    settings = FULL if picture.shape == (480, 640) else SMALL
    return Keyframe(pyramid(picture), aspect(settings), axial_mm_per_px=float(settings.scale_mm_per_px[1]))


def free(found: Registration) -> Reading:
    """Of tissue that does all that it may."""
    return found.readings[DRAGS | PRESSES]


def apart_px(found: Array, truth: Array, fading: float = 0.36) -> float:
    """How far two fields put the points of the picture apart, root mean square. fading: share of the height."""
    x, y = np.meshgrid(np.linspace(-0.9, 0.9, 15), np.linspace(-0.9, 0.9, 15))
    difference = displacement(found - truth, x, y, faded((y + 1) / 2 / fading))
    return float(np.sqrt(np.square(difference).sum(axis=0).mean()))


@pytest.mark.parametrize(
    "give_px", [PRESSED, -PRESSED, DRAGGED, PRESSED + DRAGGED], ids=["press", "pull", "drag", "all"]
)
def test_tissue_that_gives_way_is_followed_and_deep_motion_is_told_from_it(give_px: Array) -> None:
    u_px, alpha_rad = np.array([3.3, -2.1]), 0.008
    later, field_px = warped(seen(1, 1), u_px, alpha_rad, give_px)
    found = keyframe(seen(1, 0)).register(pyramid(later))
    assert acceptable(found)
    assert found.correlation > 0.99
    np.testing.assert_allclose(free(found).u_px, u_px, atol=0.03)
    assert free(found).alpha_rad == pytest.approx(alpha_rad, abs=1.5e-4)
    assert apart_px(found.field, field_px) <= 0.05


def test_the_drag_of_the_skin_alone_is_neither_turn_nor_shift() -> None:
    """A rigid fit sees 1.3 px of shift in it."""
    later, _ = warped(seen(1, 1), np.zeros(2), 0.0, DRAGGED)
    found = keyframe(seen(1, 0)).register(pyramid(later))
    assert abs(found.u_px[0]) > 1
    for reading in found.readings[DRAGS], free(found):
        np.testing.assert_allclose(reading.u_px, 0, atol=0.03)
        assert reading.alpha_rad == pytest.approx(0, abs=2e-4)
        assert reading.drag_px == pytest.approx(5.0, abs=0.03)
    assert found.readings[0].drag_px == pytest.approx(0, abs=1e-3)


@pytest.mark.thorough
def test_stated_covariance_is_of_the_right_order_where_tissue_gives_way() -> None:
    """Errors of u and α in units of their own sigma, over thirty pairs that lost some likeness out of the plane."""
    random, errors = np.random.default_rng(3), []
    for k in range(30):
        u_px, alpha_rad, sizes = random.normal(0, 2, 2), random.normal(0, 0.006), random.normal(0, 1, 6)
        later, _ = warped(seen(1 + k % 5, 2 * k + 1, 0.3, full=False), u_px, alpha_rad, sizes * PRESSED.clip(0.5))
        found = free(keyframe(seen(1 + k % 5, 2 * k, full=False)).register(pyramid(later)))
        errors.append(np.r_[found.u_px - u_px, found.alpha_rad - alpha_rad] / np.sqrt(np.diag(found.covariance)))
    spread = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all(spread > 0.4), spread
    assert np.all(spread < 2.0), spread


def test_a_start_from_the_field_finds_what_a_rigid_start_finds() -> None:
    later, field_px = warped(seen(2, 1), np.array([2.0, 1.0]), -0.006, PRESSED)
    home, levels = keyframe(seen(2, 0)), pyramid(later)
    cold, warm = home.register(levels), home.register(levels, field_px)
    assert apart_px(cold.field, warm.field) <= 0.03
    assert warm.correlation == pytest.approx(cold.correlation, abs=1e-3)


def test_where_millimetres_are_unknown_the_drag_reaches_down_a_quarter_of_the_picture() -> None:
    picture = seen(1, 1, full=False)
    field_px = field_of(np.zeros(2), 0.0, DRAGGED / 2, picture.shape, aspect(SMALL))
    later = deformed(picture, field_px, picture.shape[0] / 4)
    found = Keyframe(pyramid(seen(1, 0, full=False)), aspect(SMALL)).register(pyramid(later))
    assert apart_px(found.field, field_px, 0.25) <= 0.05


def rigid_errors(seeds: range) -> Array:
    """(n, 3) of u px and α rad, of pairs that lost likeness out of the plane."""
    found = []
    for seed in seeds:
        later, _ = warped(seen(seed, 1, 0.35), np.array([2.4, -1.7]), 0.0, NOTHING)
        got = keyframe(seen(seed, 0)).register(pyramid(later))
        found.append([*(got.u_px - [2.4, -1.7]), got.alpha_rad])
    return np.array(found)


@pytest.mark.thorough
def test_rigid_tissue_is_registered_as_sharply_as_by_a_rigid_fit() -> None:
    """Which had these errors, px and rad, in the same pairs (348a5c7)."""
    rms = np.sqrt(np.mean(np.square(rigid_errors(range(1, 9))), axis=0))
    assert np.all(rms <= 1.1 * np.array([0.0296, 0.0240, 6.7e-5])), rms


def tracked(frames: list[GreyImage], settings: WorldSettings = SMALL) -> list[Registration]:
    tracker = RealTimeTracker(aspect(settings), float(settings.scale_mm_per_px[1]))
    found = [tracker.step(frame, k).registration for k, frame in enumerate(frames)]
    return [registration for registration in found if registration is not None]


def test_a_rock_of_a_probe_that_presses_is_seen_in_full() -> None:
    """By the reading of tissue that presses; ∂u_y/∂x shows what the tissue does not follow."""
    turns = 0.006 * np.sin(np.linspace(0, 2 * np.pi, 15))
    frames = [seen(1, 0, full=False)]
    for k, turn in enumerate(turns[1:]):
        give_px = turn / 0.006 * np.array([0.3, 0, 0, 2.5, -0.5, 0.3]) - np.array([0, 0, 80 * turn, 0, 0, 0])
        frames.append(warped(seen(1, k + 1, full=False), np.array([0.2 * k, 0]), turn, give_px)[0])
    found = tracked(frames)
    turned, tilted = np.array([(one.readings[PRESSES].alpha_rad, one.tilt_rad) for one in found]).T
    assert turned @ turns[1:] / (turns @ turns) == pytest.approx(1, abs=0.03)
    assert tilted @ turns[1:] / (turns @ turns) == pytest.approx(1 - 80 * aspect(SMALL) / 159.5, abs=0.03)


def test_a_quick_press_is_followed() -> None:
    """1 mm between two pictures, which is 14 px at the skin, less below."""
    give_px, u_px = np.array([0, 0, 0, 5.0, -1.5, 0]), np.array([0, -7.0])
    frames = [seen(2, 0, full=False)] * 2
    later, field_px = warped(seen(2, 1, full=False), u_px, 0.0, give_px)
    found = tracked([*frames, later])[-1]
    assert found.correlation > 0.95
    assert apart_px(found.field, field_px) <= 0.1
