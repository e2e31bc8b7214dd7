"""Calibrations on the disk: our own TOML, and the device-set XML of the PLUS toolkit (read only).

PLUS names a calibration ImageToProbe: pixel (column, row, 0, 1) → mm in the frame of the probe's marker body, which is
X⁻¹ · diag(s_x λ_x, s_y λ_y, 1) · (shift of the origin from the picture's corner to its centre), s the polarity.
"""

import errno
import json
import re
import tomllib
from collections import defaultdict, deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, StrictBool, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from appliance.configuration.mistakes import Mistakes
from appliance.core.acquisition.input_validation import ORTHOGONAL_WITHIN
from appliance.types import PARAMETERS, Calibration, Vector
from drivers.errors import ConfigurationError
from drivers.files.atomic_file import check_kind, writing
from drivers.files.markup import SAVE_AS_UTF_8, NotUtf8Error, text_of, toml_of, xml_of
from drivers.files.regular_file import read_bounded, reading
from drivers.recordings.foreign import HEAD_BYTES, are_matrix, kind_of
from drivers.rigid import nearest_rotation
from drivers.samples import Matrix4

FORMAT = "probewatch-calibration"
VERSION = 1
_OTHERS = (".xml", ".tfm", ".h5")
"""Endings under which PLUS and ITK look for formats of their own: TOML under such a name is read by nobody."""
TOML_BEGINS = "# Spatial calibration of a tracked ultrasound probe"
"""The first words of each file of ours."""

_MAX_XML_BYTES = 1_000_000
"""A device set of PLUS has 10 kB or so."""

_MAX_TOML_BYTES = 16_000
"""Ours have 2000 or so, and the service, which reads one between two ticks, needs 30 ms for this many."""

_GIVE = "Give a .toml or a PLUS .xml file"

_PUT_INTO_TOML = (
    'Write a .toml: format = "probewatch-calibration", version = 1, image_size_px = [width, height] and '
    "image_to_probe = [[…], […], […], [0, 0, 0, 1]], its rows, px to mm"
)
_MOST_MATRIX_BYTES = 2000
"""Of sixteen numbers as text, which have 25 digits at most. More is something else."""
ITK_BEGINS = b"#Insight Transform File"
"""First bytes of an ITK text transform."""

_UNIT_WITHIN = 1e-6
"""mm/px from 1 within which both scales were typed, not measured: calibrations keep six digits and more."""

_MAX_SKEW = 0.05
"""Largest cosine between picture axes: freehand PLUS calibrations come to about 0.02."""

_LAST_ROW_WITHIN = 1e-6
"""Tolerance of the last row, 0 0 0 1: what PLUS prints exactly. More takes a matrix in another form for a
calibration."""
_SCALE_RANGE_MM = (1e-3, 10.0)
"""mm per px. Pictures of 1 to 30 cm in 200 to 2000 px have .005 to 1.5; metres and micrometres for mm lie outside."""

_LARGEST_MM = 1000.0
"""Side of a picture: scanners show up to some 300 mm of depth. An inverse of .3 mm/px has 3.2, and makes 640 px 2 m."""

_FARTHEST_MM = 2000.0
"""Of the picture's centre from the marker body, which sits on the probe: public device sets have up to some 150 mm.
More is in another unit, or of another body; less might refuse a long holder."""


def _number(value: object) -> object:
    """Raises what pydantic reports for a truth value, which Python takes for 0 or 1, and for text."""
    if isinstance(value, bool | str):
        raise PydanticCustomError("refused", "must be a number")
    return value


_Named = tuple[str, str, str]
"""From, To and Matrix of a transform."""
_Step = tuple[_Named, bool]
"""A transform on the way from one frame to another, and whether it is turned round there."""
# Strict, so that no text or truth value counts as a number: a file that has them was not written as it was meant.
_Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
_Row3 = tuple[_Finite, _Finite, _Finite]
_Row4 = tuple[_Finite, _Finite, _Finite, _Finite]
_Scale = Annotated[_Finite, Field(ge=_SCALE_RANGE_MM[0], le=_SCALE_RANGE_MM[1])]
_Distance = Annotated[_Finite, Field(ge=-_FARTHEST_MM, le=_FARTHEST_MM)]
_Side = Annotated[int, BeforeValidator(_number), Field(ge=16, le=16_384)]
_Sign = Annotated[Literal[-1, 1], BeforeValidator(_number)]
_Sigma = Annotated[float, Field(strict=True, ge=0)]
_Radius = Annotated[_Finite, Field(ge=3, le=200)]
"""mm: of the smallest endocavitary probes, and nearly flat."""


