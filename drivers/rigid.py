"""Computes with rigid motions as arrays: rotations, quaternions, inverses, interpolation of poses. All is pure."""

from math import atan2, copysign, cos, hypot, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from probewatch.drivers.samples import Matrix4

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_IDENTITY = np.eye(3)
_TINY = 1e-300
"""rad². Keeps a rotation by zero from 0 ÷ 0. Its root, 1e-150 rad, is lost in rounding beside any other angle."""


def skew(v: Array) -> Array:
    """Returns the cross-product matrices [v]× of vectors, (…, 3) → (…, 3, 3)."""
    matrix = np.zeros((*v.shape, 3))
    matrix[..., 0, 1], matrix[..., 0, 2] = -v[..., 2], v[..., 1]
    matrix[..., 1, 0], matrix[..., 1, 2] = v[..., 2], -v[..., 0]
    matrix[..., 2, 0], matrix[..., 2, 1] = -v[..., 1], v[..., 0]
    return matrix


def rotation_from_vector(rotvec_rad: Array) -> Array:
    """Computes rotation matrices from rotation vectors by Rodrigues' formula, (…, 3) rad → (…, 3, 3); exact to machine
    precision at zero.
    """
    if rotvec_rad.ndim == 1:
        angle_rad = hypot(*(vector := rotvec_rad.tolist()))
        share = sin(angle_rad / 2) / angle_rad if angle_rad else 0.5
        return np.array(_rotation_rows(cos(angle_rad / 2), *[share * part for part in vector]))
    K = skew(rotvec_rad)
    half = 0.5 * np.sqrt(np.sum(np.square(rotvec_rad), axis=-1) + _TINY)[..., None, None]
    first = np.sin(2 * half) / (2 * half)
    second = 0.5 * (np.sin(half) / half) ** 2
    return np.asarray(_IDENTITY + first * K + second * (K @ K), dtype=np.float64)


def vector_from_rotation(R: Array) -> Array:
    """Computes rotation vectors from rotation matrices, (…, 3, 3) → (…, 3) rad, with angles in [0, π]. It goes through
    the quaternion, so it is accurate near 0 and near π.
    """
    if R.ndim == 2:
        w, *xyz = _quaternion(*R.ravel().tolist())
        length = hypot(*xyz)
        return np.array(xyz) * (2 * atan2(length, w) / length if length > 1e-12 else 2.0)
    q = quaternion_from_rotation(R)
    vector_norm = np.linalg.norm(q[..., 1:], axis=-1)
    angle = 2 * np.arctan2(vector_norm, q[..., 0])
    factor = np.where(vector_norm > 1e-12, angle / np.maximum(vector_norm, 1e-300), 2.0)
    return np.asarray(q[..., 1:] * factor[..., None], dtype=np.float64)


def angle_from_rotation(R: Array) -> float:
    """Computes the angle of a rotation, (3, 3) → rad in [0, π], from its sine and cosine, so it is accurate near 0."""
    m = R.tolist()
    axis = m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]
    return atan2(hypot(*axis), m[0][0] + m[1][1] + m[2][2] - 1)


def quaternion_from_rotation(R: Array) -> Array:
    """Computes unit quaternions from rotation matrices, (…, 3, 3) → (…, 4) as (w, x, y, z), w >= 0.

    The products of the quaternion with each of its four parts are linear in R. The longest of the four is taken, since
    it suffers no cancellation (Shepperd 1978).
    """
    m = np.asarray(R, dtype=np.float64)
    if m.ndim == 2:
        return np.array(_quaternion(*m.ravel().tolist()))
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    products = np.empty((*m.shape[:-2], 4, 4))
    products[..., 0, 0], products[..., 1, 1] = 1 + xx + yy + zz, 1 + xx - yy - zz
    products[..., 2, 2], products[..., 3, 3] = 1 - xx + yy - zz, 1 - xx - yy + zz
    for (i, j), differ in zip(((2, 1), (0, 2), (1, 0)), (1, 2, 3), strict=True):
        products[..., 0, differ] = products[..., differ, 0] = m[..., i, j] - m[..., j, i]
    for i, j in ((0, 1), (0, 2), (1, 2)):
        products[..., i + 1, j + 1] = products[..., j + 1, i + 1] = m[..., i, j] + m[..., j, i]
    longest = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(products, longest[..., None, None], axis=-2)[..., 0, :]
    q /= np.copysign(np.sqrt(np.sum(np.square(q), axis=-1)), q[..., 0])[..., None]
    return np.asarray(q)


