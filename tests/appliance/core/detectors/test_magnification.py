"""A press strains tissue, and is no zoom."""

import numpy as np
import pytest

from probewatch.appliance.core.detectors.magnification import Magnification, magnified, pressed_between
from probewatch.appliance.core.detectors.picture_link import View
from probewatch.appliance.core.detectors.stretch import warped
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array, inverse, rigid, rotation_from_vector
from tests.support.motions import TRUTH

PICTURE = np.random.default_rng(1).normal(100, 30, (30, 40)).astype(np.float32).repeat(4, axis=0).repeat(4, axis=1)
NOT_PRESSED, PRESSED = np.zeros(2), np.array([0.15, 0.0])


def stretched(across: float, down: float) -> Array:
    return np.array([[across, 0, 80 * (1 - across)], [0, down, 60 * (1 - down)]])


def told(across: float, down: float, pressed: Array) -> bool:
    """Whether a picture that is stretched so within half a second ends what was shown."""
    found = Magnification(1.0)
    for k in range(4):
        share = k / 3
        seen = warped(PICTURE, stretched(across**share, down**share))
        found.step(170_000_000 * k, seen, (np.zeros(2), 0.0), pressed / 3)
    return found.crept() is not None


def test_a_strain_is_a_change_unless_the_face_has_pressed_so_far() -> None:
    assert told(1.06, 0.86, NOT_PRESSED)
    assert not told(1.06, 0.86, -PRESSED)
    assert not told(1.06, 0.86, PRESSED), "of a face that comes up tissue is let go"
    assert told(1.06, 0.7, PRESSED), "by more than any tissue"


def test_a_zoom_is_one_though_the_face_presses_meanwhile() -> None:
    change = magnified(np.log([1.3, 1.3]), PRESSED)
    assert change is not None
    assert change.zoom == pytest.approx((1.3, 1.3))


def view(pose: Array | None) -> View:
    return View(0, PICTURE, pose)


def posed(motion: Array, reference: Calibration = TRUTH) -> Array:
    """The sensor after a motion of the picture, (4, 4) in its own axes, mm."""
    X = rigid(reference.rotation, reference.offset_mm)
    return np.asarray(inverse(X) @ motion @ X)


def test_a_press_and_a_rock_count_in_heights_of_the_picture() -> None:
    """33.6 mm high and 51.2 mm wide."""
    home = posed(np.eye(4))
    down = rigid(np.eye(3), np.array([0, 3.36, 0]))
    np.testing.assert_allclose(np.abs(pressed_between(TRUTH, view(home), view(posed(down)))), [0.1, 0], atol=1e-9)
    rock = rigid(rotation_from_vector(np.array([0, 0, 0.1])), np.zeros(3))
    np.testing.assert_allclose(np.abs(pressed_between(TRUTH, view(home), view(posed(rock)))[1]), 0.0762, atol=1e-4)
    np.testing.assert_array_equal(pressed_between(TRUTH, view(None), view(home)), [0, 0])
