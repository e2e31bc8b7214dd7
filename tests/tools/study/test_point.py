"""What the study says of the error of a point is what geometry says."""

import numpy as np
import pytest

from probewatch.appliance.core.quality.point_error import Bounds, longest
from probewatch.drivers.rigid import Array
from probewatch.tools.study.hazard import Hazard
from probewatch.tools.study.point import PLACES, Coverage, errors_mm, places_mm
from probewatch.tools.study.samples import Conditions
from probewatch.tools.study.session import Session

SESSION = Session("gesture", "rigid", 1, 5.0)


def errors(hazard: str, t_s: float = 1.0) -> Array:
    conditions = Conditions(SESSION, Hazard.parse(hazard))
    return errors_mm(conditions, t_s, places_mm(conditions))


def test_the_places_lie_in_the_picture() -> None:
    at_mm = places_mm(Conditions(SESSION))
    half_mm = np.array(SESSION.size_px) * SESSION.reference.scale_mm_per_px / 2
    assert at_mm.shape == (PLACES, 3)
    assert np.all(np.abs(at_mm[:, :2]) <= half_mm)
    assert np.all(np.abs(at_mm).max(axis=0)[:2] > 0.9 * half_mm)


def test_a_healthy_cart_errs_nowhere() -> None:
    assert errors("none") == pytest.approx(0.0, abs=1e-9)


def test_a_slide_moves_every_place_by_as_much() -> None:
    assert errors("slide-axial=2") == pytest.approx(np.tile([0.0, -2.0, 0.0], (PLACES, 1)), abs=1e-9)


def test_a_bend_moves_a_place_by_its_way_from_the_body() -> None:
    arm_mm = places_mm(Conditions(SESSION)) - SESSION.reference.offset_mm
    wanted = np.deg2rad(1.0) * np.hypot(arm_mm[:, 0], arm_mm[:, 1])
    assert np.linalg.norm(errors("bend-elevational=1"), axis=1) == pytest.approx(wanted, rel=1e-3)


def test_a_scale_moves_a_place_by_its_way_from_the_middle() -> None:
    wanted = 0.02 * places_mm(Conditions(SESSION)) * [1.0, 0.0, 0.0]
    assert errors("scale-lateral=2") == pytest.approx(wanted, abs=1e-9)


def test_a_late_tracker_leaves_a_place_where_the_hand_had_it() -> None:
    conditions = Conditions(SESSION)
    at_mm = places_mm(conditions)
    now, before = SESSION.probe(np.array([1.0, 0.98]))
    way = (at_mm @ (now - before)[:3, :3].T + (now - before)[:3, 3]) @ now[:3, :3]
    assert errors("latency=20") == pytest.approx(way, abs=1e-9)
    assert np.abs(way).max() > 0.1


def test_coverage_is_the_share_of_all_looks() -> None:
    mean, covariance = np.zeros((4, 3)), np.tile(np.eye(3), (4, 1, 1))
    bounds = Bounds(mean, covariance, longest(mean, covariance))
    coverage = Coverage()
    coverage.look(bounds, np.outer([0.1, 3.0, 3.5, 9.0], [1.0, 0.0, 0.0]))
    assert (coverage.narrow, coverage.wide, coverage.narrow_off, coverage.wide_off) == (0.25, 0.75, 0.25, 0.75)
    coverage.look(bounds, np.zeros((4, 3)))
    assert (coverage.looks, coverage.narrow, coverage.wide, coverage.true_mm) == (2, 0.625, 0.875, 4.5)
