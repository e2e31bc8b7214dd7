"""How much of the decorrelation bound anybody reaches: the estimator for which it is written, with every advantage.

Generalised cross-correlation with maximum-likelihood weights γ²/((1 − γ²)|S|) (Knapp and Carter 1976, the estimator of
the delay that attains Carter's bound in Gaussian fields), over windows of the whole picture. It is told the coherence
and starts at the truth, so nothing but the speckle itself can keep it from the bound.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.registration.pyramid import centre_px
from probewatch.drivers.rigid import Array
from tests.bench.bounds import WINDOW_PX, coherence, spectra
from tests.bench.scenes import Scene, pairs
from tests.support.rendered import Warp, rms_px

_ROUNDS = 3
_ACROSS = 2 * np.pi * np.fft.fftfreq(WINDOW_PX)
_DOWN = _ACROSS[:, None]
_LOST_PX = 2.0


def reached_px(scene: Scene, count: int) -> float:
    """RMS error px over `count` pairs, without those that were lost."""
    told = coherence(scene.elevation_mm)
    errors = []
    for pair in pairs(scene, count):
        before, after = pair.before.astype(np.float32), pair.after.astype(np.float32)
        found = pair.truth
        for _ in range(_ROUNDS):
            found = closer(before, after, found, told / (1 - told))
        errors.append(rms_px(found, pair.truth, scene.settings))
    kept = [error for error in errors if error <= _LOST_PX]
    return float(np.sqrt(np.mean(np.square(kept)))) if kept else float("inf")


def closer(before: NDArray[np.float32], after: NDArray[np.float32], warp: Warp, told: Array) -> Warp:
    """One step of Gauss–Newton on the phases of the cross-spectra. told: γ²/(1 − γ²), (window, window)."""
    height, width = before.shape
    c, s = np.cos(warp[1]), np.sin(warp[1])
    turn, centre = np.array([[c, -s], [s, c]]), centre_px(width, height)
    place = np.column_stack([turn, warp[0] + centre - turn @ centre])
    flags = cv2.INTER_LANCZOS4 | cv2.WARP_INVERSE_MAP
    back = cv2.warpAffine(after, place, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    cross = spectra(np.asarray(back, np.float32)) * spectra(before).conj()
    weighted = cross * (told / np.maximum(np.abs(cross.mean(axis=0)), 1e-9))
    score = np.stack([-(weighted.imag * omega).sum(axis=(1, 2)) for omega in (_ACROSS, _DOWN)])
    curve = weighted.real.mean(axis=0)
    H = np.array([[(curve * a * b).sum() for a in (_ACROSS, _DOWN)] for b in (_ACROSS, _DOWN)])
    x, y = _middles(height, width) - centre[:, None]
    J = np.stack([[np.ones_like(x), np.zeros_like(x), -y], [np.zeros_like(x), np.ones_like(x), x]])
    normal = np.einsum("akn,ab,bln->kl", J, H, J)
    step = np.linalg.solve(normal, np.einsum("akn,an->k", J, score))
    return warp[0] + turn @ step[:2], warp[1] + float(step[2])


def _middles(height: int, width: int) -> Array:
    """(2, n) columns and rows of the middles of the same windows."""
    rows, columns = (np.arange(0, side - WINDOW_PX + 1, WINDOW_PX // 2) for side in (height, width))
    y, x = np.meshgrid(rows, columns, indexing="ij")
    return np.stack([x.ravel(), y.ravel()]).astype(np.float64) + (WINDOW_PX - 1) / 2
