"""The closed forms beside the service's answer: right where that is right, and where its reference is far off."""

from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.handeye.second_opinion import SecondOpinion, second_opinion
from probewatch.appliance.core.quality.report import report_json
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import rotation_from_vector, vector_from_rotation
from tests.support.motions import TRUTH, planar_path, tilting_path
from tests.support.windows import elevational_path, filled
from tests.tools.shared.test_json_report import line_report


def asked(path, reference: Calibration = TRUTH, seconds: float = 10.0, seed: int = 1, **world) -> SecondOpinion | None:  # type: ignore[no-untyped-def]
    return second_opinion(filled(path, seconds, seed, reference=reference, **world).samples(0.0), reference)


def turn_deg(found: SecondOpinion) -> float:
    return float(np.degrees(np.linalg.norm(vector_from_rotation(found.rotation @ TRUTH.rotation.T))))


@pytest.mark.parametrize(("path", "form"), [(planar_path, "planar"), (tilting_path, "freehand")])
def test_it_agrees_with_the_truth_within_its_sigma(path, form: str) -> None:  # type: ignore[no-untyped-def]
    found = [asked(path, seed=seed) for seed in range(8)]
    assert {f.form for f in found} == {form}
    away = np.array([f.scale_mm_per_px / TRUTH.scale_mm_per_px - 1 for f in found])
    assert np.abs(away).max() < 0.01
    assert np.mean(np.abs(away) < 2 * np.array([f.sigma[3:] for f in found])) > 0.75
    assert max(turn_deg(f) for f in found) < 1.5


def test_a_reference_far_from_the_truth_does_not_mislead_it() -> None:
    """40° and 30 % off, as with another probe's file; the lever arm it borrows is then wrong as well."""
    far = replace(
        TRUTH,
        rotation=rotation_from_vector(np.array([0.3, 0.3, 0.5])) @ TRUTH.rotation,
        scale_mm_per_px=TRUTH.scale_mm_per_px * 1.3,
        offset_mm=rotation_from_vector(np.array([0.3, 0.3, 0.5])) @ TRUTH.offset_mm,
    )
    found = asked(planar_path, far)
    np.testing.assert_allclose(found.scale_mm_per_px, TRUTH.scale_mm_per_px, rtol=0.02)
    assert turn_deg(found) < 2


def test_a_mirrored_picture_is_told_as_polarity() -> None:
    found = asked(tilting_path, truth=replace(TRUTH, polarity=(-1, 1)))
    assert found.polarity == (-1, 1)
    assert turn_deg(found) < 1.5


@pytest.mark.parametrize(
    ("path", "seconds"),
    [(elevational_path, 10.0), (lambda t: planar_path(0 * t), 10.0), (planar_path, 3.0), (planar_path, 0.2)],
)
def test_it_is_silent_where_the_motion_does_not_tell(path, seconds: float) -> None:  # type: ignore[no-untyped-def]
    found = asked(path, seconds=seconds)
    assert found is None or found.sigma[3:].max() > 0.2


def test_the_report_carries_it() -> None:
    data = report_json(line_report(second_opinion=asked(tilting_path)), [])["second_opinion"]
    assert data["form"] == "freehand"
    assert data["pairs"] > 200
    np.testing.assert_allclose(data["scale_mm_per_px"], TRUTH.scale_mm_per_px, rtol=0.01)
    assert all(0 < s < 0.01 for s in data["sigma"]["scale_mm_per_px"])
