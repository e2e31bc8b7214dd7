"""Translates the status of the service to OpenIGTLink: one STATUS, one STRING, two TRANSFORMs. Pure.

STATUS has code OK only while the contact is commanded closed and every contact output has taken that; everything else,
silence of the service included, is an error.
"""

import json
from dataclasses import replace
from typing import Any

import numpy as np

from probewatch.appliance.types import State
from probewatch.drivers.openigtlink.content import (
    CONFIGURATION,
    HARDWARE,
    NOT_PRESENT,
    NOT_READY,
    OK,
    TIMEOUT,
    Status,
    Words,
    transform_content,
)
from probewatch.drivers.openigtlink.message import US_ASCII, UTF_8, Entry, Message, time_of
from probewatch.tools.openigtlink.estimate import estimate_of
from probewatch.tools.shared.status_watch import Seen

STATUS_NAME, STATE_NAME, TRANSFORM_NAME = "Probewatch", "ProbewatchState", "ImageToProbe"
ESTIMATE_NAME = "ImageToProbeEstimate"
"""Device names of STATUS, STRING and TRANSFORM: each its own, as some clients keep one message of a name."""

NAMES = (STATUS_NAME, STATE_NAME, TRANSFORM_NAME, ESTIMATE_NAME)

_CODES = {
    State.SELF_TEST.value: NOT_READY,
    State.WAITING.value: NOT_READY,
    State.NOT_VERIFIED.value: NOT_READY,
    State.RECALIBRATING.value: NOT_READY,
    State.MONITORING.value: HARDWARE,
    State.WARNING.value: CONFIGURATION,
    State.HALT.value: CONFIGURATION,
    State.RECALIBRATION_REQUESTED.value: CONFIGURATION,
    State.DEVICE_LOST.value: NOT_PRESENT,
    State.INTERNAL_FAULT.value: HARDWARE,
}
"""State with an open contact → code. MONITORING with an open contact is an output that failed."""

_UNKNOWN = 2
"""Code for a state that only another version knows: unknown error, by the specification."""

_SAID = ("state", "text", "remedy", "fault", "reason", "latched", "acknowledged", "notices", "since_s",
         "verification_age_s", "simulated", "fps")  # fmt: skip
_MEASURED = ("name", "value", "sigma", "unit", "limit", "ratio", "verdict", "shown_age_s")
_HOW_SHOWN = ("max_age_s", "shown", "carried")
"""Further fields of the line's checks, as far as this version of the service sends them."""
_MOST_BYTES = 60_000
"""Bytes of a STRING, which can hold 65,535. The usual one has 4000."""


def is_closed(status: dict[str, Any]) -> bool:
    """Returns whether the contact is closed, as commanded and as taken by every contact output."""
    contacts = [output["energised"] for output in status["outputs"] if output["signal"] == "contact"]
    return status["energised"] is True and bool(contacts) and all(taken is True for taken in contacts)


def status_of(seen: Seen) -> Status:
    """Returns the content of STATUS. Its name is the state."""
    status = seen.status
    if status is None:
        return Status(TIMEOUT, 0, "service silent", f"the service does not answer: {seen.silence}")
    state, words = str(status["state"]), str(status["text"])
    if is_closed(status):
        return Status(OK, 0, state, words)
    if status["reason"] and status["reason"] != words:
        words = f"{words} ({status['reason']})"
    return Status(_CODES.get(state, _UNKNOWN), 0, state, f"contact open: {words}")


def fields_of(seen: Seen) -> dict[str, Any]:
    """Returns what STRING holds as JSON."""
    status = seen.status
    if status is None:
        return _facts(seen)
    reference, estimate = status["reference"], estimate_of(status)
    shown = None if estimate is None else {"image_to_probe": estimate.matrix.tolist(), "measured": estimate.measured}
    return {
        **_facts(seen),
        "reference": None if reference is None else {key: reference[key] for key in ("number", "origin", "sha256")},
        "estimate": shown,
        "limits": status.get("limits"),
        "point": status.get("point"),
        "point_limit_mm": status.get("point_limit_mm"),
        "checks": [_check(check) for check in (*status["checks"], *status["devices"])],
    }


def _check(check: dict[str, Any]) -> dict[str, Any]:
    return {key: check[key] for key in _MEASURED} | {key: check[key] for key in _HOW_SHOWN if key in check}


def _facts(seen: Seen) -> dict[str, Any]:
    status = seen.status
    if status is None:
        return {"contact_closed": False, "state": "service silent", "reason": seen.silence}
    return {"contact_closed": is_closed(status), **{key: status[key] for key in _SAID}}


def status_message(seen: Seen, utc_ns: int, version: int = 1, number: int = 0) -> Message:
    """Returns STATUS. utc_ns: nanoseconds since 1970 UTC at CLOCK_MONOTONIC 0."""
    return _message("STATUS", STATUS_NAME, status_of(seen).content, seen, utc_ns, version, number)


def state_message(seen: Seen, utc_ns: int, version: int = 1, number: int = 0) -> Message:
    """Returns STRING with everything, as JSON in ASCII, which every client can read."""
    fields = fields_of(seen)
    text = json.dumps(fields)
    if len(text) > _MOST_BYTES:
        text = json.dumps(fields | {"checks": []})[:_MOST_BYTES]
    return _message("STRING", STATE_NAME, Words(text, US_ASCII).content, seen, utc_ns, version, number)


def transform_message(seen: Seen, utc_ns: int, version: int = 1, number: int = 0) -> Message | None:
    """Returns TRANSFORM of the reference in force; None while there is none."""
    reference = None if seen.status is None else seen.status["reference"]
    if reference is None:
        return None
    content = transform_content(np.array(reference["image_to_probe"]))
    return _message("TRANSFORM", TRANSFORM_NAME, content, seen, utc_ns, version, number)


def estimate_message(seen: Seen, utc_ns: int, version: int = 1, number: int = 0) -> Message | None:
    """Returns TRANSFORM of the calibration as motion shows it; None while it shows nothing. Its metadata name the
    parameters that are measured.
    """
    estimate = None if seen.status is None else estimate_of(seen.status)
    if estimate is None:
        return None
    content = transform_content(estimate.matrix)
    message = _message("TRANSFORM", ESTIMATE_NAME, content, seen, utc_ns, version, number)
    measured = (("Measured", UTF_8, " ".join(estimate.measured)),) if version > 1 else ()
    return replace(message, metadata=message.metadata + measured)


def metadata_of(seen: Seen) -> tuple[Entry, ...]:
    """Returns the metadata of every message of header version 2."""
    fields, status = _facts(seen), status_of(seen)
    age_s = fields.get("verification_age_s")
    told = {
        "ContactClosed": str(fields["contact_closed"]).lower(),
        "State": fields["state"],
        "Fault": fields.get("fault") or "",
        "Reason": fields["reason"],
        "Text": status.text,
        "VerificationAgeS": "" if age_s is None else f"{age_s:.3f}",
        "Simulated": str(bool(fields.get("simulated"))).lower(),
    }
    return tuple((key, UTF_8, str(value)) for key, value in told.items())


def _message(kind: str, device: str, content: bytes, seen: Seen, utc_ns: int, version: int, number: int) -> Message:
    extended = (number, metadata_of(seen)) if version > 1 else (0, ())
    return Message(kind, device, content, time_of(seen.t_ns + utc_ns), version, *extended)
