"""How well a picture can be registered at all: Cramér–Rao bounds of (u_x, u_y, α), as RMS px over the middle 80 %.

White noise: F = Σ ∇I ∇Iᵀ / 2σ², σ from two pictures of one place. Decorrelation: the two pictures as stationary fields
with magnitude-squared coherence γ²(ω); a bin tells 2 γ²/(1 − γ²) ω² about the shift (Carter 1987 for delays), so
F = area ∫ ω ωᵀ γ²/(1 − γ²) dω/4π², with γ² estimated by Welch's method on pairs without in-plane motion. The second
is a bound for Gaussian fields, which log-compressed speckle is not: cross_spectrum.py shows how much of it is reached.
"""

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.drivers.rigid import Array
from tests.bench.scenes import PLAIN
from tests.support.rendered import moved, world

WINDOW_PX = 64
_TISSUES = (1, 2, 3, 4)
_PLACES = 2


def white_noise_px() -> float:
    """Bound set by the scanner's electronic noise and 8 bits alone."""
    seen = world(1, PLAIN, False)
    one, two = (seen.frame_at(np.eye(4), k).astype(np.float32) for k in (0, 1))
    noise = float(np.var(one - two)) / 2
    mean = (one + two) / 2
    gx, gy = cv2.Sobel(mean, cv2.CV_32F, 1, 0, scale=0.125), cv2.Sobel(mean, cv2.CV_32F, 0, 1, scale=0.125)
    y, x = np.mgrid[: mean.shape[0], : mean.shape[1]] - np.array([239.5, 319.5])[:, None, None]
    J = np.stack([gx.ravel(), gy.ravel(), (gy * x - gx * y).ravel()], axis=1).astype(np.float64)
    return _rms_px(np.asarray(np.linalg.inv(J.T @ J / (2 * noise)), np.float64))


def decorrelation_px(elevation_mm: float) -> float:
    """Bound set by what the speckle has changed over so much elevation."""
    squared = coherence(elevation_mm)
    told = squared / (1 - squared)
    omega = 2 * np.pi * np.fft.fftfreq(WINDOW_PX)
    cell = (2 * np.pi / WINDOW_PX) ** 2 / (2 * np.pi) ** 2
    area = 640 * 480
    F_x, F_y = (area * cell * float((told * part**2).sum()) for part in (omega[None, :], omega[:, None]))
    F_turn = F_x * 480**2 / 12 + F_y * 640**2 / 12
    return _rms_px(np.diag([1 / F_x, 1 / F_y, 1 / F_turn]))


@cache
def coherence(elevation_mm: float) -> Array:
    """(window, window) γ² of two pictures so far apart, by frequency as of `np.fft.fft2`."""
    auto_a, auto_b, cross, count = 0.0, 0.0, 0.0, 0
    for tissue in _TISSUES:
        for k in range(_PLACES):
            first = moved(np.eye(4), PLAIN, (20.0 * k, 0), 0, 2.0 * k - 1)
            later = moved(first, PLAIN, elevation_mm=elevation_mm)
            seen = world(tissue, PLAIN, False)
            a, b = (spectra(seen.frame_at(pose, 9 + k).astype(np.float64)) for k, pose in enumerate((first, later)))
            auto_a, auto_b = (auto + np.square(np.abs(part)).sum(axis=0) for auto, part in ((auto_a, a), (auto_b, b)))
            cross, count = cross + (a * b.conj()).sum(axis=0), count + len(a)
    found = np.abs(cross) ** 2 / (auto_a * auto_b)
    return np.asarray(np.clip(found - (1 - found) * 3 / count, 0, 0.9999))


def spectra(image: NDArray[np.floating]) -> NDArray[np.complex128]:
    """(n, window, window) of Hann windows that overlap by half, row by row."""
    parts = np.lib.stride_tricks.sliding_window_view(image, (WINDOW_PX, WINDOW_PX))
    parts = parts[:: WINDOW_PX // 2, :: WINDOW_PX // 2].reshape(-1, WINDOW_PX, WINDOW_PX)
    hann = np.outer(np.hanning(WINDOW_PX), np.hanning(WINDOW_PX))
    return np.fft.fft2((parts - parts.mean(axis=(1, 2), keepdims=True)) * hann)


def _rms_px(covariance: Array) -> float:
    reach = 0.64 * (640**2 + 480**2) / 12
    return float(np.sqrt(covariance[0, 0] + covariance[1, 1] + reach * covariance[2, 2]))
