"""Turns the calibration that a service proposes in its status into a calibration object."""

from dataclasses import replace
from typing import Any

import numpy as np

from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.appliance.types import Calibration
from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.german.translation import recognised, told


def recovered(status: dict[str, Any]) -> Calibration:
    """Returns the reference in force with rotation and in-plane offset as motion measured them; marked simulated where
    the reference or a source is. Raises ConfigurationError where the service proposes none.
    """
    proposal, reference = status.get("proposal"), status["reference"]
    language = str(status.get("language", "en"))
    service = told("the service", language)
    if proposal is None or reference is None:
        what = "proposes nothing: no parameter is shown to be wrong"
        raise ConfigurationError(what, service, "Move the probe over tissue until the fault is shown by motion")
    if proposal["image_to_probe"] is None:
        what = told("proposes no calibration", language)  # its text is in that language already
        raise ConfigurationError(what, service, proposal["text"])
    (width, height), (lateral, axial) = reference["image_size_px"], reference["polarity"]
    matrix = np.array(proposal["image_to_probe"], np.float64)
    found = calibration_from_image_to_probe(matrix, (width, height), (lateral, axial), "status")
    return replace(found, simulated=bool(reference["simulated"] or status["simulated"]))


def changes_text(status: dict[str, Any], language: str = "en") -> str:
    """Returns what the service proposes to change, with sigmas, in words."""
    return "; ".join(
        f"{recognised(one['name'], language)} {one['was']:.4g} → {one['now']:.4g} ± {one['sigma']:.2g} "
        f"{recognised(one['unit'], language)}"
        for one in status["proposal"]["values"]
    )
