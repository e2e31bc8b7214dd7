"""How well the tracker measures, by the figures that it reports; NOT_VERIFIED for one that it does not report."""

from math import nan

from probewatch.appliance.limits import Limits
from probewatch.appliance.supervision.watchers.device_health import DeviceHealth
from probewatch.appliance.types import Check, Fault, VerdictKind

REPORTS_FAULTS = (Fault.MARKER_BODY, Fault.FIELD_DISTORTION)


def marker_fit(health: DeviceHealth, limits: Limits) -> Check:
    """marker-body when the markers fit the pose that they are said to have worse than limits.marker_fit_mm.

    Dirt, a reflection, a bent body, the wrong definition. An electromagnetic tracker has no such figure.
    """
    value_mm = None if health.body is None else health.body.fit_mm
    return _quality("marker fit", Fault.MARKER_BODY, value_mm, "mm", limits.marker_fit_mm)


def marker_geometry(health: DeviceHealth, limits: Limits) -> Check:
    """marker-body when the markers differ from the tool's definition by more than limits.marker_shape_mm.

    One is loose, or the body is bent.
    """
    value_mm = None if health.body is None else health.body.shape_mm
    return _quality("marker geometry", Fault.MARKER_BODY, value_mm, "mm", limits.marker_shape_mm)


def field_indicator(health: DeviceHealth, limits: Limits) -> Check:
    """field-distortion when the indicator value of an electromagnetic tracker exceeds limits.field_indicator.

    Metal near it bends its poses slowly; this value is the only sign.
    """
    value = None if health.body is None else health.body.indicator
    return _quality("field indicator", Fault.FIELD_DISTORTION, value, "", limits.field_indicator)


def _quality(name: str, fault: Fault, value: float | None, unit: str, limit: float) -> Check:
    if value is None:
        return Check(name, fault, nan, nan, unit, limit, VerdictKind.NOT_VERIFIED)
    return Check(name, fault, value, 0.0, unit, limit, VerdictKind.FAULT if value > limit else VerdictKind.OK)
