"""Defines the bounds of the checks, in one place; the configuration file overrides them within the stated ranges."""

from collections.abc import Mapping
from math import log
from types import MappingProxyType
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.suggestion import did_you_mean, suggested

TRACKER_STALE_MS = 500.0
"""Time, ms, for which a tracker may repeat one measurement where the configuration (supervisor.tracker_stale_ms) sets
none. More verifies against old poses for longer; less takes the pauses of a slow tracker for a standstill. Not
measured.
"""
FALSE_ALARM_H = 1000.0
"""Mean time, h, between two false FAULTs of the sequential test that is promised: a cart's year of scanning or so.
Twice as much names everything .7 nats later. docs/evidence.md has the hours of healthy scanning that were run.
"""
NAMED_NATS = log(FALSE_ALARM_H * 3600 * 30)
"""Log likelihood ratio of a FAULT, 18.5. By Ville's inequality a true likelihood ratio passes it once in that many
pictures; the sup over sizes costs a few nats of that, and looking only at each tenth picture gives two back.
"""
WITHDRAWN_NATS = 10.0
"""Log likelihood ratio of a contradiction, which withdraws the OK and names nothing: it is passed once in hours of
motion at the limit itself. Less opens the contact for nothing, more keeps it closed for longer over what will be named.
"""
MOST_NAMED_NATS = 2 * NAMED_NATS
"""Largest log likelihood ratio of a FAULT to which healthy scanning may raise it, 37.0. From there a change takes twice
as long to be named, and scanning that comes near it is not what the model of the noise describes, so that no threshold
keeps a promise.
"""


def check_name(field: str) -> str:
    """Returns the name of a check, which has hyphens, as in the JSON reports; so has its key in the
    configuration file.
    """
    return field.replace("_", "-")


class _Told(type(BaseModel)):  # type: ignore[misc]
    """Raises ConfigurationError, with what is wrong, where a program passes wrong limits of its own. The mistakes of a
    file, which pydantic reads without a call, are reported by the file's reader, with their lines.
    """

    def __call__(cls, *args: Any, **given: Any) -> Any:
        try:
            return super().__call__(*args, **given)
        except ValidationError as error:
            known = [field.alias or name for name, field in cls.model_fields.items()]
            what = "; ".join(_mistake(item, known) for item in error.errors(include_url=False))
            raise ConfigurationError(
                what, cls.__name__, "[limits] in config/probewatch.toml has each with its bounds"
            ) from None


def _mistake(item: ErrorDetails, known: list[str]) -> str:
    name = " ".join(map(str, item["loc"]))
    if item["type"] == "extra_forbidden":
        names = known if len(item["loc"]) == 1 else [check_name(one) for one in RequiredAges.model_fields]
        meant = did_you_mean(suggested(str(item["loc"][-1]), names))
        return f"{name} is not known. {meant or 'Known are ' + ', '.join(names)}"
    return f"{name} = {item['input']!r}: {item['msg'][0].lower()}{item['msg'][1:]}" if name else item["msg"]


SWEPT_AGE_S = 30.0
"""Time, s, for which what ordinary sweeps show counts: as long as the longest window that measures, so that a sweep
keeps the contact closed (docs/coverage.md). Less opens it in quiet scanning, more trusts what motion showed once for
longer.
"""
MAX_VERIFICATION_AGE_S = 120.0
"""Longest time, s, for which a verification lasts, whatever else allows. More trusts what motion showed for longer,
less asks for motion amid a puncture.
"""
GESTURE_AGE_S = MAX_VERIFICATION_AGE_S
"""Time, s, for which the offsets count, which only rocking and twisting show: a gesture, then two minutes of scanning
(docs/gesture.md has what other ages give). Less asks for the gesture more often; more leaves a marker body that slid,
slower than the slip watch finds, unreported for longer.
"""
AT_REST_S = MAX_VERIFICATION_AGE_S - SWEPT_AGE_S
"""Time, s, by which both count longer while the probe is held still: what sweeps show then reaches the longest age.
Less asks for motion amid a puncture; more does nothing unless that age is raised as well, and then trusts what a rest
can see (appliance.core.quality.stationary_time) for longer.
"""


class RequiredAges(BaseModel, metaclass=_Told):
    """Holds how old, s, the motion may be that showed each parameter, never older than max_verification_age_s; None: as
    old as that; 0: the contact does not require the parameter.

    All ten are required by default: each can be spoiled by a wrong or bent marker body, a depth setting or a cable. A
    contradiction of a parameter that is not required opens the contact all the same. A longer age closes the contact
    for longer on what motion showed once; a shorter one asks for that motion more often.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False, alias_generator=check_name)

    polarity: float | None = Field(default=SWEPT_AGE_S, ge=0, le=600)
    scale_lateral: float | None = Field(default=SWEPT_AGE_S, ge=0, le=600)
    scale_axial: float | None = Field(default=SWEPT_AGE_S, ge=0, le=600)
    rotation_lateral: float | None = Field(default=SWEPT_AGE_S, ge=0, le=600)
    rotation_axial: float | None = Field(default=SWEPT_AGE_S, ge=0, le=600)
    rotation_elevational: float | None = Field(default=SWEPT_AGE_S, ge=0, le=600)
    offset_lateral: float | None = Field(default=GESTURE_AGE_S, ge=0, le=600)
    offset_axial: float | None = Field(default=GESTURE_AGE_S, ge=0, le=600)
    offset_elevational: float | None = Field(default=GESTURE_AGE_S, ge=0, le=600)
    latency: float | None = Field(default=SWEPT_AGE_S, ge=0, le=600)

    @model_validator(mode="after")
    def _asks_for_something(self) -> Self:
        if self.polarity == 0 or self.latency == 0:
            raise PydanticCustomError("refused", "without polarity and latency no other parameter means anything")
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Returns the parameters that the contact requires."""
        return tuple(self.ages_s)

    @property
    def ages_s(self) -> dict[str, float | None]:
        """Returns the age of each parameter that is required, by the name of its check."""
        return {check_name(name): age_s for name, age_s in self if age_s != 0}


