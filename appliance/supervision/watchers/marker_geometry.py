"""Markers that have left their places on the body: one is loose, or the body is bent."""

from appliance.limits import Limits
from appliance.supervision.watchers.facts import Facts, quality
from appliance.types import Check, Fault


def marker_geometry(facts: Facts, limits: Limits) -> Check:
    """marker-body when the markers differ from the tool's definition by more than limits.marker_shape_mm."""
    value_mm = None if facts.body is None else facts.body.shape_mm
    return quality("marker geometry", Fault.MARKER_BODY, value_mm, "mm", limits.marker_shape_mm)
