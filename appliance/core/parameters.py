"""Holds the one table of what motion measures: the unit in which people read it, its limit, and what the model leaves
out.

The nine quantities are the parameters of X and the latency; θ of a solution has them in rad, relative, mm and s.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees

import numpy as np

from probewatch.appliance.limits import Limits
from probewatch.appliance.types import PARAMETERS, Fault, Vector


@dataclass(frozen=True, slots=True)
class Quantity:
    """Describes one class of parameters.

    unit: that of checks and texts. per_unit: how many of it are one rad, one relative, one mm or one s. limit_key: its
    field of Limits, in that unit. left_out: standard deviation, in that unit, of what the model of the motion leaves
    out, however long the motion lasts, in tissue that may give way; left_out_rigid: the same in tissue that was shown
    not to.
    """

    unit: str
    per_unit: float
    limit_key: str
    left_out: float
    left_out_rigid: float

    def limit(self, limits: Limits) -> float:
        """Returns the limit, in `unit`."""
        return float(getattr(limits, self.limit_key))


QUANTITIES: Mapping[Fault, Quantity] = {
    Fault.ROTATION: Quantity("deg", degrees(1.0), "rotation_deg", 0.25, 0.1),
    Fault.SCALE: Quantity("%", 100.0, "scale_percent", 0.3, 0.25),
    Fault.OFFSET: Quantity("mm", 1.0, "offset_mm", 0.5, 0.2),
    Fault.LATENCY: Quantity("ms", 1000.0, "latency_ms", 5.0, 5.0),
}
"""Quantities by the class that a check of theirs names. The model leaves out registration that shortens quick motion,
tissue that slants at one place, and stamps of pictures and poses that waver together. For X this was measured as what
the solver's sigmas lacked: in soft tissue on seed 1 of every session of `probewatch study`; in rigid tissue on gestures
of 8 s (ten seeds: errors of .7 to 1.0 of sigma, with the constants for soft tissue .16 to .88), and compared with
sweeps, search, shadows, layers, half a face and a convex probe (1 to 3 seeds each: .4 to 1.4, an offset between two
ribs 1.75). For the latency it was not measured. More withholds OK and FAULT from what is near its limit, less lets
chance look like a fault.
"""


def class_of(name: str) -> Fault:
    """Returns the fault class of one of MEASURED."""
    return Fault(name.split("-", 1)[0])


MEASURED = (*PARAMETERS, Fault.LATENCY.value)
"""Names of the checks, in the order of θ."""
BREATHED = frozenset({"scale-axial"})
"""Names of the checks that breathing can falsify until it has been learned."""
CLASSES = tuple(class_of(name) for name in MEASURED)
PER_UNIT: Vector = np.array([QUANTITIES[fault].per_unit for fault in CLASSES])
"""Number of deg, %, mm and ms in one rad, relative, mm and s, (9,)."""
LEFT_OUT: Vector = np.array([QUANTITIES[fault].left_out for fault in CLASSES]) / PER_UNIT
"""Standard deviations of what the model leaves out, (9,) rad, relative, mm and s, in tissue that may give way. What is
accused, and what may change unseen, is given as much room in any tissue.
"""
_DEFAULT = Limits()


def never_shown(limits: Limits, rigid: bool) -> tuple[Fault, ...]:
    """Returns the classes of which the contact requires a parameter that no motion can show within its limit, in rigid
    tissue or in tissue that may give way, because what the model leaves out fills the limit by itself.
    """
    asked = {class_of(name) for name in limits.required_age_s.names if name in MEASURED}
    added = {fault: one.left_out_rigid if rigid else one.left_out for fault, one in QUANTITIES.items()}
    sigmas = limits.confidence_sigma
    return tuple(f for f, one in QUANTITIES.items() if f in asked and sigmas * added[f] >= one.limit(limits))


def named_from(fault: Fault, limits: Limits, rigid: bool) -> float:
    """Returns the limit, in `unit`, beyond which motion names a fault: in tissue that may give way, at least that of
    the default profile. For tighter ones the model of such tissue is not certain enough: over foam that follows by .1 a
    healthy cart was accused of an elevational offset of +8.6 ± 2.1 mm. What lies between withholds the OK.
    """
    limit = QUANTITIES[fault].limit(limits)
    return limit if rigid or fault is Fault.LATENCY else max(limit, QUANTITIES[fault].limit(_DEFAULT))


def limit_of_each(limits: Limits) -> Vector:
    """Returns the limits, (9,) rad, relative, mm and s."""
    return np.array([QUANTITIES[fault].limit(limits) for fault in CLASSES]) / PER_UNIT
