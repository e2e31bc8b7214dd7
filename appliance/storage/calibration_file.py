"""Reads and writes calibrations: our own TOML, and the device-set XML of the PLUS toolkit (read only).

PLUS names a calibration ImageToProbe (`image_to_probe.py`).
"""

import errno
import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, StrictBool, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from probewatch.appliance.configuration.mistakes import Mistakes
from probewatch.appliance.core.acquisition.input_validation import ORTHOGONAL_WITHIN
from probewatch.appliance.storage.device_set_calibration import device_set_calibration
from probewatch.appliance.storage.image_to_probe import (
    FARTHEST_MM,
    SCALE_RANGE_MM,
    calibration_from_image_to_probe,
    check_measured,
    image_to_probe,
)
from probewatch.appliance.types import PARAMETERS, Calibration, Vector
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.atomic_file import check_kind, writing
from probewatch.drivers.files.markup import SAVE_AS_UTF_8, NotUtf8Error, text_of, toml_of
from probewatch.drivers.files.regular_file import read_bounded, reading
from probewatch.drivers.printable import printable
from probewatch.drivers.recordings.foreign import HEAD_BYTES, are_matrix, kind_of
from probewatch.drivers.rigid import nearest_rotation

FORMAT = "probewatch-calibration"
VERSION = 1
_OTHERS = (".xml", ".tfm", ".h5")
"""Suffixes under which PLUS and ITK expect formats of their own: nobody reads TOML under such a name."""
TOML_BEGINS = "# Spatial calibration of a tracked ultrasound probe"
"""The first words of each of our files."""

_MAX_XML_BYTES = 1_000_000
"""Bytes. A device set of PLUS has 10 kB or so."""

_MAX_TOML_BYTES = 16_000
"""Bytes. Our files have 2000 or so, and the service, which reads one between two ticks, needs 30 ms for this many."""

_GIVE = "Give a .toml or a PLUS .xml file"

_PUT_INTO_TOML = (
    'Write a .toml: format = "probewatch-calibration", version = 1, image_size_px = [width, height] and '
    "image_to_probe = [[…], […], […], [0, 0, 0, 1]], its rows, px to mm"
)
_MOST_MATRIX_BYTES = 2000
"""Bytes of sixteen numbers as text, which have 25 digits at most. More is something else."""
ITK_BEGINS = b"#Insight Transform File"
"""First bytes of an ITK text transform."""


def _number(value: object) -> object:
    """Returns the value. Raises what pydantic reports for text and for a truth value, which Python takes for 0 or 1."""
    if isinstance(value, bool | str):
        raise PydanticCustomError("refused", "must be a number")
    return value


# Strict, so that no text or truth value counts as a number: a file with such values was not written as intended.
_Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
_Row3 = tuple[_Finite, _Finite, _Finite]
_Row4 = tuple[_Finite, _Finite, _Finite, _Finite]
_Scale = Annotated[_Finite, Field(ge=SCALE_RANGE_MM[0], le=SCALE_RANGE_MM[1])]
_Distance = Annotated[_Finite, Field(ge=-FARTHEST_MM, le=FARTHEST_MM)]
_Side = Annotated[int, BeforeValidator(_number), Field(ge=16, le=16_384)]
_Sign = Annotated[Literal[-1, 1], BeforeValidator(_number)]
_Sigma = Annotated[float, Field(strict=True, ge=0)]
_Radius = Annotated[_Finite, Field(ge=3, le=200)]
"""mm, from the radius of the smallest endocavitary probes to one that is nearly flat."""


class _File(BaseModel):
    """Holds the keys of the TOML file: either image_to_probe or the three parts of X and Λ."""

    model_config = ConfigDict(extra="forbid")

    format: Literal["probewatch-calibration"]
    version: Annotated[Literal[1], BeforeValidator(_number)]
    image_size_px: tuple[_Side, _Side]
    polarity: tuple[_Sign, _Sign] = (1, 1)
    image_to_probe: tuple[_Row4, _Row4, _Row4, _Row4] | None = None
    rotation: tuple[_Row3, _Row3, _Row3] | None = None
    scale_mm_per_px: tuple[_Scale, _Scale] | None = None
    offset_mm: tuple[_Distance, _Distance, _Distance] | None = None
    not_observed: tuple[str, ...] = ()
    sigma: dict[str, _Sigma] | None = None
    simulated: StrictBool = False
    face_radius_mm: _Radius | None = None
    provenance: dict[str, str] = {}

    @model_validator(mode="after")
    def _complete(self) -> Self:
        parts = [part is not None for part in (self.rotation, self.scale_mm_per_px, self.offset_mm)]
        if any(parts) == (self.image_to_probe is not None) or (any(parts) and not all(parts)):
            raise ValueError("give rotation, scale_mm_per_px and offset_mm together, or image_to_probe alone")
        if self.sigma is not None and set(self.sigma) != set(PARAMETERS):
            raise ValueError(f"the keys of [sigma] are {', '.join(PARAMETERS)}")
        if unknown := [name for name in self.not_observed if name not in PARAMETERS]:
            raise ValueError(f"not_observed has '{printable(unknown[0])}'; it may name {', '.join(PARAMETERS)}")
        return self


