"""Which calibration passes for the reference's while a far latency is looked for."""

import numpy as np
import pytest

from probewatch.appliance.core.quality.examination import unchanged
from probewatch.appliance.limits import Limits


def change(rotation_deg: float = 0.0, scale: float = 0.0, offset_mm: float = 0.0) -> np.ndarray:
    """θ with that much of the first turn, the first scale and the first offset."""
    return np.array([np.deg2rad(rotation_deg), 0, 0, scale, 0, offset_mm, 0, 0, 0.3])


@pytest.mark.parametrize(
    ("limits", "rotation_deg", "scale", "same"),
    [
        (Limits(), 1.99, 0.0299, True),
        (Limits(), 2.01, 0.0, False),
        (Limits(), 0.0, 0.031, False),
        (Limits(rotation_deg=10.0, scale_percent=20.0), 2.01, 0.0, False),
        (Limits(profile="clinical"), 1.0, 0.02, True),
        (Limits(profile="clinical"), 1.6, 0.0, False),
        (Limits(profile="clinical"), 0.0, 0.025, False),
        (Limits(profile="fine"), 0.6, 0.013, True),
        (Limits(profile="fine"), 0.9, 0.0, False),
    ],
)
def test_a_latency_excuses_no_calibration_that_the_limits_call_wrong(
    limits: Limits, rotation_deg: float, scale: float, same: bool
) -> None:
    assert unchanged(change(rotation_deg, scale, offset_mm=9.0), limits) is same
