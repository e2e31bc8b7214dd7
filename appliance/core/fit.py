"""One descent in progress: what the warp has come to, which points count, and how sure that makes it."""

from dataclasses import dataclass, field

import cv2
import numpy as np

from appliance.core.template import Array, Array32, Bits, Template
from drivers.samples import GreyImage

_TUKEY = 4.685
_LEAST_SCALE = 2.0
_LEAST_SEEN = 64
_LONGEST, _ROW = 30_000, 1_000
_STRIPS = 24
_FLOOR = (0.005, 0.005, 2e-5)
_SAMPLED = 2_000


@dataclass(slots=True, eq=False)
class Fit:
    """State of the descent: warp, gain and bias of the greys, Tukey weights (n,), weighted design (5, n) and the
    inverse (5, 5) of its normal matrix, which a part of the points gives well enough: it steers, it does not judge."""

    u: Array
    alpha: float
    gain: float = 1.0
    bias: float = 0.0
    converged: bool = False
    lost: bool = False
    where: Array32 = field(init=False)
    residual: Array32 = field(init=False)
    weights: Array32 = field(init=False)
    weighted: Array32 = field(init=False)
    solver: Array = field(init=False)

    def weigh(self, level: Template, seen: Bits) -> bool:
        """Weights from the residual, their scale from its median; False where too few points are in view."""
        if np.count_nonzero(seen) < _LEAST_SEEN:
            return False
        few = np.abs(self.residual[:: max(seen.size // _SAMPLED, 1)])
        scale = max(1.4826 * float(np.partition(few, few.size // 2)[few.size // 2]), _LEAST_SCALE)
        ratio = self.residual * np.float32(1 / (_TUKEY * scale))
        ratio *= ratio
        np.subtract(1, ratio, out=ratio)
        self.weights = np.square(np.maximum(ratio, 0, out=ratio), out=ratio)
        self.weights *= seen
        self.weighted = level.design * self.weights
        H = (self.weighted[:, :: level.thin] @ level.few).astype(np.float64) * (level.grey.size / len(level.few))
        H.flat[::6] = H.diagonal() * (1 + 1e-9) + 1e-9
        self.solver = np.asarray(np.linalg.inv(H), dtype=np.float64)
        return True

    def covariance(self, level: Template) -> Array:
        """(3, 3) A⁻¹ S A⁻ᵀ ÷ gain², the sandwich of an M-estimate (Huber 1967): A = Σ ψ′ J Jᵀ, S from how much strips
        of the picture disagree.

        Neighbouring pixels of speckle and what decorrelates with them count once, whatever their number; and a picture
        in which only a part of the keyframe's contrast is left tells as much less of the shift.
        """
        used = self.residual.size - self.residual.size % _STRIPS
        strips = self.weighted[:, :used].reshape(5, _STRIPS, -1).swapaxes(0, 1)
        score = (strips @ self.residual[:used].reshape(_STRIPS, -1, 1))[:, :, 0]
        root = np.sqrt(self.weights[:: level.thin])
        A = (level.design[:, :: level.thin] * (root * (5 * root - 4))) @ level.few * (level.grey.size / len(level.few))
        spread = np.linalg.pinv(A.astype(np.float64))[:3] @ score.T
        found = spread @ spread.T * (_STRIPS / (_STRIPS - 5.0)) / self.gain**2
        return np.asarray(found + np.diag(_FLOOR) ** 2, dtype=np.float64)


def looked_up(image: GreyImage, where: Array32) -> Array32:
    """(n,) grey values of the picture at (2, n) columns and rows; in rows, because OpenCV's pictures end at 32767."""
    n = where.shape[1]
    long = n > _LONGEST
    x, y = np.pad(where, ((0, 0), (0, -n % _ROW))).reshape(2, -1, _ROW) if long else where[:, None]
    found = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found.reshape(-1)[:n], dtype=np.float32)


def inside(where: Array32, image: GreyImage) -> Bits:
    """(..., n) which of the columns and rows (2, ..., n) are in the picture."""
    x, y = where
    return np.asarray((x >= 0) & (y >= 0) & (x <= image.shape[1] - 1) & (y <= image.shape[0] - 1))
