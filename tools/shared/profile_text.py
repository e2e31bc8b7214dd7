"""Writes the limits in force as text under the name of their profile, the same in every output."""

from collections.abc import Mapping
from typing import Any

from probewatch.appliance.supervision.languages import translated
from probewatch.tools.german.translation import told

WORDS = {"limits": "limits: {profile}", "limits but": "limits: {profile}, but for {beside}"}


def profile_text(limits: Mapping[str, Any] | None, language: str = "en") -> str:
    """Returns the text. `limits` comes from the status or a report, with profile and beside; empty where an older
    service sends none.
    """
    if limits is None:
        return ""
    profile, beside = (
        limits["profile"],
        ", ".join(_named(name, value, language) for name, value in limits["beside"].items()),
    )
    return translated(WORDS["limits but" if beside else "limits"], language).format(profile=profile, beside=beside)


def logged_limits_text(data: Mapping[str, Any], language: str = "en") -> str:
    """Returns the limits of an entry of the alarm log; empty for an entry of a version that stores none, or stores them
    in another form.
    """
    limits = data.get("limits")
    told = isinstance(limits, Mapping) and "profile" in limits and isinstance(limits.get("beside"), Mapping)
    return profile_text(limits, language) if told else ""


def is_usual(limits: Mapping[str, Any] | None) -> bool:
    """Returns whether these are the shipped limits, which are not shown."""
    return limits is None or (limits["profile"] == "coarse" and not limits["beside"])


def _named(name: str, value: Any, language: str) -> str:
    """Returns a limit with its value; a limit with several values is named only."""
    if value is None:
        return told("no {name}", language, name=name)
    return name if isinstance(value, dict) else f"{name} {value:g}"
