"""The estimate as a matrix is the one that the solver found."""

from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from probewatch.appliance.core.quality.check_fields import check_fields
from probewatch.appliance.storage.image_to_probe import image_to_probe
from probewatch.appliance.types import PARAMETERS, Calibration, Check, Fault, VerdictKind
from probewatch.drivers.rigid import rotation_from_vector
from probewatch.tools.openigtlink.estimate import estimate_of

UNITS = {"rotation": ("deg", np.rad2deg(1.0)), "scale": ("%", 100.0), "offset": ("mm", 1.0)}
CHANGE = np.array([0.02, -0.03, 0.01, 0.04, -0.05, 1.5, -2.5, 0.7])
WATCHED = Calibration(
    rotation_from_vector(np.array([0.3, -1.1, 0.4])), (-1, 1), np.array([0.11, 0.09]), np.array([3.0, -60.0, 9.0]),
    (640, 480),
)  # fmt: skip


def status(change: np.ndarray, *more: Check, **reference: Any) -> dict[str, Any]:
    checks = list(more)
    for name, value in zip(PARAMETERS, change, strict=True):
        kind = name.partition("-")[0]
        unit, factor = UNITS[kind]
        checks.append(Check(name, Fault(kind), value * factor, 0.1, unit, 5.0, VerdictKind.NOT_VERIFIED))
    told = {"image_to_probe": image_to_probe(WATCHED).tolist(), **asdict(WATCHED)} | reference
    return {"reference": told, "checks": [check_fields(0, check) for check in checks]}


def test_it_is_what_the_solver_would_have_made_of_the_reference() -> None:
    found = estimate_of(status(CHANGE))
    assert found is not None
    np.testing.assert_allclose(found.matrix, image_to_probe(WATCHED.changed(CHANGE)), atol=1e-9)
    assert found.measured == PARAMETERS


def test_what_is_not_measured_is_the_reference() -> None:
    known = np.where(np.arange(8) == 4, CHANGE, np.nan)
    found = estimate_of(status(known))
    assert found is not None
    np.testing.assert_allclose(found.matrix, image_to_probe(WATCHED.changed(np.nan_to_num(known))), atol=1e-9)
    assert found.measured == ("scale-axial",)


def test_of_a_mirrored_picture_there_is_none() -> None:
    mirrored = Check("polarity", Fault.POLARITY, 1.0, 0.0, "axes", 0.5, VerdictKind.FAULT)
    assert estimate_of(status(CHANGE, mirrored)) is None


@pytest.mark.parametrize("change", [np.full(8, np.nan)])
def test_where_nothing_is_measured_there_is_none(change: np.ndarray) -> None:
    assert estimate_of(status(change)) is None