class _File(BaseModel):
    """The keys of the TOML file; either image_to_probe or the three parts of X and Λ."""

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
        if not set(self.not_observed) <= set(PARAMETERS):
            raise ValueError(f"not_observed may name {', '.join(PARAMETERS)}")
        return self


def read_calibration(path: Path, image_size_px: tuple[int, int] | None = None, probe: str = "Probe") -> Calibration:
    """Read our TOML, or the Image → `probe` transform of a PLUS device-set XML.

    image_size_px: (width, height) of the pictures to watch; XML needs it, TOML must agree with it. probe: the marker
    body, or the whole transform where the picture is not called Image, such as LeftImageToProbe. Raises
    ConfigurationError naming file, key, fault and remedy; nothing that is not scale · rotation passes.
    """
    return parse_calibration(calibration_bytes(path), path, image_size_px, probe)


def parse_calibration(
    data: bytes, path: Path, image_size_px: tuple[int, int] | None = None, probe: str = "Probe"
) -> Calibration:
    """The same of a file's content. path: where it lay, for what is refused."""
    if not data.strip():
        raise ConfigurationError("is empty", str(path), "Copy it again")
    if is_device_set(data):
        return _from_xml(data, path, image_size_px, probe)
    calibration = _from_toml(data, path)
    if image_size_px not in (None, calibration.image_size_px):
        what = f"image_size_px is {calibration.image_size_px}, the pictures are {image_size_px}"
        raise ConfigurationError(what, str(path), "Give the calibration that belongs to this scanner setting")
    return calibration


def is_device_set(data: bytes) -> bool:
    """Whether the content is XML, which does not state the size of the pictures, and not our TOML."""
    return data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<")


def provenance_of(data: bytes) -> dict[str, str]:
    """What the content says of its origin, our own TOML alone; empty where it cannot be read."""
    if is_device_set(data):
        return {}
    try:
        stated = tomllib.loads(text_of(data)).get("provenance", {})
    except (ValueError, RecursionError):
        return {}
    return {str(key): str(text) for key, text in stated.items()} if isinstance(stated, dict) else {}


def calibration_bytes(path: Path) -> bytes:
    """Content of a calibration file. Never waits for a writer, and opens no device. Raises ConfigurationError."""
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


def _kind_of(path: Path) -> str:
    with reading(path) as stream:
        head = stream.read(HEAD_BYTES)
    return "" if is_device_set(head) else kind_of(head)


def check_own_name(path: Path | None) -> None:
    """Raises ConfigurationError for the name of another kind of file: what is written is TOML, which PLUS and 3D
    Slicer do not read, whatever it is called. None is no file.
    """
    if path is not None and path.suffix.lower() in _OTHERS:
        remedy = "Name a .toml; then, for PLUS or 3D Slicer: probewatch calibration export"
        raise ConfigurationError(f"a calibration file of ours is TOML, not {path.suffix}", str(path), remedy)
    check_kind(path, "a calibration, TOML", ".toml")


def write_calibration(path: Path, calibration: Calibration, provenance: Mapping[str, str]) -> None:
    """Write our TOML; the old file stays until the new one is whole and on the disk.

    Of the covariance the standard deviations are kept. provenance: who, when, how, from what; free keys.
    Raises ConfigurationError where the place cannot be written.
    """
    with writing(path) as stream:
        stream.write(_toml(calibration, provenance).encode())


def image_to_probe(calibration: Calibration) -> Matrix4:
    """(4, 4) pixel → mm in the marker body's frame; exact inverse of calibration_from_image_to_probe."""
    R = calibration.rotation
    to_mm = np.diag([*(np.array(calibration.polarity) * calibration.scale_mm_per_px), 1.0])
    matrix = np.eye(4)
    matrix[:3, :3] = R.T @ to_mm
    matrix[:3, 3] = -R.T @ calibration.offset_mm - matrix[:3, :3] @ _centre_px(calibration.image_size_px)
    return matrix


