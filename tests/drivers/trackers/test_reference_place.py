"""Where the reference tool rests: a blow is told with its size, a breathing or noisy reference is not."""

import re

import numpy as np
import pytest

from probewatch.drivers.rigid import angle_from_rotation, rigid, rotation_from_vector
from probewatch.drivers.samples import Matrix4
from probewatch.drivers.trackers.reference_place import ReferencePlace

HZ, S_NS = 60, 1_000_000_000
REST = rigid(rotation_from_vector(np.array([0.1, 0.4, -0.2])), np.array([150.0, -40.0, -1700.0]))
BLOW = rigid(rotation_from_vector(np.deg2rad([1.0, 4.0, -1.0])), np.array([5.0, 0.0, -3.0]))


def heard(place: ReferencePlace, pose: Matrix4, from_s: float, seconds: float, sway_mm: float = 0.0) -> float:
    """Readings of a tracker with its noise, of a tool that sways once in four seconds; when the last one came."""
    random = np.random.default_rng(round(from_s))
    for index in range(round(seconds * HZ)):
        t_s = from_s + index / HZ
        shake = rigid(rotation_from_vector(random.normal(0, 1e-3, 3)), random.normal(0, 0.1, 3))
        seen = pose @ shake
        seen[2, 3] += sway_mm * np.sin(np.pi * t_s / 2)
        place.take(round(t_s * S_NS), seen)
    return from_s + seconds


def test_a_blow_is_told_once_the_tool_rests_again_and_for_ten_minutes() -> None:
    place = ReferencePlace()
    now_s = heard(place, REST, 0.0, 4.0)
    assert place.remarks(round(now_s * S_NS)) == ()
    now_s = heard(place, BLOW @ REST, now_s, 4.0)
    (said,) = place.remarks(round(now_s * S_NS))
    moved_mm = float(np.linalg.norm((BLOW @ REST - REST)[:3, 3]))
    told_mm, told_deg = map(float, re.findall(r"[\d.]+(?= mm|°)", said))
    assert told_mm == pytest.approx(moved_mm, abs=1.0)
    assert told_deg == pytest.approx(np.degrees(angle_from_rotation(BLOW[:3, :3])), abs=0.3)
    assert "unless rotation or offset is named" in said
    assert place.remarks(round((now_s + 601) * S_NS)) == ()


@pytest.mark.parametrize("sway_mm", [0.0, 2.0, 15.0])
def test_noise_and_breath_are_no_blow(sway_mm: float) -> None:
    place = ReferencePlace()
    now_s = heard(place, REST, 0.0, 60.0, sway_mm)
    assert place.remarks(round(now_s * S_NS)) == ()
