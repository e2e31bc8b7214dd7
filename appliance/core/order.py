"""What a line is made with. Whoever gives a new order gets a new line."""

from dataclasses import dataclass

from appliance.limits import Limits
from appliance.types import Calibration


@dataclass(frozen=True, slots=True)
class Order:
    """Work with this reference from now on. generation marks what is said of it.

    stale_ns: how long a tracker may repeat one pose while the picture moves.
    """

    generation: int
    reference: Calibration
    limits: Limits
    stale_ns: int