def calibration_from_image_to_probe(
    matrix: Matrix4, image_size_px: tuple[int, int], polarity: tuple[int, int] = (1, 1), where: str = ""
) -> Calibration:
    """Split a PLUS ImageToProbe (4, 4), px → mm, into X, Λ and polarity.

    The rows r₁, r₂ of R_x are the unit columns 1 and 2, made orthogonal symmetrically; r₃ = r₁ × r₂. Column 3 serves
    only to notice a mirrored matrix. Raises ConfigurationError for one that is not scale · rotation.
    """
    matrix = np.asarray(matrix, dtype=np.float64)
    _check_last_row(matrix, where)
    scale = np.linalg.norm(matrix[:3, :2], axis=0)
    if not _is_of_pictures(scale):
        what = f"has scales {scale[0]:.4g} and {scale[1]:.4g} mm/px, not within 0.001 to 10"
        raise _no_calibration(what, where, _how_scaled(scale))
    _check_measured(scale, where)
    if (side_mm := float(np.max(scale * image_size_px))) > _LARGEST_MM:
        what = f"makes the picture {side_mm / 1000:.2g} m large"
        raise _no_calibration(what, where, "Is it the inverse, ProbeToImage? Invert it; its columns are mm per pixel")
    axes = matrix[:3, :2] / (scale * polarity)
    if abs(axes[:, 0] @ axes[:, 1]) > _MAX_SKEW:
        raise _no_calibration(f"is sheared: the cosine of its picture axes is {axes[:, 0] @ axes[:, 1]:.3f}", where)
    u, _, vt = np.linalg.svd(axes, full_matrices=False)
    r1, r2 = (u @ vt).T
    R = np.stack([r1, r2, np.cross(r1, r2)])
    _check_third_column(matrix[:3, 2], R[2], where)
    offset_mm = -R @ (matrix[:3, :3] @ _centre_px(image_size_px) + matrix[:3, 3])
    if (far_mm := float(np.linalg.norm(offset_mm))) > _FARTHEST_MM:
        what = f"puts the picture {far_mm / 1000:.3g} m from the marker body"
        raise _no_calibration(what, where, "Give its last column in mm, and the marker body of the probe")
    return Calibration(R, polarity, scale, offset_mm, image_size_px)


def _check_last_row(matrix: Matrix4, where: str) -> None:
    if not np.isfinite(matrix).all():
        raise _no_calibration("has a number that is not finite", where)
    if np.abs(matrix[3] - [0, 0, 0, 1]).max() > _LAST_ROW_WITHIN:
        transposed = np.abs(matrix[:, 3] - [0, 0, 0, 1]).max() <= _LAST_ROW_WITHIN
        row = " ".join(f"{value:.4g}" for value in matrix[3])
        what = f"has the last row {row}, not 0 0 0 1"
        raise _no_calibration(what, where, "It is transposed: write it row by row" if transposed else "")


def _is_of_pictures(scale: Vector) -> bool:
    return bool(_SCALE_RANGE_MM[0] <= scale.min() and scale.max() <= _SCALE_RANGE_MM[1])


def _how_scaled(scale: Vector) -> str:
    """What to do about scales that are none of a picture in mm, where another unit explains them; else empty."""
    if _is_of_pictures(scale * 1000):
        return "Is it in metres? Multiply its upper three rows by 1000"
    if scale.min() > _SCALE_RANGE_MM[1] and _is_of_pictures(1 / scale):
        return "Is it the inverse, ProbeToImage, or in µm? Invert it, or divide its upper three rows by 1000"
    if _is_of_pictures(scale / 1000):
        return "Is it in µm? Divide its upper three rows by 1000"
    return ""


def _check_measured(scale: Vector, where: str) -> None:
    """PLUS and 3D Slicer put the identity, or a rotation of unit scale, where no calibration was made yet."""
    if np.abs(scale - 1).max() < _UNIT_WITHIN:
        what = "ImageToProbe has scales of exactly 1 mm/px: the placeholder of a probe that was never calibrated"
        raise ConfigurationError(what, where, "Calibrate it (docs/recalibration.md, --solve all), or give its file")


def _check_third_column(column: Vector, normal: Vector, where: str) -> None:
    """A missing column is allowed; one that points against the normal, or far from it, is not."""
    length = np.linalg.norm(column)
    if length < 1e-9:
        return
    cosine = float(column @ normal / length)
    if cosine < 0:
        raise _no_calibration("is mirrored: its third axis points against the picture's normal", where)
    if cosine < np.sqrt(1 - 2 * _MAX_SKEW**2):
        raise _no_calibration(f"is sheared: its third axis is {np.degrees(np.arccos(cosine)):.0f}° off", where)


