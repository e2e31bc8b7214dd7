"""Holds what people state before and after a live scan, and writes the calibration file that carries it."""

from dataclasses import dataclass, replace
from datetime import UTC, date, datetime
from pathlib import Path

from probewatch.appliance.crosswire.water import SCANNER_M_S
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.appliance.types import Calibration
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.printable import printable
from probewatch.tools.recalibration.scanning import Scanned
from probewatch.tools.recalibration.steps import Sound
from probewatch.tools.shared.sign_off import SignOff, whole_record

LONGEST_WORDS = 200
"""Characters of a name, a role or a comment that are kept."""


@dataclass(frozen=True, slots=True)
class Begin:
    """Holds what a person chose. wanted: whole, or zeta alone. technician: who scans. water_c, scanner_m_s,
    correct_sound: those of `Sound`. latency: whether the latency of the tracker is measured first. due, expires: those
    of `SignOff`.
    """

    probe: str
    preset: str
    technician: str
    reason: str = ""
    wanted: str = "whole"
    water_c: float | None = None
    scanner_m_s: float = SCANNER_M_S
    correct_sound: bool = False
    latency: bool = False
    due: date | None = None
    expires: date | None = None


@dataclass(frozen=True, slots=True)
class Signature:
    """Holds who accepts the calibration. confirm: the difference from the calibration in force, repeated where it must
    be accepted. unchecked: why no check at another point was made, where none was, or where it is not counted.
    """

    name: str
    role: str
    comment: str = ""
    confirm: str = ""
    unchecked: str = ""


def checked(begin: Begin) -> Begin:
    """Returns the paperwork with its words made printable. Raises ControlRefused, in words for the technician."""
    if begin.wanted not in ("whole", "zeta"):
        raise ControlRefused("unknown choice", begin.wanted, "Choose the whole calibration, or ζ alone")
    probe, preset, technician, reason = (
        printable(text.strip(), LONGEST_WORDS) for text in (begin.probe, begin.preset, begin.technician, begin.reason)
    )
    if not (probe and preset and technician):
        raise ControlRefused("probe, depth and your name are needed", "recalibration", "Fill them in")
    if begin.correct_sound and begin.wanted != "whole":
        raise ControlRefused("ζ alone does not change the depths", "water", "Choose the whole calibration")
    Sound(begin.water_c, begin.scanner_m_s, begin.correct_sound)
    return replace(begin, probe=probe, preset=preset, technician=technician, reason=reason)


def signed(signature: Signature) -> Signature:
    """Returns the signature with its words made printable. Raises ControlRefused, in words for the technician."""
    name, role, comment, unchecked = (
        printable(text.strip(), LONGEST_WORDS)
        for text in (signature.name, signature.role, signature.comment, signature.unchecked)
    )
    if not (name and role):
        raise ControlRefused("name and role of the second person are needed", "sign-off", "Fill them in")
    return Signature(name, role, comment, signature.confirm, unchecked)


def write_signed(
    folder: Path, calibration: Calibration, begin: Begin, signature: Signature, scanned: Scanned, check: str
) -> Path:
    """Writes a new file, named after probe, preset and time, that states who made and signed it and from what, and
    returns its path. check: the record of the check at another point.

    Raises ConfigurationError where it cannot be written.
    """
    words = "-".join(filter(None, (_plain(begin.probe), _plain(begin.preset))))
    file = folder / f"{words or 'probe'}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}.toml"
    if file.exists():
        raise ConfigurationError("exists already", str(file), "Try again in a second")
    write_calibration(file, calibration, {**_provenance(begin, signature, scanned), "check": check})
    file.chmod(0o640)  # the service, of the same group, reads it
    return file


def _provenance(begin: Begin, signature: Signature, scanned: Scanned) -> dict[str, str]:
    state = scanned.state
    assert state is not None
    solved = "all eight parameters" if begin.wanted == "whole" else "ζ alone, closed form"
    source = f"live scan on the cart, {scanned.scan.pictures} pictures, {scanned.lost} samples lost"
    record = whole_record(state, sign_off(begin, signature), source, scanned.sha256)
    if scanned.sound.text:
        record["sound"] = scanned.sound.text
    if scanned.latency is not None:
        measured = f"{1e3 * scanned.latency.value_s:.2f} +- {1e3 * scanned.latency.sigma_s:.2f}"
        record["latency_measured_ms"] = f"{measured}, over the tank's bottom; latency_ms is what the scan adds"
    return {**record, "solved": solved}


def sign_off(begin: Begin, signature: Signature) -> SignOff:
    """Returns the sign-off of both persons, for the file."""
    return SignOff(
        made_by=begin.technician,
        signed_by=signature.name,
        role=signature.role,
        comment=signature.comment,
        reason=begin.reason,
        probe_serial=begin.probe,
        preset=begin.preset,
        due=begin.due,
        expires=begin.expires,
    )


def _plain(text: str) -> str:
    return "".join(sign if sign.isascii() and sign.isalnum() else "_" for sign in text)[:40].strip("_")
