"""Exchanges calibrations with other programs: PLUS toolkit device sets, and ITK's text transforms, read by 3D Slicer.

Both hold ImageToProbe, pixel (column, row, 0, 1) from the corner → mm in the marker body's frame; neither states the
size of the pictures. A `.tfm` of Slicer holds the inverse, from the parent's frame, with x and y negated: ITK maps
points of the target to the source, and counts towards the left and the back (LPS) where Slicer counts to the right and
the front (RAS).
"""

from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from probewatch.appliance.storage.calibration_file import ITK_BEGINS, calibration_bytes
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe, image_to_probe
from probewatch.appliance.types import Calibration, Vector
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.markup import numbers_of
from probewatch.drivers.samples import Matrix4

_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
"""Maps Slicer's axes (right, anterior, superior) to ITK's (left, posterior, superior), and back."""
_MAGIC = ITK_BEGINS.decode()
_AFFINE = ("AffineTransform_double_3_3", "MatrixOffsetTransformBase_double_3_3")
"""Classes of ITK that hold one linear transform."""
_MOST_BYTES = 20_000
"""Bytes. A linear transform has 500. More is not one, and reading it would waste time."""


def device_set_text(calibration: Calibration, probe: str = "Probe") -> str:
    """Returns a PLUS device set with the one transform Image → `probe`; every number is exact."""
    rows = "\n        ".join(" ".join(repr(float(value)) for value in row) for row in image_to_probe(calibration))
    return (
        '<PlusConfiguration version="2.1">\n  <CoordinateDefinitions>\n'
        f'    <Transform From="Image" To={quoteattr(probe)}\n      Matrix="\n        {rows}"/>\n'
        "  </CoordinateDefinitions>\n</PlusConfiguration>\n"
    )


def itk_text(calibration: Calibration) -> str:
    """Returns an ITK text transform; loaded by 3D Slicer, its node maps pixels to the marker body's frame."""
    back = _LPS @ np.linalg.inv(image_to_probe(calibration)) @ _LPS
    numbers = " ".join(repr(float(value)) for value in [*back[:3, :3].ravel(), *back[:3, 3]])
    return f"{_MAGIC} V1.0\n#Transform 0\nTransform: {_AFFINE[0]}\nParameters: {numbers}\nFixedParameters: 0 0 0\n"


def read_itk(path: Path, image_size_px: tuple[int, int], polarity: tuple[int, int] = (1, 1)) -> Calibration:
    """Returns the calibration in an ITK text transform. image_size_px: (width, height). Raises ConfigurationError."""
    data = calibration_bytes(path)
    if len(data) > _MOST_BYTES or not data.startswith(_MAGIC.encode()):
        raise ConfigurationError("is not an ITK text transform", str(path), "Save it from 3D Slicer as .tfm")
    matrix = _matrix(data.decode("utf-8", "replace"), str(path))
    return calibration_from_image_to_probe(matrix, image_size_px, polarity, str(path))


def _matrix(text: str, where: str) -> Matrix4:
    """Returns ImageToProbe. Raises ConfigurationError unless there is one linear, invertible transform of finite
    numbers.
    """
    fields: dict[str, list[str]] = {}
    for line in text.splitlines():
        name, colon, value = line.partition(":")
        if colon and not line.startswith("#"):
            fields.setdefault(name.strip(), []).append(value.strip())
    kinds = fields.get("Transform", [])
    if len(kinds) != 1 or kinds[0] not in _AFFINE:
        what = f"holds {', '.join(kinds)[:80] or 'no transform'}, not one linear transform"
        raise ConfigurationError(what, where, "Save the transform alone, and linear")
    back, centre = np.eye(4), _numbers(fields, "FixedParameters", 3, where)
    values = _numbers(fields, "Parameters", 12, where)
    back[:3, :3] = values[:9].reshape(3, 3)
    # ITK rotates about a centre: x → M (x − c) + c + t.
    back[:3, 3] = values[9:] + centre - back[:3, :3] @ centre
    try:
        matrix = np.linalg.inv(_LPS @ back @ _LPS)
    except np.linalg.LinAlgError:
        matrix = np.full((4, 4), np.nan)
    if not np.all(np.isfinite(matrix)):
        raise ConfigurationError("its matrix cannot be turned back", where, "Restore the file")
    return np.asarray(matrix)


def _numbers(fields: dict[str, list[str]], name: str, count: int, where: str) -> Vector:
    try:
        (text,) = fields.get(name, [])
        values = np.array(numbers_of(text))
    except ValueError:
        values = np.empty(0)
    if values.shape != (count,) or not np.all(np.isfinite(values)):
        raise ConfigurationError(f"{name} are not {count} numbers", where, "Restore the file")
    return values
