"""One descent in progress: what the warp has come to, and how sure what was seen makes it."""

from dataclasses import dataclass
from math import cos, sin

import numpy as np

from appliance.core.geometry import Array
from appliance.core.points import Look, Picture
from appliance.core.template import Template

_STRIPS = 24
_FLOOR = np.diag([0.005, 0.005, 2e-5]) ** 2
_SAMPLED = 1_000
_LEAST_SHARE, _LEAST_RESPONSE, _TINY = 0.05, 0.2, 1e-6


@dataclass(slots=True, eq=False)
class Fit:
    """State of the descent.

    u: px, alpha: rad, gain and bias of the greys. response: share of the keyframe's gradient across, down and around
    that is still there, of what the gain leaves of it.
    """

    u: tuple[float, float]
    alpha: float
    gain: float = 1.0
    bias: float = 0.0
    response: tuple[float, float, float] = (1.0, 1.0, 1.0)
    converged: bool = False
    lost: bool = False

    def step(self, level: Template, sums: list[float]) -> tuple[float, ...]:
        """Change of u_x, u_y px, α rad, gain, bias by modified residuals (Huber 1981, section 7.8): the normal matrix
        stays the template's, each direction scaled by what the weights leave of it. It ends where reweighting would.

        sums: of a `Look`.
        """
        left = [max(sums[5 + k] / level.energy[k], _LEAST_SHARE) for k in range(4)]
        step = (level.solver @ sums[:5]).tolist()
        moved = [step[k] / (left[k] * self.gain * self.response[k]) for k in range(3)]
        return *moved, step[3] / left[3], step[4] / left[3]

    def respond(self, level: Template, look: Look, picture: Picture) -> None:
        """Where the speckle has changed, its gradient is another one, and the residual answers less to a step."""
        xx, xy, yx, yy, *squares = look.respond(picture, _SAMPLED)
        c, s = cos(self.alpha), sin(self.alpha)
        across, down = c * xx + s * yx, c * yy - s * xy
        usual_x, usual_y = (2 * level.factor * self.gain * square + _TINY for square in squares)
        self.response = _share(across / usual_x), _share(down / usual_y), _share((across + down) / (usual_x + usual_y))

    def covariance(self, level: Template, look: Look) -> Array:
        """(3, 3) A⁻¹ S A⁻ᵀ ÷ (gain · response)², the sandwich of an M-estimate (Huber 1967): A = Σ ψ′ J Jᵀ, S from how
        much strips of the picture disagree.

        Neighbouring pixels of speckle and what decorrelates with them count once, whatever their number; and a picture
        in which only a part of the keyframe's contrast is left tells as much less of the shift.
        """
        A = level.points.curvature(_SAMPLED, look.weights)
        A.flat[::6] += 1e-6
        spread = np.linalg.solve(A, look.strips(_STRIPS))[:3]
        spread /= np.array(self.response)[:, None] * (self.gain * np.sqrt(1 - 5 / _STRIPS))
        return np.asarray(spread @ spread.T + _FLOOR)


def _share(found: float) -> float:
    return min(max(found, _LEAST_RESPONSE), 1.0)
