"""Converts the checks of a status into changes of the eight calibration parameters."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from probewatch.appliance.core.parameters import PER_UNIT
from probewatch.appliance.types import PARAMETERS, Vector


def stated_change(checks: Iterable[Mapping[str, Any]]) -> tuple[Vector, Vector]:
    """Returns the (8,) changes from the reference and their (8,) sigmas, in the units of PARAMETERS (rad, relative,
    mm); NaN where the checks do not report one.
    """
    told = {check["name"]: check for check in checks}
    parts = [told.get(name, {}) for name in PARAMETERS]
    change, sigma = (
        np.array([np.nan if part.get(key) is None else part[key] for part in parts]) / PER_UNIT[: len(PARAMETERS)]
        for key in ("value", "sigma")
    )
    return change, sigma
