"""Metal near an electromagnetic tracker bends its poses slowly; the indicator value is the only sign of it."""

from appliance.limits import Limits
from appliance.supervision.watchers.facts import Facts, quality
from appliance.types import Check, Fault


def field_indicator(facts: Facts, limits: Limits) -> Check:
    """field-distortion when the indicator value of an electromagnetic tracker exceeds limits.field_indicator."""
    value = None if facts.body is None else facts.body.indicator
    return quality("field indicator", Fault.FIELD_DISTORTION, value, "", limits.field_indicator)
