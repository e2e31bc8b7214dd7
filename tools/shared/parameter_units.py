"""The units in which people and checks read the eight parameters of a calibration, and what checks say in theirs."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from appliance.types import PARAMETERS, Vector

PER_UNIT = np.array([*(np.degrees(1.0),) * 3, *(100.0,) * 2, *(1.0,) * 3])
"""deg, %, mm: how many of them are one rad, one relative, one mm, in the order of PARAMETERS."""


def told_change(checks: Iterable[Mapping[str, Any]]) -> tuple[Vector, Vector]:
    """(8,) change from the reference and (8,) its sigma, in the units of PARAMETERS (rad, relative, mm), as the checks
    of a status tell them; NaN where they do not.
    """
    told = {check["name"]: check for check in checks}
    parts = [told.get(name, {}) for name in PARAMETERS]
    change, sigma = (
        np.array([np.nan if part.get(key) is None else part[key] for part in parts]) / PER_UNIT
        for key in ("value", "sigma")
    )
    return change, sigma
