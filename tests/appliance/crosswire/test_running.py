"""The calibration while it is scanned: what it says after each view, and every reason why it may not be accepted."""

import time
from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.crosswire.running import Reason, Running, RunningCalibration, WholeDemand
from probewatch.appliance.types import Calibration
from tests.support.crossings import SIZE_PX, TRUE, errors, guided_views


def running(views, reference: Calibration | None = None, **options) -> RunningCalibration:
    calibration = RunningCalibration(SIZE_PX, reference, **options)
    for view in views:
        calibration.add(view)
    return calibration


def reasons(state: Running) -> list[Reason]:
    return [refusal.reason for refusal in state.refusals]


def test_a_guided_scan_is_acceptable_and_says_what_it_found() -> None:
    state = running(guided_views(1)).state()
    assert state.refusals == ()
    assert state.whole is not None
    assert np.all(np.abs(errors(state.whole)) < 4.5 * state.whole.sigma)
    assert abs(state.zeta_mm - 14) < 4 * state.zeta_sigma_mm < 0.6
    assert state.closed is not None
    assert state.coverage.bins.sum(axis=1).tolist() == [int(state.used.sum())] * 3
    assert state.coverage.next_motion == ""
    assert state.coverage.in_picture_axes
    assert np.nanmax(np.linalg.norm(state.cloud_mm[state.used], axis=1)) < 1


def test_a_scan_grows_from_nothing_to_enough() -> None:
    calibration, told = RunningCalibration(SIZE_PX), []
    for view in guided_views(2, 60):
        calibration.add(view)
        told.append(calibration.state())
    assert told[0].whole is None
    assert np.isnan(told[0].zeta_mm)
    assert reasons(told[0]) == [Reason.TOO_FEW_VIEWS]
    assert all(state.coverage.next_motion for state in told[:15])
    assert told[-1].refusals == ()
    sigmas = [state.zeta_sigma_mm for state in told[15:]]
    assert sigmas[-1] < sigmas[0] / 1.5


def test_views_struck_out_or_corrected_by_hand_change_the_result_and_can_come_back() -> None:
    calibration = running(guided_views(3, 40))
    before = calibration.state()
    calibration.strike(4)
    calibration.strike(-1)
    struck = calibration.state()
    assert struck.struck == (4, 39)
    assert not struck.used[4]
    assert np.isnan(struck.cloud_mm[4]).all()
    assert struck.zeta_mm != before.zeta_mm
    calibration.strike(4, False)
    calibration.strike(39, False)
    assert calibration.state().zeta_mm == before.zeta_mm
    column, row = calibration.views[7].centre_px
    calibration.correct(7, (float(column) + 90, float(row)))
    assert calibration.state().rejected == (7,)
    with pytest.raises(IndexError):
        calibration.strike(40)
    with pytest.raises(ValueError, match="outside of the picture"):
        calibration.correct(0, (640.0, 3.0))
    with pytest.raises(ValueError, match="outside of the picture"):
        calibration.correct(0, (np.nan, 3.0))


@pytest.mark.parametrize(
    ("tilt_deg", "parameter"),
    [((1.5, 15, 15), "rotation-lateral"), ((15, 1.5, 15), "rotation-axial")],
)
def test_too_little_tilt_names_the_axis(tilt_deg, parameter: str) -> None:
    state = running(guided_views(4, 60, tilt_deg=tilt_deg)).state()
    refused = [one for one in state.refusals if one.reason is Reason.TOO_LITTLE_TILT]
    assert [one.parameter for one in refused] == [parameter]
    assert "5° is needed" in refused[0].what


def test_without_any_tilt_nothing_is_observed_and_no_number_pretends() -> None:
    state = running(guided_views(5, 60, tilt_deg=(0.1, 0.1, 0.1))).state()
    assert {Reason.TOO_LITTLE_TILT, Reason.NOT_OBSERVED} <= set(reasons(state))
    named = {one.parameter for one in state.refusals if one.reason is Reason.NOT_OBSERVED}
    assert {"offset-lateral", "offset-axial", "offset-elevational"} <= named
    assert all(one.remedy for one in state.refusals)


def test_a_crossing_always_in_one_place_leaves_scales_and_rotation_unseen() -> None:
    state = running(guided_views(6, 60, reach_mm=(0.05, 0.05))).state()
    named = {one.parameter for one in state.refusals if one.reason is Reason.NOT_OBSERVED}
    assert {"scale-lateral", "scale-axial"} <= named


