"""One descent in progress: what the warp has come to, which points count, and how sure that makes it."""

from dataclasses import dataclass, field
from math import cos, sin

import cv2
import numpy as np

from appliance.core.geometry import Array
from appliance.core.pyramid import Array32, Bits, Picture
from appliance.core.template import Template

_TUKEY = 6.0
_LEAST_SCALE = 2.0
_LEAST_SEEN = 64
_LONGEST, _ROW = 30_000, 1_000
_STRIPS = 24
_FLOOR = (0.005, 0.005, 2e-5)
_SAMPLED, _RESPONDING = 500, 1_000
_LEAST_SHARE, _LEAST_RESPONSE, _TINY = 0.05, 0.2, 1e-6
_BESIDE = np.array([[1, -1, 0, 0], [0, 0, 1, -1]], np.float32)[..., None]


@dataclass(slots=True, eq=False)
class Fit:
    """State of the descent.

    u: px, alpha: rad, gain and bias of the greys. response: share of the keyframe's gradient across, down and around
    that is still there, of what the gain leaves of it. where to weighted: of the last look the columns and rows (2, n),
    which of them are in view, what gain and bias leave unexplained, its Tukey weights, the product of the two, (n,).
    """

    u: tuple[float, float]
    alpha: float
    gain: float = 1.0
    bias: float = 0.0
    response: tuple[float, float, float] = (1.0, 1.0, 1.0)
    converged: bool = False
    lost: bool = False
    where: Array32 = field(init=False)
    seen: Bits = field(init=False)
    residual: Array32 = field(init=False)
    weights: Array32 = field(init=False)
    weighted: Array32 = field(init=False)

    def weigh(self) -> bool:
        """Weights from the residual, their scale from its median; False where too few points are in view."""
        if np.count_nonzero(self.seen) < _LEAST_SEEN:
            return False
        few = np.abs(self.residual[:: max(self.seen.size // _SAMPLED, 1)])
        scale = max(1.4826 * float(np.partition(few, few.size // 2)[few.size // 2]), _LEAST_SCALE)
        ratio = self.residual * np.float32(1 / (_TUKEY * scale))
        ratio *= ratio
        np.subtract(1, ratio, out=ratio)
        np.maximum(ratio, 0, out=ratio)
        ratio *= ratio
        ratio *= self.seen
        self.weights = ratio
        self.weighted = ratio * self.residual
        return True

    def step(self, level: Template) -> tuple[float, ...]:
        """Change of u_x, u_y px, α rad, gain, bias by modified residuals (Huber 1981, section 7.8): the normal matrix
        stays the template's, each direction scaled by what the weights leave of it. It ends where reweighting would."""
        left = [max(share, _LEAST_SHARE) for share in (level.shares @ self.weights).tolist()]
        step = (level.solver @ (level.design @ self.weighted)).tolist()
        moved = [step[k] / (left[k] * self.gain * self.response[k]) for k in range(3)]
        return *moved, step[3] / left[3], step[4] / left[3]

    def respond(self, level: Template, image: Picture) -> None:
        """Where the speckle has changed, its gradient is another one, and the residual answers less to a step."""
        few = np.s_[:: max(self.seen.size // _RESPONDING, 1)]
        looks = interpolated(image, self.where[:, None, few] + _BESIDE)
        slope = looks[::2] - looks[1::2]
        expected, weights = level.design[:2, few], self.weights[few]
        found = ((slope * weights) @ expected.T).tolist()
        usual = (2 * level.factor * self.gain * (np.square(expected) @ weights)).tolist()
        c, s = cos(self.alpha), sin(self.alpha)
        across, down = c * found[0][0] + s * found[1][0], c * found[1][1] - s * found[0][1]
        shares = across / (usual[0] + _TINY), down / (usual[1] + _TINY), (across + down) / (sum(usual) + _TINY)
        self.response = tuple(min(max(share, _LEAST_RESPONSE), 1.0) for share in shares)

    def covariance(self, level: Template) -> Array:
        """(3, 3) A⁻¹ S A⁻ᵀ ÷ (gain · response)², the sandwich of an M-estimate (Huber 1967): A = Σ ψ′ J Jᵀ, S from how
        much strips of the picture disagree.

        Neighbouring pixels of speckle and what decorrelates with them count once, whatever their number; and a picture
        in which only a part of the keyframe's contrast is left tells as much less of the shift.
        """
        used = self.residual.size - self.residual.size % _STRIPS
        score = (level.design[:, :used] * self.weighted[:used]).reshape(5 * _STRIPS, -1).sum(axis=1)
        few = np.s_[:: max(self.residual.size // _RESPONDING, 1)]
        design, root = level.design[:, few], np.sqrt(self.weights[few])
        A = ((design * (root * (5 * root - 4))) @ design.T).astype(np.float64) * (self.residual.size / root.size)
        A.flat[::6] += 1e-6
        spread = np.linalg.inv(A)[:3] @ score.reshape(5, _STRIPS)
        spread /= self.gain * np.array(self.response)[:, None]
        found = spread @ spread.T * (_STRIPS / (_STRIPS - 5.0))
        return np.asarray(found + np.diag(_FLOOR) ** 2, dtype=np.float64)


def looked_up(image: Picture, where: Array32) -> Array32:
    """(n,) grey values of the picture at (2, n) columns and rows; in rows, because OpenCV's pictures end at 32767."""
    n = where.shape[1]
    long = n > _LONGEST
    rows = np.pad(where, ((0, 0), (0, -n % _ROW))).reshape(2, -1, _ROW) if long else where[:, None]
    return interpolated(image, rows).reshape(-1)[:n]


def interpolated(image: Picture, where: Array32) -> Array32:
    """(k, n) grey values of the picture at (2, k, n) columns and rows; beyond its edge those of the edge."""
    x, y = where
    return np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), dtype=np.float32)


def inside(where: Array32, image: Picture) -> Bits:
    """(..., n) which of the columns and rows (2, ..., n) are in the picture."""
    x, y = where
    return np.asarray((x >= 0) & (y >= 0) & (x <= image.shape[1] - 1) & (y <= image.shape[0] - 1))
