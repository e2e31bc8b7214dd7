"""Combines the estimates in the alarm log to what all verified motion has measured of a reference, as a table and as a
calibration.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import hypot
from typing import Any

import numpy as np

from probewatch.appliance.core.parameters import MEASURED, PER_UNIT, QUANTITIES, class_of
from probewatch.appliance.core.quality.accumulation import Accumulated, accumulated
from probewatch.appliance.storage.alarm_chain import Entry
from probewatch.appliance.types import PARAMETERS, Calibration
from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.german.translation import recognised, told
from probewatch.tools.shared.tables import NOTHING
from probewatch.tools.shared.trend_table import estimates_of

HEADINGS = ("parameter", "by motion", "calibrated to", "apart", "estimates", "examinations")


def measured(entries: Sequence[Entry], reference: int) -> dict[str, Accumulated]:
    """Returns what motion measured of each parameter of that reference, as a change from it, by name. The entries do
    not state whether the tissue was rigid, so the left-out standard deviation is that for tissue of any kind.
    """
    known = estimates_of(entries, reference)
    found = {name: accumulated(known[name], QUANTITIES[class_of(name)].left_out) for name in MEASURED if name in known}
    return {name: one for name, one in found.items() if one is not None}


def stated_sigma(name: str, reference: Calibration) -> float | None:
    """Returns the sigma that the calibration itself states for a parameter, in the unit of its checks; None where it
    states none.
    """
    if name not in PARAMETERS or reference.covariance is None:
        return None
    index = PARAMETERS.index(name)
    return float(np.sqrt(reference.covariance[index, index]) * PER_UNIT[index])


def apart(one: Accumulated, stated: float | None) -> float:
    """Returns by how many of their combined standard deviations motion and calibration differ."""
    return abs(one.value) / hypot(one.sigma, stated or 0.0)


def row_of(name: str, one: Accumulated, reference: Calibration, language: str) -> tuple[str, ...]:
    """Returns the cells under HEADINGS."""
    unit, stated = recognised(QUANTITIES[class_of(name)].unit, language), stated_sigma(name, reference)
    return (
        recognised(name, language),
        f"{one.value:+.2f} ± {one.sigma:.2f} {unit}",
        NOTHING if stated is None else f"± {stated:.2f} {unit}",
        told("{sigmas} sigmas", language, sigmas=f"{apart(one, stated):.1f}"),
        str(one.estimates),
        str(one.examinations),
    )


def fields_of(name: str, one: Accumulated, reference: Calibration) -> dict[str, Any]:
    """Returns the fields of one parameter for JSON."""
    stated = stated_sigma(name, reference)
    return {
        "name": name,
        "unit": QUANTITIES[class_of(name)].unit,
        "value": one.value,
        "sigma": one.sigma,
        "calibrated_sigma": stated,
        "apart_sigmas": apart(one, stated),
        "between": one.between,
        "estimates": one.estimates,
        "examinations": one.examinations,
    }


def in_vivo(found: Mapping[str, Accumulated], reference: Calibration) -> Calibration:
    """Returns the reference changed as motion measured, with the standard deviations of that measurement.

    Raises ConfigurationError where motion has not measured all eight parameters.
    """
    missing = [name for name in PARAMETERS if name not in found]
    if missing:
        what = f"holds no estimate of {', '.join(missing)}, so motion has measured no whole calibration"
        raise ConfigurationError(what, "the alarm log", "Scan on: the service notes one in five minutes while verified")
    units = PER_UNIT[: len(PARAMETERS)]
    change = np.array([found[name].value for name in PARAMETERS]) / units
    sigmas = np.array([found[name].sigma for name in PARAMETERS]) / units
    return replace(reference.changed(change), covariance=np.diag(sigmas**2))
