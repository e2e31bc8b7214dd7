"""What is said of a scan beside another calibration: which parameters disagree, and nothing where none does."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from appliance.types import Calibration
from drivers.rigid import rotation_from_vector
from tools.shared.crosswire_review import disagreements

SIGMA = np.array([np.deg2rad(0.05)] * 3 + [0.001] * 2 + [0.1] * 3)
FOUND = Calibration(
    rotation_from_vector(np.array([0.6, -0.4, 0.9])),
    (1, 1),
    np.array([0.08, 0.07]),
    np.array([11.0, 62.0, 14.0]),
    (640, 480),
    covariance=np.diag(SIGMA**2),
)


def told(other: Calibration) -> list[str]:
    whole: Any = SimpleNamespace(calibration=FOUND)
    return disagreements(whole, {"in force": other})


def test_a_parameter_that_is_further_off_than_the_sigmas_allow_is_named() -> None:
    turned = rotation_from_vector(np.array([0.0, np.deg2rad(0.2), 0.0])) @ FOUND.rotation
    off = replace(FOUND, rotation=turned, offset_mm=FOUND.offset_mm + np.array([0.2, 0.0, 0.4]), covariance=None)
    (said,) = told(off)
    assert "this scan and 'in force' disagree: rotation-axial by +0.20 ° (+4.0σ), " in said
    assert "offset-elevational by +0.40 mm (+4.0σ). Which of the two is wrong" in said
    assert "offset-lateral" not in said, "two sigmas are no disagreement"


def test_calibrations_that_agree_are_not_accused() -> None:
    assert told(replace(FOUND, offset_mm=FOUND.offset_mm + 0.25, covariance=None)) == []
    far = replace(FOUND, offset_mm=FOUND.offset_mm + 0.4)
    assert told(far) == [], "the sigmas of both count"
