"""Makes and reviews the record in a calibration file: who made it from what, who signed it, and when it expires."""

import getpass
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, date, datetime
from importlib.metadata import version

import numpy as np

from probewatch.appliance.crosswire.running import Running
from probewatch.appliance.types import PARAMETERS
from probewatch.drivers.errors import ConfigurationError

NOT_MADE = "not made: "
"""Begins the record of the check at another point where no check was made; the reason follows."""
_STROKES = " .-_?<>[]()"
_PLACEHOLDERS = ("", "name", "your name", "role", "todo", "tbd", "fixme", "x", "xxx", "n/a", "none", "unknown", "test")
"""Texts that a form has until somebody fills it in, in lower case and without the signs around them."""


def user() -> str:
    """Returns the name of the current user, as the system reports it."""
    try:
        return getpass.getuser()
    except (OSError, KeyError):
        return f"uid {os.getuid()}"


@dataclass(frozen=True, slots=True)
class SignOff:
    """Holds the statements of people about a calibration; empty where none was made. `due`: date of renewal; `expires`:
    last day of use.
    """

    made_by: str
    signed_by: str = ""
    role: str = ""
    comment: str = ""
    reason: str = ""
    probe_serial: str = ""
    preset: str = ""
    due: date | None = None
    expires: date | None = None

    def check(self) -> None:
        """Raises ConfigurationError where the maker is the signer, a signer has no role or a role has no signer, a date
        has passed, or the calibration expires before it is due.
        """
        if self.signed_by and _name(self.signed_by) == _name(self.made_by):
            what = f"{self.signed_by} made it and cannot sign it as well"
            raise ConfigurationError(what, "sign-off", "Have a second person sign, or leave --signed-by away for now")
        if bool(self.signed_by) != bool(self.role):
            raise ConfigurationError("a signature is a name and a role", "sign-off", "Give --signed-by and --role")
        if self.due is not None and self.expires is not None and self.expires < self.due:
            what = f"it would expire on {self.expires}, before it is due on {self.due}"
            raise ConfigurationError(what, "sign-off", "Give --expires a later day")
        for day, option in ((self.due, "--due"), (self.expires, "--expires")):
            if day is not None and day < datetime.now(UTC).date():
                raise ConfigurationError(f"{day} has passed", "sign-off", f"Give {option} a later day")

    def fields(self) -> dict[str, str]:
        """Returns the keys for the calibration's provenance, without empty ones."""
        said = {
            "made_by": self.made_by,
            "signed_by": self.signed_by,
            "signed_role": self.role,
            "signed_at": datetime.now(UTC).isoformat(timespec="seconds") if self.signed_by else "",
            "comment": self.comment,
            "reason": self.reason,
            "probe_serial": self.probe_serial,
            "preset": self.preset,
            "due": "" if self.due is None else self.due.isoformat(),
            "expires": "" if self.expires is None else self.expires.isoformat(),
        }
        return {name: text for name, text in said.items() if text}


def _unchecked(stated: Mapping[str, str]) -> Iterator[str]:
    if (check := stated.get("check", "")).startswith(NOT_MADE):
        yield f"no check at another point was made: {check.removeprefix(NOT_MADE)}"


def remarks_on(stated: Mapping[str, str], now: datetime) -> Iterator[str]:
    """Yields what a reader of this provenance must not rely on: a missing check or signature, a placeholder, an
    impossible date.
    """
    for key, what in (("made_by", "who made it"), ("signed_by", "who signed it"), ("signed_role", "the signer's role")):
        if _name(stated.get(key, "")).strip(_STROKES) in _PLACEHOLDERS and key in stated:
            yield f"{what} is {stated[key]!r}: that is a placeholder, not a person"
    yield from _unchecked(stated)
    if not stated.get("signed_by"):
        yield "it is not signed"
    elif _name(stated["signed_by"]) == _name(stated.get("made_by", "")):
        yield "it is signed by who made it, not by a second person"
    made, signed = (_moment(stated.get(key)) for key in ("when", "signed_at"))
    for moment, what in ((made, "made"), (signed, "signed")):
        if moment is not None and moment > now:
            yield f"it says that it was {what} on {moment:%Y-%m-%d %H:%M} UTC, which lies in the future"
    if made is not None and signed is not None and signed.date() < made.date():
        yield f"it was signed on {signed:%Y-%m-%d}, before it was made on {made:%Y-%m-%d}"
    for key in ("when", "signed_at"):
        if key in stated and _moment(stated[key]) is None:
            yield f"its {key!r} is {stated[key]!r}, no time such as 2026-05-01T08:00:00+00:00"


def _moment(text: str | None) -> datetime | None:
    try:
        moment = datetime.fromisoformat(text or "")
    except ValueError:
        return None
    return moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)


def _name(text: str) -> str:
    return " ".join(text.casefold().split())


def whole_record(state: Running, sign_off: SignOff, source: str, data_sha256: str) -> dict[str, str]:
    """Returns the provenance of a calibration that was solved without an earlier one. `source` names the scan. Raises
    ValueError without a solution.
    """
    whole = state.whole
    if whole is None or whole.calibration.covariance is None:
        raise ValueError("nothing was solved")
    rows, columns = np.tril_indices(len(PARAMETERS))
    lower = whole.calibration.covariance[rows, columns]
    return {
        "when": datetime.now(UTC).isoformat(timespec="seconds"),
        "how": "cross-wire, all eight parameters by least squares",
        "software": f"probewatch {version('probewatch')}",
        "input": source,
        "data_sha256": data_sha256,
        "views": f"{whole.views} used, {len(state.rejected)} rejected, {len(state.struck)} struck out",
        "residual_mm": " ".join(f"{value:.4f}" for value in whole.noise_mm),
        "expected_mm": f"{whole.expected_mm:.4f}",
        "tilt_spread_deg": " ".join(f"{value:.2f}" for value in state.coverage.spread_deg),
        "latency_ms": f"{1000 * whole.latency_s:.2f} +- {1000 * whole.latency_sigma_s:.2f}",
        "zeta_closed_form_mm": "" if state.closed is None else f"{state.closed.zeta_mm:.4f}",
        "covariance": json.dumps([float(f"{value:.6g}") for value in lower]),
        **sign_off.fields(),
    }
