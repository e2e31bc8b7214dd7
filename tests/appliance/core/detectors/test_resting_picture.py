"""Pictures of a probe at rest that change little by little: what tissue does, and what it does not."""

from collections.abc import Iterable
from functools import cache

import cv2
import numpy as np
import pytest

from probewatch.appliance.core.detectors.picture_change import PictureChange
from probewatch.appliance.core.detectors.picture_link import Link, View, link_between, small
from probewatch.appliance.core.detectors.resting_picture import RestingPicture
from probewatch.appliance.core.detectors.stretch import carried
from probewatch.appliance.core.registration.pyramid import Array32
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import rigid
from probewatch.drivers.samples import GreyImage, Matrix4

FRAME_NS = 100_000_000
WIDTH, ROWS = 160, 120
REFERENCE = Calibration(np.eye(3), (1, 1), np.full(2, 0.2), np.zeros(3), (WIDTH, ROWS))
AT_REST: Matrix4 = np.eye(4)
CALM, A_BREATH, TEN_S = 10, 40, 100
"""Pictures."""


@cache
def planes() -> np.ndarray:
    """(24, h, w) independent speckle."""
    noise = np.random.default_rng(3).normal(size=(24, ROWS, WIDTH)).astype(np.float32)
    smooth = [cv2.GaussianBlur(one, (0, 0), 1.5) for one in noise]
    return np.array([45 * one / one.std() for one in smooth])


def tissue(out_of_plane: float = 0.0) -> GreyImage:
    """Seen by a beam of a thickness of 1, so far out of the plane in which the rest began."""
    weights = np.exp(-((np.arange(24) - 6 - out_of_plane) ** 2) / 2)
    seen = np.tensordot(weights / np.linalg.norm(weights), planes(), 1)
    return np.clip(128 + seen, 0, 255).astype(np.uint8)


def zoomed(across: float, down: float) -> GreyImage:
    M = np.array([[across, 0, (1 - across) * WIDTH / 2], [0, down, (1 - down) * ROWS / 2]])
    return np.asarray(cv2.warpAffine(tissue(), M, (WIDTH, ROWS)), np.uint8)


def faded(share: float) -> GreyImage:
    return faded_into(cv2.flip(tissue(), 1), share)


def faded_into(other: GreyImage, share: float) -> GreyImage:
    return np.asarray(cv2.addWeighted(tissue(), 1 - share, other, share, 0), np.uint8)


def wiped(share: float) -> GreyImage:
    row = int(share * ROWS)
    return np.vstack([cv2.flip(tissue(), 1)[:row], tissue()[row:]])


def watched(pictures: Iterable[GreyImage], poses: Iterable[Matrix4] | None = None) -> list[PictureChange | None]:
    """What is told of each of the pictures, after a second in which nothing moved."""

    def link(view: View, first: View) -> tuple[Array32, Link | None]:
        found = link_between(first.small, view.small, np.zeros(2), np.full(2, 20.0))
        return carried(first.small, (np.zeros(2) if found is None else found.moved_px, 0.0), 1.0), found

    resting = RestingPicture(REFERENCE, 1.0, np.deg2rad(3.0), 0.035, link)
    shown = [*[tissue()] * CALM, *pictures]
    where = [AT_REST] * len(shown) if poses is None else [*[AT_REST] * CALM, *poses]
    views = (View(k * FRAME_NS, small(image), pose) for k, (image, pose) in enumerate(zip(shown, where, strict=True)))
    return [resting.step(view, (np.zeros(2), 0.0)) for view in views][CALM:]


def first(told: list[PictureChange | None]) -> int | None:
    return next((k for k, change in enumerate(told) if change is not None), None)


@pytest.mark.parametrize("how", [faded, wiped])
@pytest.mark.parametrize("lasting", [4, 12, 25])
def test_what_shows_nothing_but_the_two_in_between_is_another_picture(how, lasting: int) -> None:
    told = watched(how(min(k / lasting, 1.0)) for k in range(lasting + 4))
    assert first(told) is not None
    assert told[first(told)] == PictureChange()


@pytest.mark.parametrize("far", [1.0, 2.0, 4.0, 12.0])
def test_tissue_that_breathes_out_of_the_plane_is_none(far: float) -> None:
    """It passes through what lies between, and comes back."""
    told = watched(tissue(far * np.sin(np.pi * k / A_BREATH) ** 2) for k in range(3 * A_BREATH))
    assert first(told) is None


def test_tissue_that_does_not_come_back_is_after_a_breath() -> None:
    told = watched(tissue(4.0 * min(k / 20, 1.0)) for k in range(TEN_S + 20))
    assert 80 <= first(told) <= 100


def test_a_hand_that_goes_elsewhere_looks_at_other_tissue() -> None:
    """4 mm out of the plane, by the tracker as well."""
    ways = [4.0 * min(k / 20, 1.0) for k in range(TEN_S + 20)]
    poses = [np.asarray(rigid(np.eye(3), np.array([0.0, 0.0, way]))) for way in ways]
    assert first(watched((tissue(way) for way in ways), poses)) is None


def test_a_zoom_of_seconds_is_told() -> None:
    told = watched(zoomed(1.12 ** min(k / 40, 1.0), 1.12 ** min(k / 40, 1.0)) for k in range(40))
    change = told[first(told)]
    assert change.zoom == pytest.approx((1.08, 1.08), abs=0.03)


def test_a_stretch_along_one_axis_that_stays_is_no_breath() -> None:
    told = watched(zoomed(1.0, 1.08 ** min(k / 20, 1.0)) for k in range(TEN_S + 20))
    assert told[first(told)] == PictureChange()
    assert first(told) >= 80


@pytest.mark.parametrize("down", [1.055, 0.945])
def test_a_small_one_that_stays_is_none_under_a_trembling_hand(down: float) -> None:
    """It was never told: the face pressed by as much now and then, to and fro."""
    presses_mm = [0.5 * np.sin(k / 2) for k in range(TEN_S + 20)]
    poses = [np.asarray(rigid(np.eye(3), np.array([0.0, press, 0.0]))) for press in presses_mm]
    told = watched((zoomed(1.0, down ** min(k / 20, 1.0)) for k in range(TEN_S + 20)), poses)
    assert told[first(told)] == PictureChange()
    assert first(told) >= 80


@pytest.mark.parametrize(("across", "down"), [(1.0, 1.055), (1.0, 0.945), (1.055, 1.0), (0.945, 1.0)])
@pytest.mark.parametrize("lasting", [2, 3])
def test_a_fade_into_a_small_stretch_is_told_within_a_second(across: float, down: float, lasting: int) -> None:
    """It was after 8 s, or, where the hand's tremor pressed now and then, never."""
    shares = [min(k / lasting, 1.0) for k in range(1, 30)]
    tremor = [0.15 * np.sin(k) for k in range(1, 30)]
    poses = [np.asarray(rigid(np.eye(3), np.array([0.0, way, 0.0]))) for way in tremor]
    told = watched((faded_into(zoomed(across, down), share) for share in shares), poses)
    assert first(told) is not None
    assert first(told) <= lasting + 10
    assert told[first(told)] == PictureChange()


def test_a_stretch_that_comes_and_goes_with_the_breath_is_tissue() -> None:
    told = watched(zoomed(1.0, 1.08 ** (np.sin(np.pi * k / A_BREATH) ** 2)) for k in range(3 * A_BREATH))
    assert first(told) is None


def test_a_menu_over_a_third_of_the_picture_is_none() -> None:
    menu = tissue()
    menu[:, 105:], menu[::6, 105:] = 40, 90
    assert first(watched([menu] * TEN_S)) is None
