"""What is proposed of a calibration that is wrong: the new values, what follows, and the X that motion recovers."""

from dataclasses import replace
from math import nan

import numpy as np
import pytest

from probewatch.appliance.core.parameters import MEASURED, QUANTITIES, class_of
from probewatch.appliance.core.quality.examination import examine
from probewatch.appliance.core.quality.proposal import LATENCIES_MS, Step, propose
from probewatch.appliance.limits import Limits
from probewatch.appliance.supervision.languages import translated_text
from probewatch.appliance.types import Check, Fault, VerdictKind
from probewatch.drivers.rigid import rotation_from_vector
from probewatch.drivers.trackers.staleness import LATENCY
from tests.support.motions import TRUTH, planar_path, tilting_path
from tests.support.windows import filled

LIMITS = Limits()
FAULT, OK = VerdictKind.FAULT, VerdictKind.OK


def check(name: str, value: float, sigma: float = 0.3, verdict: VerdictKind = FAULT) -> Check:
    fault = class_of(name)
    quantity = QUANTITIES[fault]
    return Check(name, fault, value, sigma, quantity.unit, quantity.limit(LIMITS), verdict)


def test_a_late_tracker_is_told_with_what_its_url_ought_to_state() -> None:
    found = propose([check("latency", 52.0, 6.0), check("scale-axial", 9.0)], TRUTH, 80.0)
    assert found is not None
    assert (found.steps, found.calibration) == ((Step.SET_LATENCY,), None), "what a late tracker says of X is not X"
    assert found.text == (
        "latency is now 132.0 ± 6.0 ms, was 80.0 ms; set latency_ms=132 in the tracker's URL and restart the service"
    )


@pytest.mark.parametrize(("ms", "stated_ms", "mends"), [(-90.0, 0.0, False), (410.0, 90.0, True), (412.0, 90.0, False)])
def test_what_the_url_cannot_state_is_no_remedy(ms: float, stated_ms: float, mends: bool) -> None:
    found = propose([check("latency", ms, 6.0)], TRUTH, stated_ms)
    assert found is not None
    assert found.steps == ((Step.SET_LATENCY,) if mends else ())
    assert found.is_beyond_url != mends
    assert ("latency_ms takes 0 to 500 ms: check" in found.text) != mends
    assert ("set latency_ms=" in found.text) == mends


def test_the_url_takes_what_is_proposed() -> None:
    assert LATENCY.bounds == LATENCIES_MS


@pytest.mark.parametrize("name", [name for name in MEASURED if name != "latency"])
def test_only_scale_and_zeta_demand_a_recalibration(name: str) -> None:
    found = propose([check(name, 9.0)], TRUTH, 0.0)
    assert found is not None
    recalibrate = name in ("scale-lateral", "scale-axial", "offset-elevational")
    assert found.steps == ((Step.RECALIBRATE,) if recalibrate else (Step.TAKE_X,))
    assert (found.calibration is None) == recalibrate
    assert found.about == (name,)
    assert translated_text(found.text, "de") != found.text


def test_the_numbers_are_those_of_the_calibration() -> None:
    scale = propose([check("scale-lateral", 10.0, 0.5)], TRUTH, 0.0)
    offset = propose([check("offset-axial", -8.0, 0.5)], TRUTH, 0.0)
    assert scale is not None
    assert offset is not None
    assert scale.values[0].text == "scale-lateral is now 0.0880 ± 0.0004 mm/px, was 0.0800 mm/px"
    assert offset.values[0].text == "offset-axial is now 54.0 ± 0.5 mm, was 62.0 mm"


@pytest.mark.parametrize(
    "checks",
    [
        [check("rotation-axial", 9.0, verdict=OK)],
        [check("rotation-axial", nan)],
        [check("rotation-axial", 9.0, sigma=0.0)],
        [check("rotation-axial", 9.0), Check("polarity", Fault.POLARITY, 1.0, 0.0, "axes", 0.5, FAULT)],
        [
            check("rotation-axial", 9.0),
            Check("field-distortion", Fault.FIELD_DISTORTION, 15.0, 0.0, "nat", 18.5, VerdictKind.NOT_VERIFIED),
        ],
        [Check("marker-turn", Fault.ROTATION, 9.0, 0.0, "deg", 3.0, FAULT)],
    ],
)
def test_nothing_is_proposed_of_what_motion_has_not_measured(checks: list[Check]) -> None:
    assert propose(checks, TRUTH, 0.0) is None


def test_a_bent_body_is_recovered_from_motion() -> None:
    truth = replace(TRUTH, rotation=rotation_from_vector(np.deg2rad([0.0, 8.0, 0.0])) @ TRUTH.rotation)
    found = propose(examine(filled(tilting_path, 8.0, 2, truth=truth), TRUTH, LIMITS).checks, TRUTH, 0.0)
    assert found is not None
    assert found.calibration is not None
    off = found.calibration.rotation @ truth.rotation.T
    assert np.rad2deg(np.arccos((np.trace(off) - 1) / 2)) < 1.0
    assert np.array_equal(found.calibration.scale_mm_per_px, TRUTH.scale_mm_per_px)


def test_a_late_tracker_is_recovered_from_motion() -> None:
    found = propose(examine(filled(planar_path, 6.0, 4, late_s=0.1), TRUTH, LIMITS).checks, TRUTH, 20.0)
    assert found is not None
    assert found.values[0].now == pytest.approx(120, abs=10)
