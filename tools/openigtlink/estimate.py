"""Computes the calibration as motion shows it now: the reference in force, changed by what the checks measure. Pure."""

from typing import Any, NamedTuple

import numpy as np

from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe, image_to_probe
from probewatch.appliance.types import PARAMETERS, VerdictKind
from probewatch.drivers.samples import Matrix4
from probewatch.tools.shared.stated_change import stated_change


class Estimate(NamedTuple):
    """Holds the estimate. matrix: (4, 4) ImageToProbe, px → mm. measured: names of the parameters that are measured;
    the others are those of the reference.
    """

    matrix: Matrix4
    measured: tuple[str, ...]


def estimate_of(status: dict[str, Any]) -> Estimate | None:
    """Returns the estimate of the calibration; None while there is no reference, while nothing is measured, and while
    the picture is mirrored against the reference, because the estimate is then not a change of the reference.
    """
    reference = status["reference"]
    checks = {check["name"]: check for check in status["checks"]}
    if reference is None or "polarity" not in reference or _mirrored(checks):
        return None
    change, _ = stated_change(status["checks"])
    known = np.isfinite(change)
    if not known.any():
        return None
    measured = tuple(name for name, told in zip(PARAMETERS, known, strict=True) if told)
    (width, height), (lateral, axial) = reference["image_size_px"], reference["polarity"]
    matrix = np.array(reference["image_to_probe"])
    watched = calibration_from_image_to_probe(matrix, (width, height), (lateral, axial), "status")
    return Estimate(image_to_probe(watched.changed(np.where(known, change, 0.0))), measured)


def _mirrored(checks: dict[str, dict[str, Any]]) -> bool:
    return "polarity" in checks and checks["polarity"]["verdict"] == VerdictKind.FAULT.value
