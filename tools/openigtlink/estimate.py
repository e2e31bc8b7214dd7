"""The calibration as motion shows it now: the reference in force, changed by what the checks measure. Pure."""

from typing import Any, NamedTuple

import numpy as np

from appliance.core.path.solver import changed
from appliance.storage.calibration_file import calibration_from_image_to_probe, image_to_probe
from appliance.types import PARAMETERS, VerdictKind
from drivers.samples import Matrix4

_IN_UNITS = {"deg": float(np.deg2rad(1.0)), "%": 0.01, "mm": 1.0}
"""Unit of a check → what its value is multiplied by to change a calibration, by definition."""


class Estimate(NamedTuple):
    """matrix: (4, 4) ImageToProbe, px → mm. measured: names of the parameters that are; the rest is the reference's."""

    matrix: Matrix4
    measured: tuple[str, ...]


def estimate_of(status: dict[str, Any]) -> Estimate | None:
    """None while there is no reference, while nothing is measured, and while the picture is mirrored against the
    reference: what is measured then is no change of it.
    """
    reference = status["reference"]
    checks = {check["name"]: check for check in status["checks"]}
    if reference is None or "polarity" not in reference or _mirrored(checks):
        return None
    measured = tuple(name for name in PARAMETERS if name in checks and checks[name]["value"] is not None)
    if not measured:
        return None
    change = np.zeros(len(PARAMETERS))
    for name in measured:
        change[PARAMETERS.index(name)] = checks[name]["value"] * _IN_UNITS[checks[name]["unit"]]
    (width, height), (lateral, axial) = reference["image_size_px"], reference["polarity"]
    matrix = np.array(reference["image_to_probe"])
    watched = calibration_from_image_to_probe(matrix, (width, height), (lateral, axial), "status")
    return Estimate(image_to_probe(changed(watched, change)), measured)


def _mirrored(checks: dict[str, dict[str, Any]]) -> bool:
    return "polarity" in checks and checks["polarity"]["verdict"] == VerdictKind.FAULT.value
