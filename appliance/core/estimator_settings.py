"""Defines the settings of the estimator's pipeline. When they change, a new pipeline is built from them."""

from dataclasses import dataclass, field

from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration
from probewatch.drivers.samples import Matrix4


@dataclass(frozen=True, slots=True)
class EstimatorSettings:
    """Holds everything that the pipeline is built from.

    `generation` numbers the reference calibration; every report repeats it. `stale_ns` is how long a tracker may repeat
    one pose while the picture moves before it counts as stale. `relative_pose` is the (4, 4) pose of the second marker
    body in the first one's frame, mm, as an earlier pipeline with this reference learned it
    (appliance.core.detectors.witness); None where none did.
    """

    generation: int
    reference: Calibration
    limits: Limits
    stale_ns: int
    relative_pose: Matrix4 | None = field(default=None, compare=False)