class Region(BaseModel, metaclass=_Told):
    """Holds the part of the picture in which the error of a point counts, as shares of its width and height from the
    upper left corner. By default it is all of the picture, which holds every sector.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    left: float = Field(default=0.0, ge=0, le=1)
    right: float = Field(default=1.0, ge=0, le=1)
    top: float = Field(default=0.0, ge=0, le=1)
    bottom: float = Field(default=1.0, ge=0, le=1)

    @model_validator(mode="after")
    def _holds_something(self) -> Self:
        if self.left >= self.right or self.top >= self.bottom:
            raise PydanticCustomError("refused", "region is empty: left must be less than right, top less than bottom")
        return self


Profile = Literal["coarse", "clinical", "fine"]
PROFILES: Mapping[Profile, Mapping[str, float]] = MappingProxyType(
    {
        "coarse": MappingProxyType({}),
        "clinical": MappingProxyType(
            {"rotation_deg": 1.5, "scale_percent": 3.0, "offset_mm": 2.5, "latency_ms": 30.0, "point_mm": 4.0}
        ),
        "fine": MappingProxyType(
            {"rotation_deg": 1.0, "scale_percent": 2.0, "offset_mm": 1.5, "latency_ms": 20.0, "point_mm": 2.5}
        ),
    }
)
"""Limits of each profile, deg, %, mm, ms, mm, by the fields of Limits; coarse has their defaults. Tighter ones allow
less error in the picture, and keep the contact open for longer: docs/profiles.md has what each costs, measured on
simulated carts. The figures were asked for by those who navigate, not derived.
"""
_MEANING = ("rotation_deg", "scale_percent", "offset_mm", "latency_ms", "point_mm", "confidence_sigma", "at_rest_s")
"""Numbers that determine what an OK of a profile means; `region` and `required_age_s` do so as well."""


class Limits(BaseModel, metaclass=_Told):
    """Holds the deviations from the reference calibration at which checks fail, and how certain those must be.

    profile: the one whose values apply to limits that are not given. A limit that is given counts instead of the
    profile's, also where it is looser; see `beside_profile`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    profile: Profile = "coarse"
    rotation_deg: float = Field(default=3.0, ge=0.5, le=30, description="angle of each rotation component, deg")
    scale_percent: float = Field(default=5.0, ge=0.5, le=30, description="relative change of either scale, percent")
    offset_mm: float = Field(default=4.0, ge=0.5, le=50, description="shift of the marker body, mm")
    latency_ms: float = Field(default=60.0, ge=5, le=1000, description="tracker later or earlier than the video, ms")
    frozen_ms: float = Field(default=500.0, ge=100, le=10_000, description="identical pictures for this long, ms")
    marker_fit_mm: float = Field(default=0.75, ge=0.1, le=10, description="markers around the pose, RMS, mm")
    marker_shape_mm: float = Field(default=0.75, ge=0.1, le=10, description="markers around their definition, RMS, mm")
    witness_mm: float = Field(default=1.0, ge=0.2, le=20, description="slide between two marker bodies, mm")
    witness_deg: float = Field(default=1.0, ge=0.2, le=20, description="bend of the same, deg")
    field_indicator: float = Field(default=1.5, ge=0.1, le=10, description="indicator value of an Aurora")
    confidence_sigma: float = Field(
        default=3.0, ge=1, le=6, description="standard deviations between 'seen' and 'shown'"
    )
    point_mm: float | None = Field(
        default=None, ge=0.5, le=50, description="error of a point, 99.7 %, that an OK may have; None: any, mm"
    )
    point_depth_mm: float | None = Field(
        default=None, ge=0, le=400, description="depth for which the error of a point is reported as well, mm"
    )
    region: Region = Region()
    required_age_s: RequiredAges = RequiredAges()
    at_rest_s: float = Field(default=AT_REST_S, ge=0, le=600, description="longer while the probe rests, s")
    named_nats: float = Field(
        default=NAMED_NATS, ge=NAMED_NATS, le=MOST_NAMED_NATS, description="log likelihood ratio of a name, nats"
    )

    @model_validator(mode="before")
    @classmethod
    def _of_profile(cls, given: Any) -> Any:
        """Returns the limits with those of the profile where none are given."""
        if not isinstance(given, dict):
            return given
        own = next((limits for name, limits in PROFILES.items() if name == given.get("profile")), {})
        return {**own, **given}

    @property
    def beside_profile(self) -> dict[str, Any]:
        """Returns the limits that differ from the profile's and change what an OK means: field → value in force."""
        own = Limits(profile=self.profile)
        names = (*_MEANING, "region", "required_age_s")
        return {name: getattr(self, name) for name in names if getattr(self, name) != getattr(own, name)}