def read_calibration(
    path: Path | str, image_size_px: tuple[int, int] | None = None, probe: str = "Probe"
) -> Calibration:
    """Reads our TOML, or the Image → `probe` transform of a PLUS device-set XML.

    image_size_px: (width, height) of the pictures to watch; XML needs it, TOML must agree with it. probe: the marker
    body, or the whole transform where the picture is not called Image, such as LeftImageToProbe. Raises
    ConfigurationError naming file, key, fault and remedy; nothing that is not scale · rotation is accepted.
    """
    file = Path(path)
    return parse_calibration(calibration_bytes(file), file, image_size_px, probe)


def parse_calibration(
    data: bytes, path: Path, image_size_px: tuple[int, int] | None = None, probe: str = "Probe"
) -> Calibration:
    """Does the same with a file's content. path: where the file was, for the message of a refusal."""
    if not data.strip():
        raise ConfigurationError("is empty", str(path), "Copy it again")
    if is_device_set(data):
        return device_set_calibration(data, path, image_size_px, probe)
    calibration = _from_toml(data, path)
    if image_size_px not in (None, calibration.image_size_px):
        what = f"image_size_px is {calibration.image_size_px}, the pictures are {image_size_px}"
        raise ConfigurationError(what, str(path), "Give the calibration that belongs to this scanner setting")
    return calibration


def is_device_set(data: bytes) -> bool:
    """Returns whether the content is XML, which does not state the size of the pictures, and not our TOML."""
    return data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<")


def provenance_of(data: bytes) -> dict[str, str]:
    """Returns what a calibration file in TOML states about its origin; empty where it cannot be read. Anybody may have
    written it, so whoever shows it must pass it through `printable`.
    """
    if is_device_set(data):
        return {}
    try:
        stated = tomllib.loads(text_of(data)).get("provenance", {})
    except (ValueError, RecursionError):
        return {}
    return {str(key): str(text) for key, text in stated.items()} if isinstance(stated, dict) else {}


def calibration_bytes(path: Path) -> bytes:
    """Returns the content of a file. Never waits for a writer, and opens no device. Raises ConfigurationError."""
    try:
        return read_bounded(path, _MAX_XML_BYTES)
    except OSError as error:
        if error.errno == errno.EFBIG and (kind := _kind_of(path)):
            raise ConfigurationError(f"is {kind}, not a calibration", str(path), _GIVE) from None
        what = f"cannot be read: {error.strerror}"
        raise ConfigurationError(what, str(path), f"Check name and permissions. {_GIVE}") from error


def refuse_other_kind(data: bytes, path: Path) -> None:
    """Raises ConfigurationError for content that is recognised, and is neither TOML nor a device set of PLUS."""
    kind = kind_of(data[:HEAD_BYTES])
    if _is_matrix(data):
        raise ConfigurationError("is a bare matrix of 4 x 4 numbers", str(path), _PUT_INTO_TOML)
    if data.startswith(ITK_BEGINS):
        remedy = "probewatch calibration import makes a .toml of it"
        raise ConfigurationError(f"is {kind}, not a calibration file", str(path), remedy)
    if kind and not is_device_set(data):
        raise ConfigurationError(f"is {kind}, not a calibration", str(path), _GIVE)


def refuse_toml(data: bytes, path: Path) -> None:
    """Raises ConfigurationError for a calibration in TOML, which needs no import, and for what is no device set."""
    if not is_device_set(data):
        parse_calibration(data, path)
        remedy = f"Give it to the service: probewatch calibration use {path}"
        raise ConfigurationError("is a calibration of probewatch already", str(path), remedy)


def _kind_of(path: Path) -> str:
    with reading(path) as stream:
        head = stream.read(HEAD_BYTES)
    return "" if is_device_set(head) else kind_of(head)


def check_own_name(path: Path | None) -> None:
    """Raises ConfigurationError for the name of another kind of file: what is written is TOML, which PLUS and 3D Slicer
    do not read under any name. None stands for no file.
    """
    if path is not None and path.suffix.lower() in _OTHERS:
        remedy = "Name a .toml; then, for PLUS or 3D Slicer: probewatch calibration export"
        raise ConfigurationError(f"a calibration file of ours is TOML, not {path.suffix}", str(path), remedy)
    check_kind(path, "a calibration, TOML", ".toml")


