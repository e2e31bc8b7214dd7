"""Converts a calibration to the matrix ImageToProbe of PLUS and back; what is no calibration is refused.

ImageToProbe: pixel (column, row, 0, 1) → mm in the frame of the probe's marker body, which is X⁻¹ · diag(s_x λ_x, s_y
λ_y, 1) · (shift of the origin from the picture's corner to its centre), s the polarity.
"""

import numpy as np

from probewatch.appliance.types import Calibration, Vector
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.samples import Matrix4

_UNIT_WITHIN = 1e-6
"""mm/px from 1 within which both scales were typed, not measured: calibrations keep six digits or more."""

_MAX_SKEW = 0.05
"""Largest cosine between the picture's axes: freehand PLUS calibrations come to about 0.02."""

_LAST_ROW_WITHIN = 1e-6
"""Tolerance of the last row, 0 0 0 1, which PLUS prints exactly. More takes another matrix for a calibration."""
SCALE_RANGE_MM = (1e-3, 10.0)
"""mm per px. Pictures of 1 to 30 cm in 200 to 2000 px have 0.005 to 1.5; metres and micrometres for mm are outside."""

_LARGEST_MM = 1000.0
"""mm, side of a picture: scanners show up to some 300 mm of depth. An inverse of 0.3 mm/px has 3.2: 640 px make 2 m."""

FARTHEST_MM = 2000.0
"""mm from the marker body, which is on the probe, to the picture's centre: public device sets have up to some 150 mm.
More is in another unit, or of another body; less might refuse a long holder.
"""


def image_to_probe(calibration: Calibration) -> Matrix4:
    """Returns (4, 4) pixel → mm in the marker body's frame; exact inverse of calibration_from_image_to_probe."""
    R = calibration.rotation
    to_mm = np.diag([*(np.array(calibration.polarity) * calibration.scale_mm_per_px), 1.0])
    matrix = np.eye(4)
    matrix[:3, :3] = R.T @ to_mm
    matrix[:3, 3] = -R.T @ calibration.offset_mm - matrix[:3, :3] @ _centre_px(calibration.image_size_px)
    return matrix


def calibration_from_image_to_probe(
    matrix: Matrix4, image_size_px: tuple[int, int], polarity: tuple[int, int] = (1, 1), where: str = ""
) -> Calibration:
    """Splits a PLUS ImageToProbe (4, 4), px → mm, into X, Λ and polarity.

    The rows r₁, r₂ of R_x are the unit columns 1 and 2, orthogonalised symmetrically; r₃ = r₁ × r₂. Column 3 serves
    only to detect a mirrored matrix. Raises ConfigurationError for a matrix that is not scale · rotation.
    """
    matrix = np.asarray(matrix, dtype=np.float64)
    _check_last_row(matrix, where)
    scale = np.linalg.norm(matrix[:3, :2], axis=0)
    if not _is_of_pictures(scale):
        what = f"has scales {scale[0]:.4g} and {scale[1]:.4g} mm/px, not within 0.001 to 10"
        raise _no_calibration(what, where, _how_scaled(scale))
    check_measured(scale, where)
    if (side_mm := float(np.max(scale * image_size_px))) > _LARGEST_MM:
        what = f"makes the picture {side_mm / 1000:.2g} m large"
        raise _no_calibration(what, where, "Is it the inverse, ProbeToImage? Invert it; its columns are mm per pixel")
    axes = matrix[:3, :2] / (scale * polarity)
    if abs(axes[:, 0] @ axes[:, 1]) > _MAX_SKEW:
        raise _no_calibration(f"is sheared: the cosine of its picture axes is {axes[:, 0] @ axes[:, 1]:.3f}", where)
    # u · vᵀ is the orthonormal pair nearest to both axes.
    u, _, vt = np.linalg.svd(axes, full_matrices=False)
    r1, r2 = (u @ vt).T
    R = np.stack([r1, r2, np.cross(r1, r2)])
    _check_third_column(matrix[:3, 2], R[2], where)
    # X maps the picture's centre to 0, so its translation is −R · (centre in the marker body's frame).
    offset_mm = -R @ (matrix[:3, :3] @ _centre_px(image_size_px) + matrix[:3, 3])
    if (far_mm := float(np.linalg.norm(offset_mm))) > FARTHEST_MM:
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
    return bool(SCALE_RANGE_MM[0] <= scale.min() and scale.max() <= SCALE_RANGE_MM[1])


def _how_scaled(scale: Vector) -> str:
    """Returns the remedy for scales that no picture in mm has, where another unit explains them; else empty."""
    if _is_of_pictures(scale * 1000):
        return "Is it in metres? Multiply its upper three rows by 1000"
    if scale.min() > SCALE_RANGE_MM[1] and _is_of_pictures(1 / scale):
        return "Is it the inverse, ProbeToImage, or in µm? Invert it, or divide its upper three rows by 1000"
    if _is_of_pictures(scale / 1000):
        return "Is it in µm? Divide its upper three rows by 1000"
    return ""


def check_measured(scale: Vector, where: str) -> None:
    """Raises ConfigurationError for a placeholder: PLUS and 3D Slicer write the identity, or a rotation of unit scale,
    where no calibration has been made yet.
    """
    if np.abs(scale - 1).max() < _UNIT_WITHIN:
        what = "ImageToProbe has scales of exactly 1 mm/px: the placeholder of a probe that was never calibrated"
        raise ConfigurationError(what, where, "Calibrate it (docs/recalibration.md, --solve all), or give its file")


def _check_third_column(column: Vector, normal: Vector, where: str) -> None:
    """Refuses a third column that points against the normal, or far from it; a missing column is allowed."""
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
