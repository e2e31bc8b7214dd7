"""Pictures of rendered tissue that has given way by a known smooth field."""

import cv2
import numpy as np

from probewatch.appliance.core.registration.keyframe import warp_matrix
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import GreyImage


def field_of(u_px: Array, alpha_rad: float, give_px: Array, shape: tuple[int, ...], aspect: float) -> Array:
    """(9,) px, as of `Registration`, of the rigid motion (u, α) and the six terms beside it."""
    y, x = (np.array(shape) - 1) / 2
    M = warp_matrix(alpha_rad, aspect) - np.eye(2)
    rigid = np.array([u_px[0], M[0, 1] * y, M[0, 0] * x, 0, u_px[1], M[1, 0] * x, M[1, 1] * y, 0, 0])
    return rigid + np.array([0, 0, *give_px[:2], 0, *give_px[2:]])


def displacement(field_px: Array, x: Array, y: Array, drag: Array) -> Array:
    """(2, …) px at x, y of −1 … 1 over the picture, and the share of the drag there."""
    a, b = field_px[:4], field_px[4:]
    along_x = a[0] + a[1] * y + a[2] * x + a[3] * drag
    return np.stack([along_x, b[0] + b[1] * x + b[2] * y + b[3] * y * y + b[4] * x * y])


def faded(depth: Array) -> Array:
    """Share of the skin's drag at a depth in units of its own, e^−depth within a hundredth: φ of docs/method.md."""
    return np.asarray((1 + depth / 4 + depth**2 / 32) ** -4.0)


def deformed(picture: GreyImage, field_px: Array, fading_px: float) -> GreyImage:
    """(h, w) in which what was at a place is now there and by the field's displacement of that place further.

    Looked up by Lanczos' kernel: a cubic one shifts what it shows by as much as is asked here.
    """
    rows, columns = np.mgrid[: picture.shape[0], : picture.shape[1]].astype(float)
    middle_y, middle_x = (np.array(picture.shape) - 1) / 2
    from_y, from_x = rows, columns
    for _ in range(8):
        drag = faded(np.maximum(from_y, 0) / fading_px)
        right, below = displacement(field_px, from_x / middle_x - 1, from_y / middle_y - 1, drag)
        from_x, from_y = columns - right, rows - below
    places = from_x.astype(np.float32), from_y.astype(np.float32)
    return np.asarray(cv2.remap(picture, *places, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REFLECT), np.uint8)
