"""What the line of the estimator is made with. New settings make a new line."""

from dataclasses import dataclass, field

from appliance.limits import Limits
from appliance.types import Calibration
from drivers.samples import Matrix4


@dataclass(frozen=True, slots=True)
class EstimatorSettings:
    """Settings of a line. generation: of the reference; every report carries it.

    stale_ns: how long a tracker may repeat one pose while the picture moves. relative_pose: (4, 4) second marker body →
    first, mm, as an earlier line of this reference learned it (appliance.core.detectors.witness); None where none did.
    """

    generation: int
    reference: Calibration
    limits: Limits
    stale_ns: int
    relative_pose: Matrix4 | None = field(default=None, compare=False)
