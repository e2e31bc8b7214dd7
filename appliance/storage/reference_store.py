"""Stores the history of reference calibrations on the disk; the last of them is in force.

A folder `references` beside the alarm log holds `history.json`, which states where each reference came from, and the
content of each under its SHA-256. The content is on the disk before the history that names it, and the history is
replaced as a whole, so that a power cut leaves the previous or the new one. A file that does not match its checksum, or
is missing, is refused by name; nothing else is ever used in its place.
"""

import errno
import hashlib
import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from probewatch.appliance.storage.alarm_chain import digest_of
from probewatch.appliance.storage.calibration_file import is_device_set
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.atomic_file import make_folder, replacing, sync_directory

FOLDER, HISTORY = "references", "history.json"
CONFIGURED, RECALIBRATED, FROM_FILE = "configuration", "recalibration", "file"

_MAX_HISTORY_BYTES = 16_000_000
"""Largest size of the history, bytes: about 15,000 references. A longer file was not written here."""

_RESTORE = "Restore the folder from a copy, or start again with the configuration's file: probewatch calibration reset"

_Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class _Stored(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Entry(_Stored):
    """Describes one reference.

    number: counts from 1. origin: configuration, recalibration, "went back to N", file (one that existed before, as for
    `calibration use`), or "file of reference N" where its content was that of N. utc: when it came into force, ISO
    8601. software: the version that took it. file: where its content lay. image_size_px, probe: those with which a
    device set was read. simulated: whether it was made from a simulated scan. difference: that from the previous one,
    in words; empty for the first. who: the person who asked for it; empty for the service itself. to_show: checks that
    must be shown before its first OK. verified_utc: when motion first showed it; None before. relative_pose: that of
    `appliance.core.estimator_settings.EstimatorSettings`, by rows; None where it is not known.
    """

    number: Annotated[int, Field(ge=1)]
    origin: str
    utc: str
    software: str
    file: str
    sha256: _Sha256
    image_size_px: tuple[int, int]
    probe: str
    simulated: bool
    difference: str = ""
    who: str = ""
    to_show: tuple[str, ...] = ()
    verified_utc: str | None = None
    relative_pose: Annotated[tuple[float, ...], Field(min_length=16, max_length=16)] | None = None


class History(_Stored):
    """Holds the references that were ever in force.

    entries: oldest first; the last is in force. configured_sha256: SHA-256 of the configuration's file when it became
    the first reference, or when a later choice of a person was verified, so that a change of that file is noticed;
    empty where it could not be read then; "none" where a choice was verified while the configuration named no file.
    """

    v: Literal[1] = 1
    entries: tuple[Entry, ...] = ()
    configured_sha256: str | None = None

    @model_validator(mode="after")
    def _counted(self) -> "History":
        if [entry.number for entry in self.entries] != list(range(1, len(self.entries) + 1)):
            raise ValueError("its references are not numbered from 1 on")
        return self

    @property
    def in_force(self) -> Entry | None:
        return self.entries[-1] if self.entries else None

    def entry(self, number: int) -> Entry:
        """Returns the reference of that number. Raises ConfigurationError for a number that does not exist."""
        if not 1 <= number <= len(self.entries):
            count = len(self.entries)
            known = {0: "there is none yet", 1: "there is only number 1"}.get(count, f"there are 1 to {count}")
            raise ConfigurationError(f"is not a reference of this service, {known}", f"reference {number}", _LIST)
        return self.entries[number - 1]


_LIST = "See: probewatch calibration list"


def sha256_of(content: bytes) -> str:
    """Returns the SHA-256 of the content in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def read_history(folder: Path) -> History | None:
    """Returns the references that were ever in force; None where there was none. folder: that of the alarm log.

    Raises ConfigurationError for a store that is damaged or cannot be read, the content of the reference in force
    included.
    """
    place = folder / FOLDER
    try:
        stored = _history_bytes(place)
        if stored is None:
            return None
        history = _parsed(stored, place / HISTORY)
    except OSError as error:
        what = f"the history of references cannot be read ({error.strerror})"
        raise ConfigurationError(what, str(error.filename or place), "Check the disk and the permissions") from None
    if history.in_force is not None:
        content_of(folder, history.in_force)
    return history


def content_of(folder: Path, entry: Entry) -> bytes:
    """Returns the calibration file as it was taken. Raises ConfigurationError where it is missing or was changed."""
    for file in _places(folder, entry.sha256):
        try:
            content = file.read_bytes()
        except FileNotFoundError:
            continue
        except OSError as error:
            raise _damaged(file, f"cannot be read ({error.strerror})") from None
        if sha256_of(content) != entry.sha256:
            raise _damaged(file, f"was changed: it is not the content of reference {entry.number}")
        return content
    raise _damaged(folder / FOLDER, f"the content of reference {entry.number} is missing ({entry.sha256})")


def write_history(folder: Path, history: History, contents: dict[str, bytes]) -> None:
    """Writes the history, which is on the disk when this returns. contents: by SHA-256, those that the folder may not
    hold yet. Raises OSError, also where the history would be too large to be read: a restart could not go on with it.

    In a new folder, an empty history is written first, because content without a history counts as damage.
    """
    text = _text(history)
    if len(text) > _MAX_HISTORY_BYTES:
        raise OSError(errno.EFBIG, "the history of references is full; begin another: probewatch calibration reset")
    place = folder / FOLDER
    make_folder(place, 0o750)
    if not (place / HISTORY).exists():
        _write(place / HISTORY, _text(History()))
    for sha256, content in contents.items():
        file = _places(folder, sha256)[is_device_set(content)]
        if not (file.exists() and sha256_of(file.read_bytes()) == sha256):
            _write(file, content)
    _write(place / HISTORY, text)


def set_aside(folder: Path) -> Path | None:
    """Renames the whole store, damaged or not, and leaves an empty one in its place. Returns the new name; None where
    there was no store. Raises OSError.
    """
    place, kept = folder / FOLDER, None
    if place.exists():
        kept = place.with_name(f"{FOLDER}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}")
        place.rename(kept)
        sync_directory(folder)
    write_history(folder, History(), {})
    return kept


def _history_bytes(place: Path) -> bytes | None:
    """Returns the stored history; None for a folder that never held one. Raises OSError, ConfigurationError."""
    try:
        with (place / HISTORY).open("rb") as stream:
            stored = stream.read(_MAX_HISTORY_BYTES + 1)
    except FileNotFoundError:
        if place.is_dir() and any(not one.name.startswith(".") for one in place.iterdir()):
            raise _damaged(place / HISTORY, "is missing, although references were kept") from None
        return None
    if len(stored) > _MAX_HISTORY_BYTES:
        raise _damaged(place / HISTORY, "is too large")
    return stored


def _parsed(stored: bytes, file: Path) -> History:
    try:
        fields: dict[str, Any] = json.loads(stored)
        if fields.pop("check") != digest_of(fields):
            raise _damaged(file, "does not match its checksum")
        return History.model_validate(fields)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise _damaged(file, f"cannot be understood: {where} {first['msg']}".replace("  ", " ")) from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise _damaged(file, "cannot be understood") from None


def _places(folder: Path, sha256: str) -> tuple[Path, Path]:
    return folder / FOLDER / f"{sha256}.toml", folder / FOLDER / f"{sha256}.xml"


def _text(history: History) -> bytes:
    """Returns the history as JSON, with its checksum. A relative pose is written only where there is one, so that
    versions without it can read the store of a usual cart.
    """
    fields = history.model_dump(mode="json")
    for entry in fields["entries"]:
        if entry["relative_pose"] is None:
            del entry["relative_pose"]
    return json.dumps({**fields, "check": digest_of(fields)}, indent=1).encode()


def _write(file: Path, content: bytes) -> None:
    with replacing(file) as stream:
        stream.write(content)


def _damaged(where: Path, what: str) -> ConfigurationError:
    return ConfigurationError(f"{what}; which calibration is in force is not known", str(where), _RESTORE)
