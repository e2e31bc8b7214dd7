"""Registration of rendered pictures against the motion that was rendered; overlay present unless said otherwise."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from probewatch.appliance.core.registration.keyframe import Keyframe, compose, warp_matrix
from probewatch.appliance.core.registration.pyramid import pyramid
from probewatch.appliance.core.registration.realtime_tracker import RealTimeTracker, acceptable
from probewatch.drivers.twins.scene.world import World
from tests.support.rendered import (
    FULL,
    SMALL,
    aspect,
    learnt_mask,
    levels,
    moved,
    rms_px,
    sweep,
    true_motion,
    world,
)

HOME = np.eye(4)


def errors_px(seed: int, motions: Sequence[tuple[tuple[float, float], float]], frames: int) -> list[float]:
    """Error of the path, RMS px, after each smooth motion of so many pictures, by one tracker that learnt the overlay.

    It changes the keyframe where the likeness falls below 0.8, as the Motion Analyzer does.
    """
    seen = world(seed, FULL)
    tracker = RealTimeTracker(aspect(FULL))
    for k, image in enumerate(sweep(seen, 11)):
        tracker.step(image, k)
    return [_error_px(seen, tracker, 1000 * (k + 1), motion, frames) for k, motion in enumerate(motions)]


def _error_px(
    seen: World, tracker: RealTimeTracker, number: int, motion: tuple[tuple[float, float], float], frames: int
) -> float:
    (right_px, down_px), turn_deg = motion
    tracker.restart()
    for k in range(frames + 1):
        share = k / frames
        pose = moved(HOME, FULL, (right_px * share, down_px * share), turn_deg * share)
        found = tracker.step(seen.frame_at(pose, number + k), number + k)
        if found.registration is not None and found.registration.correlation < 0.8:
            tracker.renew_keyframe()
    return rms_px(found.path, true_motion(HOME, pose, FULL), FULL)


@pytest.mark.thorough
def test_up_to_20_px_and_3_deg_are_followed_within_a_twentieth_of_a_pixel() -> None:
    """RMS over three tissues and the range of motion; no single motion is worse than 0.12 px."""
    motions = [((20, 0), 0), ((0, 20), 1), ((14, -14), 2), ((5, 5), -2), ((14, 14), 3)]
    errors = [error for seed in (1, 2, 3) for error in errors_px(seed, motions, frames=6)]
    assert np.sqrt(np.mean(np.square(errors))) <= 0.05, np.round(errors, 3)
    assert max(errors) <= 0.12, np.round(errors, 3)


@pytest.mark.slow
def test_the_error_over_the_whole_range_of_motion() -> None:
    """Eight tissues. By 3° the picture looks so different that several keyframes lie between, each with its error."""
    turns_deg = (0, 1, 2, 3)
    motions = [(px, turn_deg) for turn_deg in turns_deg for px in ((0, 0), (20, 0), (-14, 14))]
    errors = np.array([errors_px(seed, motions, frames=10) for seed in range(1, 9)])
    print(f"{np.sqrt(np.mean(np.square(errors))):.4f} px RMS over all")
    for k, turn_deg in enumerate(turns_deg):
        rms = np.sqrt(np.mean(np.square(errors[:, 3 * k : 3 * k + 3])))
        print(f"{turn_deg}°: {rms:.4f} px RMS")
        assert rms <= (0.01, 0.04, 0.05, 0.065)[k]
    assert np.sqrt(np.mean(np.square(errors))) <= 0.05


@pytest.mark.parametrize("px", [(0, 0), (0.5, 0), (2, 0), (0, 5), (10, -10), (20, 0), (0, -20), (28, 28)])
def test_one_registration_of_a_translation(px: tuple[float, float]) -> None:
    seen = world()
    later = moved(HOME, SMALL, px)
    found = Keyframe(levels(seen, HOME, 0), aspect(SMALL), learnt_mask(seen).mask).register(levels(seen, later, 1))
    assert found.converged
    assert rms_px((found.u_px, found.alpha_rad), true_motion(HOME, later, SMALL), SMALL) <= 0.05


@pytest.mark.parametrize("turn_deg", [0.3, -0.6, 1.0, -1.0])
def test_one_registration_of_a_turn(turn_deg: float) -> None:
    seen = world(1, FULL)
    later = moved(HOME, FULL, (6, -3), turn_deg)
    found = Keyframe(levels(seen, HOME, 0), aspect(FULL), learnt_mask(seen).mask).register(levels(seen, later, 1))
    assert rms_px((found.u_px, found.alpha_rad), true_motion(HOME, later, FULL), FULL) <= 0.05
    assert found.alpha_rad == pytest.approx(np.deg2rad(-turn_deg), abs=2e-4)


@pytest.mark.parametrize(
    ("out_mm", "least", "most"), [(0.2, 0.93, 0.97), (0.33, 0.87, 0.92), (0.5, 0.79, 0.86), (1.0, 0.58, 0.68)]
)
def test_likeness_falls_with_the_way_out_of_the_plane(out_mm: float, least: float, most: float) -> None:
    """What the rest, the motion analyser and the slip watch take from it; exp(−d²/2) is .88 at .5 mm, .61 at 1 mm."""
    found = []
    for seed in range(1, 6):
        seen = world(seed)
        home, away = (levels(seen, moved(HOME, SMALL, elevation_mm=mm), n) for n, mm in enumerate((0.0, out_mm)))
        found.append(Keyframe(home, aspect(SMALL), learnt_mask(seen).mask).register(away).correlation)
    assert least <= np.median(found) <= most


def test_words_all_over_the_picture_hold_the_registration_back_unless_they_are_masked() -> None:
    seen = world(1, SMALL, overlay=False)
    later = moved(HOME, SMALL, (2, 0))
    words = np.zeros((240, 320), np.uint8)
    for row in range(16, 240, 16):
        cv2.putText(words, "MI 0.8 TIS 0.2 DR 60 Gn 50 FR 30 Hz", (4, row), cv2.FONT_HERSHEY_SIMPLEX, 0.4, 250, 1)
    before, after = (pyramid(cv2.max(seen.frame_at(pose, k), words)) for k, pose in enumerate((HOME, later)))
    mask = cv2.dilate(words, np.ones((7, 7), np.uint8)) == 0
    blind, masked = (Keyframe(before, aspect(SMALL), known).register(after) for known in (None, mask))
    truth = true_motion(HOME, later, SMALL)
    held_back_px, free_px = (rms_px((found.u_px, found.alpha_rad), truth, SMALL) for found in (blind, masked))
    assert free_px <= 0.05
    assert held_back_px > 3 * free_px


@pytest.mark.parametrize(("gain", "bias"), [(0.7, 30.0), (1.25, -20.0), (1.0, 15.0)])
def test_gain_and_bias_are_recovered_and_do_not_disturb(gain: float, bias: float) -> None:
    """Grey values are kept from saturation, where no gain could be read off them."""
    seen = world(1, SMALL, overlay=False)
    later = moved(HOME, SMALL, (4, 3))
    before, after = seen.frame_at(HOME, 0).clip(20, 180), seen.frame_at(later, 1).clip(20, 180)
    lit = np.round(gain * after + bias).clip(0, 255).astype(np.uint8)
    found = Keyframe(pyramid(before), aspect(SMALL)).register(pyramid(lit))
    plain = Keyframe(pyramid(before), aspect(SMALL)).register(pyramid(after))
    assert found.gain / plain.gain == pytest.approx(gain, rel=0.02)
    assert found.bias - gain * plain.bias == pytest.approx(bias, abs=2.0)
    assert rms_px((found.u_px, found.alpha_rad), true_motion(HOME, later, SMALL), SMALL) <= 0.05


def test_a_turn_acts_in_millimetres_not_in_pixels() -> None:
    """With square pixels assumed where they are not, a degree of turn costs several tenths of a pixel."""
    settings = replace(SMALL, scale_mm_per_px=(0.1, 0.06))
    seen = world(1, settings)
    later = moved(HOME, settings, (0, 0), 1.0)
    truth = true_motion(HOME, later, settings)
    right, square = (
        Keyframe(levels(seen, HOME, 0), ratio, learnt_mask(seen).mask).register(levels(seen, later, 1))
        for ratio in (aspect(settings), 1.0)
    )
    good = rms_px((right.u_px, right.alpha_rad), truth, settings)
    assert good <= 0.1
    assert rms_px((square.u_px, square.alpha_rad), truth, settings, found_aspect=1.0) > max(5 * good, 0.3)


@pytest.mark.thorough
def test_stated_covariance_is_of_the_right_order() -> None:
    """Errors in units of their own sigma, over forty pairs of four tissues that lost some likeness by turn."""
    errors = []
    for k in range(40):
        seen = world(1 + k % 4, SMALL)
        mask = learnt_mask(seen).mask
        first = moved(HOME, SMALL, (4.0 * (k % 8) - 14, 5.0 * (k // 8) - 10), 0, 0.35 * (k % 10))
        later = moved(first, SMALL, (3, -2), 0.6)
        found = Keyframe(levels(seen, first, 2 * k), aspect(SMALL), mask).register(levels(seen, later, 2 * k + 1))
        u_px, alpha_rad = true_motion(first, later, SMALL)
        errors.append(np.r_[found.u_px - u_px, found.alpha_rad - alpha_rad] / np.sqrt(np.diag(found.covariance)))
    spread = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all(spread > 0.4), spread
    assert np.all(spread < 2.0), spread


def test_a_warm_start_finds_what_a_cold_one_finds() -> None:
    seen = world()
    later = moved(HOME, SMALL, (12, -7), 0.8)
    keyframe = Keyframe(levels(seen, HOME, 0), aspect(SMALL), learnt_mask(seen).mask)
    cold = keyframe.register(levels(seen, later, 1))
    warm = keyframe.register(levels(seen, later, 1), true_motion(HOME, later, SMALL))
    np.testing.assert_allclose(warm.u_px, cold.u_px, atol=0.03)
    assert warm.alpha_rad == pytest.approx(cold.alpha_rad, abs=2e-4)


def test_overlap_says_how_much_of_the_keyframe_is_left() -> None:
    seen = world(1, SMALL, overlay=False)
    found = Keyframe(levels(seen, HOME, 0), aspect(SMALL)).register(levels(seen, moved(HOME, SMALL, (32, 0)), 1))
    assert found.overlap == pytest.approx(0.9, abs=0.03)


@pytest.mark.parametrize("grey", [0, 90, 255])
@pytest.mark.parametrize("size_px", [(320, 240), (12, 9)])
def test_a_picture_without_structure_cannot_be_a_keyframe(grey: int, size_px: tuple[int, int]) -> None:
    plain = np.full(size_px[::-1], grey, np.uint8)
    assert not Keyframe(pyramid(plain), 1.0).textured


def test_a_picture_of_another_size_is_not_registered() -> None:
    """Though its levels are as large: at 900 px and more a picture is worked on at half its size."""
    small = np.random.default_rng(1).integers(0, 256, (450, 600)).astype(np.uint8)
    keyframe = Keyframe(pyramid(np.repeat(np.repeat(small, 2, 0), 2, 1)), 1.0)
    with pytest.raises(ValueError, match=r"\(450, 600\) px, but a keyframe of \(900, 1200\)"):
        keyframe.register(pyramid(small))


def test_everything_masked_is_no_structure_either() -> None:
    picture = pyramid(world().frame_at(HOME))
    assert not Keyframe(picture, 1.0, np.zeros(picture.finest.shape, dtype=bool)).textured


@pytest.mark.parametrize("kind", ["black", "noise", "elsewhere"])
def test_a_picture_that_is_not_the_keyframe_is_not_acceptable(kind: str) -> None:
    seen = world()
    pictures = {
        "black": np.zeros((240, 320), np.uint8),
        "noise": np.random.default_rng(1).integers(0, 256, (240, 320), dtype=np.uint8),
        "elsewhere": seen.frame_at(moved(HOME, SMALL, elevation_mm=5.0)),
    }
    keyframe = Keyframe(levels(seen, HOME, 0), aspect(SMALL), learnt_mask(seen).mask)
    found = keyframe.register(pyramid(pictures[kind]))
    assert not acceptable(found)
    assert np.all(np.isfinite(found.covariance))


def test_a_new_shadow_does_not_pull_the_registration() -> None:
    """A tenth of the picture loses 14 dB."""
    seen = world(1, FULL)
    later = moved(HOME, FULL, (3, 2))
    shadowed = seen.frame_at(later, 1)
    shadowed[:, 250:314] = cv2.subtract(shadowed[:, 250:314], 60)
    found = Keyframe(levels(seen, HOME, 0), aspect(FULL), learnt_mask(seen).mask).register(pyramid(shadowed))
    assert rms_px((found.u_px, found.alpha_rad), true_motion(HOME, later, FULL), FULL) <= 0.05


@pytest.mark.parametrize("size_px", [(1440, 1080), (1921, 1441)])
def test_a_large_picture_is_worked_on_at_a_smaller_size_and_told_in_its_own_pixels(size_px: tuple[int, int]) -> None:
    """Enlarged e-fold, pixel x becomes pixel (x + ½) · e − ½, so that the centre stays the centre."""
    seen = world(1, FULL, overlay=False)
    later = moved(HOME, FULL, (6, -3), 1.0)
    u_px, alpha_rad = true_motion(HOME, later, FULL)
    before, after = (cv2.resize(seen.frame_at(pose, k), size_px) for k, pose in enumerate((HOME, later)))
    enlarged = np.array(size_px) / (640, 480)
    ratio = aspect(FULL) * enlarged[0] / enlarged[1]
    found = Keyframe(pyramid(before), ratio).register(pyramid(after))
    assert np.allclose(found.u_px / enlarged, u_px, atol=0.05), found.u_px / enlarged - u_px
    assert found.alpha_rad == pytest.approx(alpha_rad, abs=3e-4)
    assert found.overlap == pytest.approx(0.98, abs=0.02)


def test_pyramid_levels_halve_and_keep_their_places() -> None:
    """Row i of a level is the mean of rows 2 i and 2 i + 1 of the finer one: a ramp stays the same ramp."""
    ramp = np.repeat(np.arange(200, dtype=np.uint8)[:, None], 161, axis=1)
    found = pyramid(ramp)
    assert [level.shape for level in found.levels] == [(200, 161), (100, 80), (50, 40), (25, 20)]
    for k, level in enumerate(found.levels):
        rows = np.arange(2, level.shape[0] - 2)
        np.testing.assert_allclose(level[2:-2, 5] / 9, 2.0**k * (rows + 0.5) - 0.5, atol=0.1)


@pytest.mark.thorough
def test_a_picture_moved_by_whole_pixels_is_found_there_to_a_hundredth() -> None:
    """Bytes would be looked up in 32nds of a pixel, and every place within a few hundredths would fit as well."""
    errors_px = []
    for seed in (1, 2, 3, 4):
        seen = world(seed, FULL, overlay=False)
        later = moved(HOME, FULL, (10, 0))
        found = Keyframe(levels(seen, HOME, 0), aspect(FULL)).register(levels(seen, later, 1))
        errors_px.append(found.u_px - true_motion(HOME, later, FULL)[0])
    assert np.max(np.abs(errors_px)) <= 0.01, np.round(errors_px, 3)


shifts_px = st.tuples(st.floats(-50, 50), st.floats(-50, 50)).map(np.array)
turns_rad = st.floats(-1, 1)


@given(shifts_px, turns_rad, shifts_px, turns_rad, st.floats(0.3, 3), shifts_px)
def test_composed_warps_move_points_one_after_the_other(
    u_1: np.ndarray, a_1: float, u_2: np.ndarray, a_2: float, ratio: float, point: np.ndarray
) -> None:
    u, alpha = compose((u_1, a_1), (u_2, a_2), ratio)
    after_first = warp_matrix(a_1, ratio) @ point + u_1
    np.testing.assert_allclose(
        warp_matrix(alpha, ratio) @ point + u, warp_matrix(a_2, ratio) @ after_first + u_2, atol=1e-9
    )


@given(turns_rad, st.floats(0.3, 3))
def test_a_warp_is_a_rotation_once_it_is_in_millimetres(alpha_rad: float, ratio: float) -> None:
    to_mm = np.diag([1.0, ratio])
    R = to_mm @ warp_matrix(alpha_rad, ratio) @ np.linalg.inv(to_mm)
    np.testing.assert_allclose(R @ R.T, np.eye(2), atol=1e-12)
    assert cv2.determinant(R) == pytest.approx(1)
