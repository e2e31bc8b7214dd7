"""Markers that do not fit the pose they are said to have: dirt, a reflection, a bent body, the wrong definition."""

from appliance.limits import Limits
from appliance.supervision.watchers.facts import Facts, quality
from appliance.types import Check, Fault


def marker_fit(facts: Facts, limits: Limits) -> Check:
    """marker-body when the tracker's own fit is worse than limits.marker_fit_mm; an electromagnetic one has none."""
    value_mm = None if facts.body is None else facts.body.fit_mm
    return quality("marker fit", Fault.MARKER_BODY, value_mm, "mm", limits.marker_fit_mm)