def write_calibration(path: Path, calibration: Calibration, provenance: Mapping[str, str]) -> None:
    """Writes our TOML; the old file stays until the new one is whole and on the disk.

    Only the standard deviations of the covariance are kept. provenance: who, when, how, from what; free keys. Raises
    ConfigurationError where the place cannot be written.
    """
    with writing(path) as stream:
        stream.write(_toml(calibration, provenance).encode())


def _from_toml(data: bytes, path: Path) -> Calibration:
    try:
        text = text_of(data)
        file = _File.model_validate(toml_of(data, _MAX_TOML_BYTES))
    except ValidationError as error:
        raise Mistakes.found(error, _File, text, path, "Mend it, or restore the file") from None
    except NotUtf8Error as error:
        refuse_other_kind(data, path)
        raise ConfigurationError(str(error), str(path), SAVE_AS_UTF_8) from None
    except ValueError as error:
        refuse_other_kind(data, path)
        if path.suffix.lower() == ".toml":
            remedy = "Mend that line: a number begins with a digit (0.1), a text stands in quotes"
            raise ConfigurationError(f"is not valid TOML: {error}", str(path), remedy) from error
        raise ConfigurationError(f"is neither TOML nor XML: {error}", str(path), _GIVE) from error
    base = _from_parts(file, path)
    covariance = None if file.sigma is None else np.diag([file.sigma[name] ** 2 for name in PARAMETERS])
    observed = tuple(name not in file.not_observed for name in PARAMETERS)
    parts = (base.rotation, base.polarity, base.scale_mm_per_px, base.offset_mm, base.image_size_px)
    known = Calibration(*parts, covariance=covariance, observed=observed, simulated=file.simulated)
    return replace(known, face_radius_mm=file.face_radius_mm)


def _is_matrix(data: bytes) -> bool:
    """Returns whether the content is a matrix as MATLAB and NumPy write one."""
    if len(data) > _MOST_MATRIX_BYTES:
        return False
    words = re.split(r"[\s,;\[\]]+", data.decode("ascii", "replace").strip(" \t\r\n,;[]"))
    return are_matrix(words)


def _from_parts(file: _File, path: Path) -> Calibration:
    if file.image_to_probe is not None:
        matrix = np.array(file.image_to_probe)
        return calibration_from_image_to_probe(matrix, file.image_size_px, file.polarity, str(path))
    R = np.array(file.rotation)
    if np.abs(R @ R.T - np.eye(3)).max() > ORTHOGONAL_WITHIN or np.linalg.det(R) < 0:
        remedy = "Its rows must be a right-handed orthonormal frame; restore the file or calibrate again"
        raise ConfigurationError("rotation is not a rotation matrix", str(path), remedy)
    scale, offset = np.array(file.scale_mm_per_px), np.array(file.offset_mm)
    check_measured(scale, str(path))
    return Calibration(nearest_rotation(R), file.polarity, scale, offset, file.image_size_px)


def _toml(calibration: Calibration, provenance: Mapping[str, str]) -> str:
    plus = "\n".join(f"#   {_row(row)}" for row in image_to_probe(calibration))
    hidden = [name for name, seen in zip(PARAMETERS, calibration.observed, strict=True) if not seen]
    lines = [
        f"{TOML_BEGINS}. X maps the marker body's frame to the picture's frame:",
        "# origin at the picture's centre, x along columns, y along rows (down), z = x × y; mm.",
        "# The same as PLUS's ImageToProbe, corner pixel → mm, for reading only:",
        plus,
        f'format = "{FORMAT}"',
        f"version = {VERSION}",
        f"image_size_px = {list(calibration.image_size_px)}    # width, height",
        f"polarity = {list(calibration.polarity)}    # lateral, axial; -1 where the picture is mirrored",
        "rotation = [    # of X, sensor → picture",
        *(f"  {_row(row)}," for row in calibration.rotation),
        "]",
        f"scale_mm_per_px = {_row(calibration.scale_mm_per_px)}    # lateral, axial",
        f"offset_mm = {_row(calibration.offset_mm)}    # translation of X",
        f"not_observed = {json.dumps(hidden)}",
    ]
    if calibration.face_radius_mm is not None:
        lines += [f"face_radius_mm = {calibration.face_radius_mm!r}    # of the arc at which the picture begins"]
    if calibration.simulated:
        lines += ["simulated = true    # made of a simulated scan: no cart with real devices takes it"]
    if calibration.covariance is not None:
        sigmas = np.sqrt(np.diag(calibration.covariance))
        lines += ["", "[sigma]    # standard deviations: rad, relative, mm"]
        lines += [f"{name} = {float(sigma)!r}" for name, sigma in zip(PARAMETERS, sigmas, strict=True)]
    lines += ["", "[provenance]"]
    lines += [f"{_quoted(key)} = {_quoted(text)}" for key, text in provenance.items()]
    return "\n".join(lines) + "\n"


def _row(values: Vector) -> str:
    return f"[{', '.join(repr(float(value)) for value in values)}]"


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
