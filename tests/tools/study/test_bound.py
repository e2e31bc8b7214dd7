"""Bounds: where a closed form exists they are that, and they fall as theory says."""

import numpy as np
import pytest

from probewatch.tools.study import bound
from probewatch.tools.study.bound import LN_A, bounds, least_delay_s
from probewatch.tools.study.session import Session


def known(name, noise_mm=0.1, span_s=10.0, tissue="still"):
    return bounds(Session(name, tissue, 1, 60.0), noise_mm, 0.2 * noise_mm, span_s)


def test_scale_of_a_plain_translation_is_noise_over_spread(monkeypatch):
    """λ̂ of x = (1 + ε) s with white noise σ on each x and an unknown origin: σ ÷ √Σ(s − s̄)², once nothing else is free
    and nothing walks.
    """
    monkeypatch.setattr(bound, "_CHAIN_WALK_MM", 1e-6)
    monkeypatch.setattr(bound, "_WALK_MM2_PER_MM", 0.0)
    t_s = np.arange(0.0, 10.0, 1 / 30)
    one = Session("in-plane", "still", 1, 60.0)
    way_mm = bound.picture_path(one.pictures(t_s))[0]
    reach = np.linalg.norm(one.reference.offset_mm)
    noise_mm = np.hypot(0.1, reach * np.deg2rad(1e-6))
    steps = [
        bound._steps(one, t_s, *bound.picture_path(one.pictures(t_s)), np.eye(9)[3] * side) for side in (1e-4, -1e-4)
    ]
    J = (steps[0] - steps[1]) / 2e-4
    row = bound._whitened(J[None, 0], noise_mm**2, np.full(t_s.size - 1, 1e-12))
    lateral = np.cumsum(np.concatenate([[0.0], J[0]]))
    assert 1 / np.linalg.norm(row) == pytest.approx(noise_mm / np.linalg.norm(lateral - lateral.mean()), rel=1e-3)
    assert np.std(lateral) == pytest.approx(np.std(way_mm.real), rel=0.2)


def test_more_motion_shows_more_and_more_noise_less():
    for name in ("in-plane", "elevational-10", "fan"):
        assert np.all(known(name, span_s=20.0) <= known(name) * 1.0001)
        assert np.all(known(name, 0.25) > known(name))


def test_what_each_session_shows_best():
    """In-plane sweeps the scales, elevational ones the tilts (docs/method.md, section 2)."""
    sweep, elevational = known("in-plane"), known("elevational-10")
    assert np.all(sweep[3:5] < elevational[3:5] / 2)
    assert np.all(elevational[:2] < sweep[:2])


def test_breathing_that_is_known_changes_no_bound():
    assert np.array_equal(known("hold"), known("hold", tissue="breathing"))


def test_the_least_delay_is_where_one_parameter_is_known_well_enough():
    """Of one parameter alone: (change ÷ its sigma)² ÷ 2 = ln A, and twice the change is seen sooner."""
    one, change = Session("in-plane", "still", 1, 60.0), np.eye(9)[3] * 0.1
    assert pytest.approx(18.5, abs=0.1) == LN_A
    once, twice = (least_delay_s(one, factor * change, 0.1, 0.02) for factor in (1, 2))
    assert 0.3 < once < 1.5, "at 3 mm/s theory has .6 to 1.0 s"
    assert twice < once < least_delay_s(one, change, 0.5, 0.1)
    assert least_delay_s(one, 1e-6 * change, 0.1, 0.02) == np.inf
    assert least_delay_s(one, change, 0.1, 0.02, from_s=59.99) == np.inf
