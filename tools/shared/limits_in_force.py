"""Explains the limits in force, for a person who checks or writes a configuration."""

from collections.abc import Iterator
from typing import Any

from probewatch.appliance.configuration.config import Config
from probewatch.appliance.configuration.toml_lines import key_lines
from probewatch.appliance.core.parameters import QUANTITIES, never_shown
from probewatch.appliance.core.quality.check_fields import limits_fields
from probewatch.appliance.limits import PROFILES, Limits
from probewatch.appliance.types import Calibration
from probewatch.tools.german.translation import told
from probewatch.tools.shared.profile_text import profile_text

_LESS_IS_LOOSER = ("confidence_sigma",)
"""Limits of which a smaller number makes an OK assert less; of all others a larger number does."""
_NEVER = (
    "{key} is never verified, so the contact stays open: what motion cannot tell fills it "
    "({sigmas} x {left_out} {unit}). Give more than {least}"
)
_NEVER_SOFT = (
    "{key} is never verified over tissue that gives way, as a patient's: what motion cannot tell fills it there "
    "({sigmas} x {left_out} {unit}). Give more than {least}"
)
"""Warnings about a limit that is used up by what the model leaves out alone: in any tissue, and in tissue that gives
way."""


_QUIET_AGE_S = 20.0
"""Age, s, up to which motion counts that is no livelier than quiet scanning, once it shows something: the template says
so beside max_verification_age_s."""
_YOUNG = (
    "{key} = {age}: what quiet scanning shows is up to {quiet} s old, so the contact opens again and again. Give "
    "{quiet} or more"
)
_BELOW = "[limits] point_depth_mm = {depth} lies below the picture, which is {height} mm high. Give less"


def rows(limits: Limits, text: str, language: str = "en") -> Iterator[str]:
    """Yields a row for the profile, for each of its limits and for each limit in the file. `text` is the
    configuration.
    """
    yield profile_text(limits_fields(limits), language)
    given = {place[1] for place in key_lines(text) if len(place) == 2 and place[0] == "limits"}
    of_profile = {name for one in PROFILES.values() for name in one}
    for name, value in limits:
        if name not in of_profile and name not in given:
            continue
        if name not in ("profile", "region", "required_age_s"):
            yield f"  {name:<18}{_text(value, language):<7}{_why(limits, name, name in given, language)}"
    sections = (name for name in ("region", "required_age_s") if name in limits.beside_profile)
    yield from (f"  [limits.{name}]  {told('given in the file', language)}" for name in sections)


def remarks(limits: Limits, language: str = "en") -> Iterator[str]:
    """Yields a warning for each limit that never lets the contact close, or that is looser than in its profile."""
    never = never_shown(limits, rigid=True)
    for fault in never_shown(limits, rigid=False):
        one = QUANTITIES[fault]
        sigmas, key = limits.confidence_sigma, f"[limits] {one.limit_key} = {one.limit(limits):g}"
        added = one.left_out_rigid if fault in never else one.left_out
        left_out, least = f"{added:g}", f"{sigmas * added:g}"
        text = _NEVER if fault in never else _NEVER_SOFT
        yield told(text, language, key=key, sigmas=f"{sigmas:g}", left_out=left_out, unit=one.unit, least=least)
    own = Limits(profile=limits.profile)
    for name in limits.beside_profile:
        if _is_looser(name, getattr(limits, name), getattr(own, name)):
            text = "[limits] {name} is looser than profile {profile} has it: OK says less than that name"
            yield told(text, language, name=name, profile=limits.profile)


def remarks_on_ages(config: Config, language: str = "en") -> Iterator[str]:
    """Yields a warning for each age that quiet scanning cannot keep."""
    most_s = config.supervisor.max_verification_age_s
    ages_s = {f"[limits.required_age_s] {name}": age_s for name, age_s in config.limits.required_age_s.ages_s.items()}
    for key, age_s in {"[supervisor] max_verification_age_s": most_s, **ages_s}.items():
        if age_s is not None and age_s < _QUIET_AGE_S:
            yield told(_YOUNG, language, key=key, age=f"{age_s:g}", quiet=f"{_QUIET_AGE_S:g}")


def remarks_on_depth(limits: Limits, calibration: Calibration, language: str = "en") -> Iterator[str]:
    """Yields a warning where the depth for which the error of a point is reported lies below the picture."""
    height_mm = calibration.image_size_px[1] * float(calibration.scale_mm_per_px[1])
    if limits.point_depth_mm is not None and limits.point_depth_mm > height_mm:
        depth, height = f"{limits.point_depth_mm:g}", f"{height_mm:.3g}"
        yield told(_BELOW, language, depth=depth, height=height)


def _why(limits: Limits, name: str, is_given: bool, language: str) -> str:
    usual, profile = getattr(Limits(profile=limits.profile), name), limits.profile
    if not is_given:
        return told("profile {profile}", language, profile=profile)
    if getattr(limits, name) == usual:
        return told("given in the file, as profile {profile} has it", language, profile=profile)
    text = "given in the file; profile {profile} has {usual}"
    return told(text, language, profile=profile, usual=_text(usual, language))


def _text(value: Any, language: str) -> str:
    return told("off", language) if value is None else f"{value:g}"


def _is_looser(name: str, value: Any, usual: Any) -> bool:
    """Returns whether an OK asserts less with this value than with the usual one. A region excludes places, so it is
    looser; so are fewer required ages, and longer ones.
    """
    if name == "region":
        return True
    if name == "required_age_s":
        return set(value.names) < set(usual.names) or any(
            age_s is None or age_s > (usual.ages_s[asked] or 0) for asked, age_s in value.ages_s.items()
        )
    if usual is None:
        return False
    return bool(value < usual if name in _LESS_IS_LOOSER else value is None or value > usual)