def _quaternion(
    xx: float, xy: float, xz: float, yx: float, yy: float, yz: float, zx: float, zy: float, zz: float
) -> tuple[float, ...]:
    """Does the same as `quaternion_from_rotation` for a single matrix, given row by row, some twenty times as quickly
    as with arrays.
    """
    w, x, y, z = 1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz
    longest = max(w, x, y, z)
    if longest == w:
        q = w, zy - yz, xz - zx, yx - xy
    elif longest == x:
        q = zy - yz, x, xy + yx, xz + zx
    elif longest == y:
        q = xz - zx, xy + yx, y, yz + zy
    else:
        q = yx - xy, xz + zx, yz + zy, z
    length = copysign(hypot(*q), q[0])
    return tuple(part / length for part in q)


def rotation_from_quaternion(q: Array) -> Array:
    """Computes rotation matrices from unit quaternions (w, x, y, z), (…, 4) → (…, 3, 3)."""
    rows = _rotation_rows(*np.moveaxis(q, -1, 0))
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def pose_matrix(quaternion: tuple[float, float, float, float], translation_mm: tuple[float, float, float]) -> Matrix4:
    """Returns the transform (4, 4), mm. quaternion: (w, x, y, z) of any length but 0; the rotation is orthonormal
    whatever the rounding of the quaternion.
    """
    length = hypot(*quaternion)
    x_row, y_row, z_row = _rotation_rows(*[part / length for part in quaternion])
    x_mm, y_mm, z_mm = translation_mm
    return np.array(((*x_row, x_mm), (*y_row, y_mm), (*z_row, z_mm), (0.0, 0.0, 0.0, 1.0)))


def _rotation_rows(w: Any, x: Any, y: Any, z: Any) -> tuple[tuple[Any, Any, Any], ...]:
    """Returns the rotation matrix, by rows, of a unit quaternion of numbers, or of arrays of the same shape."""
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def nearest_rotation(M: Array) -> Array:
    """Returns the proper rotation closest to M (3, 3) in the Frobenius norm (polar decomposition)."""
    u, _, vt = np.linalg.svd(M)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt, dtype=np.float64)


def rigid(R: Array, t: Array) -> Array:
    """Assembles transforms from rotations and translations, (…, 3, 3), (…, 3) → (…, 4, 4)."""
    many = () if R.ndim == 2 and t.ndim == 1 else np.broadcast_shapes(R.shape[:-2], t.shape[:-1])
    matrix = np.zeros((*many, 4, 4))
    matrix[..., :3, :3], matrix[..., :3, 3], matrix[..., 3, 3] = R, t, 1.0
    return matrix


def inverse(T: Array) -> Array:
    """Inverts rigid transforms, (…, 4, 4)."""
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    return rigid(Rt, -(Rt @ T[..., :3, 3:])[..., 0])


def seen_from(reference: Matrix4, probe: Matrix4) -> Matrix4:
    """Computes the transform (4, 4) probe → reference from both in the tracker's frame: reference⁻¹ probe."""
    moved = probe.copy()
    moved[:3, 3] -= reference[:3, 3]
    relative: Matrix4 = np.eye(4)
    relative[:3] = reference[:3, :3].T @ moved[:3]
    return relative


def interpolate(first: Array, second: Array, fraction: float) -> Array:
    """Interpolates between two rigid poses (4, 4): the translation linearly, the rotation along the shortest arc.
    fraction: in [0, 1].
    """
    turn = vector_from_rotation(first[:3, :3].T @ second[:3, :3])
    R = first[:3, :3] @ rotation_from_vector(fraction * turn)
    return rigid(R, (1 - fraction) * first[:3, 3] + fraction * second[:3, 3])