def _no_calibration(what: str, where: str, remedy: str = "") -> ConfigurationError:
    return ConfigurationError(f"ImageToProbe {what}", where, remedy or "Calibrate the probe again, or restore the file")


def _centre_px(image_size_px: tuple[int, int]) -> Vector:
    return np.array([(image_size_px[0] - 1) / 2, (image_size_px[1] - 1) / 2, 0.0])


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
    """As MATLAB and NumPy write one."""
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
    _check_measured(scale, str(path))
    return Calibration(nearest_rotation(R), file.polarity, scale, offset, file.image_size_px)


def _from_xml(data: bytes, path: Path, image_size_px: tuple[int, int] | None, probe: str) -> Calibration:
    if image_size_px is None:
        what = "a PLUS calibration does not state the size of the pictures"
        raise ConfigurationError(what, str(path), "Give it with pictures, or a .toml calibration")
    start, _, end = probe.rpartition("To") if "To" in probe else ("Image", "", probe)
    transforms = _xml_transforms(data, path)
    way = _way(transforms, start, end)
    twice = next((one for one, _ in way if sum(one[:2] == other[:2] for other in transforms) > 1), None)
    if not way or twice is not None:
        lack = f"no way from {start} to {end}" if twice is None else f"two transforms {twice[0]} to {twice[1]}"
        names = ", ".join(f"{one} to {other}" for one, other, _ in transforms) or "none"
        remedy = (
            "Give a device set with one probe calibration; or make a .toml of it (calibration import), which serves"
        )
        remedy += " a recording whose tool has another name; or name its transform, such as LeftImageToProbe: --probe"
        what = f"has {lack} in CoordinateDefinitions; it has {names}"
        raise ConfigurationError(what, str(path), f"{remedy}, configure --calibration-probe, or [calibration] probe")
    matrix = np.eye(4)
    for (one, other, text), turned in way:
        where = f"{path}: Transform From {one} To {other}"
        step = _sixteen(text, where)
        matrix = (_inverse(step, where) if turned else step) @ matrix
    return calibration_from_image_to_probe(matrix, image_size_px, where=f"{path}: from {start} to {end}")


def _way(transforms: Sequence[_Named], start: str, end: str) -> list[_Step]:
    """The shortest chain from one frame to the other, as PLUS composes transforms; empty where there is none. A
    transform is turned round, which PLUS does as well, only where no other way leads there.
    """
    return _shortest(transforms, start, end, (False,)) or _shortest(transforms, start, end, (False, True))


def _shortest(transforms: Sequence[_Named], start: str, end: str, allowed: tuple[bool, ...]) -> list[_Step]:
    leaving = defaultdict[str, list[_Step]](list)
    for one in transforms:
        for turned in allowed:
            leaving[one[turned]].append((one, turned))
    ways: dict[str, list[_Step]] = {start: []}
    frames = deque([start])
    while frames and end not in ways:
        at = frames.popleft()
        for step in leaving[at]:
            one, turned = step
            reached = one[not turned]
            if reached not in ways:
                ways[reached] = [*ways[at], step]
                frames.append(reached)
    return ways.get(end, [])


def _inverse(matrix: Matrix4, where: str) -> Matrix4:
    try:
        return np.asarray(np.linalg.inv(matrix))
    except np.linalg.LinAlgError:
        raise ConfigurationError("Matrix cannot be turned back", where, "Restore the file") from None


def _sixteen(text: str, where: str) -> Matrix4:
    try:
        return np.array([float(word) for word in text.split()]).reshape(4, 4)
    except ValueError:
        raise ConfigurationError("Matrix is not sixteen numbers", where, "Restore the file") from None


def _xml_transforms(data: bytes, path: Path) -> list[_Named]:
    """Every Transform."""
    try:
        root = xml_of(data)
    except NotUtf8Error as error:
        raise ConfigurationError(str(error), str(path), SAVE_AS_UTF_8) from None
    except ValueError as error:
        raise ConfigurationError(f"is not XML as PLUS writes it: {error}", str(path), "Restore the file") from error
    nodes = root.iterfind(".//CoordinateDefinitions//Transform")
    return [(node.get("From", ""), node.get("To", ""), node.get("Matrix", "")) for node in nodes]


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
