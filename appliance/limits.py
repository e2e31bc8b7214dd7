"""The bounds of the checks. One place; the configuration file overrides them within the stated ranges."""

from pydantic import BaseModel, ConfigDict, Field

TRACKER_STALE_MS = 500.0
"""For which a tracker may repeat one measurement where the configuration (supervisor.tracker_stale_ms) does not say.
More verifies against old poses for longer; less takes the pauses of a slow tracker for a standstill. Not measured.
"""


class Limits(BaseModel):
    """Deviation from the reference calibration at which a check fails, and how sure it must be."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    rotation_deg: float = Field(default=3.0, ge=0.5, le=30, description="angle of each rotation component, deg")
    scale_percent: float = Field(default=5.0, ge=0.5, le=30, description="relative change of either scale, percent")
    offset_mm: float = Field(default=4.0, ge=0.5, le=50, description="shift of the marker body, mm")
    latency_ms: float = Field(default=60.0, ge=5, le=1000, description="tracker later or earlier than the video, ms")
    frozen_ms: float = Field(default=500.0, ge=100, le=10_000, description="identical pictures for this long, ms")
    marker_fit_mm: float = Field(default=0.75, ge=0.1, le=10, description="markers around the pose, RMS, mm")
    marker_shape_mm: float = Field(default=0.75, ge=0.1, le=10, description="markers around their definition, RMS, mm")
    field_indicator: float = Field(default=1.5, ge=0.1, le=10, description="indicator value of an Aurora")
    confidence_sigma: float = Field(
        default=3.0, ge=1, le=6, description="standard deviations between 'seen' and 'shown'"
    )