def test_noise_is_named() -> None:
    state = running(guided_views(7, 200, noise_mm=1.5)).state()
    assert Reason.NOISE_TOO_HIGH in reasons(state)


def test_wires_that_pass_one_another_are_named() -> None:
    state = running(guided_views(8, 3)).state(misses_mm=[2.1, 2.0, 2.2, 1.9, 2.0])
    assert reasons(state)[0] is Reason.WIRES_DO_NOT_CROSS
    assert "2.0 mm apart" in state.refusals[0].what
    assert Reason.WIRES_DO_NOT_CROSS not in reasons(running(guided_views(8, 9)).state(misses_mm=[2.0] * 5))


def test_one_way_passages_without_known_latency_are_named() -> None:
    views = [replace(view, earlier=None, later=None, apart_s=0.0) for view in guided_views(9, 60)]
    assert Reason.LATENCY_NOT_KNOWN in reasons(running(views).state())
    assert Reason.LATENCY_NOT_KNOWN not in reasons(running(views, latency_sigma_s=0.01).state())


def test_the_polarity_of_the_reference_is_kept() -> None:
    true = replace(TRUE, polarity=(-1, 1))
    state = running(guided_views(10, 60, true=true), reference=true).state()
    assert state.whole is not None
    assert state.whole.calibration.polarity == (-1, 1)
    assert np.all(np.abs(errors(state.whole, true)) < 4.5 * state.whole.sigma)


def test_contradicting_views_are_named_and_nothing_is_solved() -> None:
    random = np.random.default_rng(1)
    views = [replace(view, centre_px=random.uniform([0, 0], SIZE_PX)) for view in guided_views(11, 40)]
    state = running(views).state()
    assert state.refusals
    assert set(reasons(state)) & {Reason.CONTRADICTION, Reason.NOISE_TOO_HIGH}


def test_a_stricter_demand_is_kept() -> None:
    state = running(guided_views(12, 60), demand=WholeDemand(offset_mm=0.01)).state()
    assert {one.parameter for one in state.refusals} >= {"offset-elevational"}


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e9])
def test_views_that_hold_no_sense_are_refused_when_they_come(bad: float) -> None:
    good, calibration = guided_views(14, 1)[0], RunningCalibration(SIZE_PX)
    torn = good.matrix.copy()
    torn[0, 3] = bad
    bent = good.matrix.copy()
    bent[:3, :3] *= 1.5
    for view in (
        replace(good, matrix=torn),
        replace(good, earlier=torn),
        replace(good, matrix=bent),
        replace(good, centre_px=np.array([bad, 3.0])),
        replace(good, covariance_px=np.diag([bad, 1.0])),
        replace(good, covariance_px=-np.eye(2)),
    ):
        with pytest.raises(ValueError, match="a view"):
            calibration.add(view)
    assert calibration.views == ()


def test_a_probe_that_stands_still_gives_no_calibration() -> None:
    state = running([guided_views(15, 1)[0]] * 40).state()
    assert Reason.TOO_LITTLE_TILT in reasons(state)
    assert state.zeta_sigma_mm > 30


@pytest.mark.thorough
def test_three_hundred_views_are_solved_in_a_fifth_of_a_second() -> None:
    calibration = running(guided_views(13, 300))
    started = time.process_time()
    calibration.state()
    assert time.process_time() - started < 0.2


@pytest.mark.parametrize(
    ("axis", "side", "missing"),
    [(0, 1, "away from you"), (1, 1, "anticlockwise"), (2, -1, "to the right")],
)
def test_the_next_motion_is_to_the_side_that_is_missing(axis: int, side: int, missing: str) -> None:
    """Views tilted to both sides of the two other axes, and to one side of this one."""
    views = guided_views(16, 300, tilt_deg=(18.0, 18.0, 18.0))
    angles = running(views).state().coverage.angles_deg[:, axis]
    angles = angles - np.median(angles)
    chosen = [view for view, angle in zip(views, angles, strict=True) if -2 < side * angle < 9]
    chosen += [view for view, angle in zip(views, angles, strict=True) if side * angle > 25][:3]
    state = running(chosen).state()
    assert missing in state.coverage.next_motion
