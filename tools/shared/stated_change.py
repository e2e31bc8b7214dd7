"""What the checks of a status say of the eight parameters of a calibration, in the units of those."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from appliance.core.parameters import PER_UNIT
from appliance.types import PARAMETERS, Vector


def stated_change(checks: Iterable[Mapping[str, Any]]) -> tuple[Vector, Vector]:
    """(8,) change from the reference and (8,) its sigma, in the units of PARAMETERS (rad, relative, mm), as the checks
    of a status tell them; NaN where they do not.
    """
    told = {check["name"]: check for check in checks}
    parts = [told.get(name, {}) for name in PARAMETERS]
    change, sigma = (
        np.array([np.nan if part.get(key) is None else part[key] for part in parts]) / PER_UNIT[: len(PARAMETERS)]
        for key in ("value", "sigma")
    )
    return change, sigma
