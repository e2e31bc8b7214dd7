"""What is said of a scan beside another calibration: which parameters disagree, and nothing where none does."""

import io
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import click
import numpy as np
import pytest
from rich.console import Console

from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import rotation_from_vector
from probewatch.tools.shared.crosswire_review import disagreements, view_table
from probewatch.tools.shared.crosswire_whole import WholeOptions, _solved
from tests.support.answers import answered
from tests.support.crossings import SIZE_PX, guided_views

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


def test_views_are_numbered_from_1_and_struck_by_that_number() -> None:
    state: Any = SimpleNamespace(views=2, cloud_mm=np.array([[0.1, 0, 0], [3.0, 0, 0]]), struck={1}, rejected=set())
    out = io.StringIO()
    Console(file=out, width=120).print(view_table(state, np.array([[10.0, 20.0], [30.0, 40.0]]), True))
    numbered = [line.split()[0] for line in out.getvalue().splitlines()[1:]]
    assert numbered == ["1", "2"]
    assert "struck out" in out.getvalue().splitlines()[2]
    views = guided_views(1, 12)
    scan: Any = SimpleNamespace(views=views, misses_mm=())
    told: Any = SimpleNamespace(size_px=SIZE_PX)
    struck, _ = _solved(scan, told, None, WholeOptions(strike=(1, 12)), 0.5)
    assert sorted(struck.struck) == [0, 11]
    with pytest.raises(click.UsageError, match="--strike 13: the scan has views 1 to 12"):
        _solved(scan, told, None, WholeOptions(strike=(13,)), 0.5)
    assert answered("recalibrate", "--simulated", "--solve", "all", "--strike", 0).returncode == 2
