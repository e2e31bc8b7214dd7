"""A picture that is mirrored from the start is named within .3 s of lively motion, and nothing else is."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.detectors.polarity import obvious_flip
from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.evidence import Evidence
from probewatch.appliance.core.quality.sequential_test import NAMED_NATS
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration, Fault, VerdictKind
from probewatch.drivers.rigid import Array, rigid, rotation_from_vector
from probewatch.tools.study.hand import ALL
from tests.support.motions import TRUTH, planar_path, tilting_path
from tests.support.windows import FPS, filled

SOLVED_EVERY = 6
"""Pictures: .2 s, as the line does at first."""
Path = Callable[[Array], Array]


def mirrored(*polarity: int) -> Calibration:
    return replace(TRUTH, polarity=polarity)


def hand(name: str, seed: int, breathing_mm: float = 0.0) -> Path:
    """A motion of the study, from a random second on; breathing along the axis, 4 s long."""
    random = np.random.default_rng((seed, 71))
    start_s, phase = random.uniform(0, 30), random.uniform(0, 4)

    def path(t_s: Array) -> Array:
        rows = ALL[name][0](t_s + start_s, np.random.default_rng((seed, 53)))
        rows[1] += breathing_mm * np.cos(np.pi * (t_s + phase) / 4) ** 4
        return rigid(rotation_from_vector(np.deg2rad(rows[3:]).T), rows[:3].T)

    return path


def first_fault(whole: PathWindow) -> tuple[float, Fault] | None:
    """s since the first picture, and what is named."""
    window = PathWindow(TRUTH)
    window.poses = whole.poses
    evidence = Evidence(TRUTH, Limits(), window)
    for index, seen in enumerate(whole._seen):
        window.add(seen)
        if index % SOLVED_EVERY == 0:
            evidence.solve(window.now_ns)
        evidence.check_obvious_flip()
        failed = [check.fault for check in evidence.checks() if check.verdict is VerdictKind.FAULT]
        if failed:
            assert evidence.status.verified_ns is None
            assert evidence.status.contradictions[0].named
            return index / FPS, failed[0]
    return None


@pytest.mark.parametrize("polarity", [(-1, 1), (1, -1), (-1, -1)])
@pytest.mark.parametrize("path", [planar_path, hand("gesture", 1), hand("gesture", 2, 4.0)])
def test_a_flip_from_the_start_is_named_within_three_tenths_of_a_second_of_lively_motion(path, polarity) -> None:
    found = first_fault(filled(path, 1.0, 3, truth=mirrored(*polarity)))
    assert found is not None
    assert found[0] <= 0.31
    assert found[1] is Fault.POLARITY


def test_what_was_named_stays_named_when_solutions_come() -> None:
    whole = filled(planar_path, 2.5, 4, truth=mirrored(-1, 1))
    window = PathWindow(TRUTH)
    window.poses = whole.poses
    evidence, named = Evidence(TRUTH, Limits(), window), list[bool]()
    for index, seen in enumerate(whole._seen):
        window.add(seen)
        if index % SOLVED_EVERY == 0:
            evidence.solve(window.now_ns)
        evidence.check_obvious_flip()
        named.append(any(check.verdict is VerdictKind.FAULT for check in evidence.checks()))
    assert all(named[named.index(True) :])


def sideways(t_s: Array) -> Array:
    """Along one line, which tells no flip of the other axis from the turn that mirrors nothing."""
    place = np.stack([6 * np.sin(3 * t_s), 0 * t_s, 0 * t_s], axis=1)
    return rigid(np.tile(np.eye(3), (len(t_s), 1, 1)), place)


@pytest.mark.parametrize("truth", [TRUTH, mirrored(-1, 1)])
def test_motion_along_one_line_makes_no_flip_evident(truth) -> None:
    assert obvious_flip(filled(sideways, 1.0, 5, truth=truth).samples(0.0), TRUTH, NAMED_NATS) is None


def test_a_mirrored_picture_whose_motion_no_flip_explains_is_not_named_at_a_glance() -> None:
    """The sensor is turned by 60° besides."""
    turned = replace(TRUTH, rotation=rotation_from_vector(np.array([0, 0, np.pi / 3])) @ TRUTH.rotation)
    samples = filled(tilting_path, 0.6, 6, truth=mirrored(-1, 1)).samples(0.0)
    assert obvious_flip(samples, TRUTH, NAMED_NATS) is not None
    assert obvious_flip(samples, turned, NAMED_NATS) is None


@pytest.mark.parametrize("late_s", [0.1, -0.1, 0.3, 0.45])
def test_a_late_tracker_is_no_flip_at_a_glance(late_s) -> None:
    for seed in range(3):
        found = first_fault(filled(hand("gesture", seed), 1.0, seed, late_s=late_s))
        assert found is None or found[1] is Fault.LATENCY


MOTIONS = ("gesture", "in-plane", "fan", "elevational-5", "elevational-20", "elevational-drift", "hold")


@pytest.mark.parametrize("name", [MOTIONS[0], *(pytest.param(one, marks=pytest.mark.thorough) for one in MOTIONS[1:])])
@pytest.mark.parametrize("breathing_mm", [0.0, 5.0])
@pytest.mark.parametrize("noise_mm", [0.1, 0.3])
def test_healthy_motion_is_never_named_in_its_first_second(name, breathing_mm, noise_mm) -> None:
    """By five seeds each: 140 sessions."""
    for seed in range(300, 305):
        path = hand(name, seed, breathing_mm)
        whole = filled(path, 1.2, seed, position_mm=noise_mm, angle_deg=0.2 * noise_mm)
        assert first_fault(whole) is None
