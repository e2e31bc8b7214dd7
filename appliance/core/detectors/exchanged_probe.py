"""Sees that probe and marker body are not the pair that the calibration is of: body and picture are wrong at once.

A clamp that gives way turns and slides the body and leaves the picture as it is; a new depth leaves the body. Where
rotation, offset and scale are all beyond their limits, it is the likeliest that another probe is held, that the body
sits on another probe, or that the file is another probe's.
"""

from collections.abc import Callable, Sequence
from math import isfinite

from probewatch.appliance.core.detectors.detector import Detector
from probewatch.appliance.core.parameters import QUANTITIES
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Check, Fault, VerdictKind

REPORTS_FAULTS = (Fault.EXCHANGED_PROBE,)

_CLASSES = (Fault.ROTATION, Fault.OFFSET, Fault.SCALE)
"""All three: rotation and offset alone is what a bent clamp does."""
_SHIPPED = Limits()
_AT_ONCE = 2.0
"""Limits beyond which one solution is enough. More has the body named first, less lets one bad window name a probe. The
first solution of the study's exchanged probe has 2.8 to 3.8 (gesture, five runs)."""


class ExchangedProbe(Detector):
    """Two solutions in a row must say so, or one that is far beyond. It never says OK.

    measured: checks of the latest solution. confidence_sigma: as in Limits.
    """

    def __init__(self, measured: Callable[[], Sequence[Check]], confidence_sigma: float) -> None:
        self._measured, self._confidence_sigma = measured, confidence_sigma
        self._before = self._beyond = 0.0

    def on_verified(self, shows: Callable[[Fault], bool], until_ns: int) -> None:
        """See Detector: of another probe none of the classes is right. It comes with every solution, so each is looked
        at here.
        """
        if any(shows(fault) for fault in _CLASSES):
            self._before = self._beyond = 0.0
        else:
            self._note(self._measured())

    def checks(self) -> tuple[Check, ...]:
        """How far the class that is nearest to its limit is beyond it, in limits; none before it is known."""
        if not self._beyond:
            return ()
        return (Check("exchanged-probe", Fault.EXCHANGED_PROBE, self._beyond, 0.0, "×", 1.0, VerdictKind.FAULT),)

    def _note(self, checks: Sequence[Check]) -> None:
        beyond = self._least_beyond(checks)
        if beyond >= _AT_ONCE or (beyond > 1 and self._before > 1):
            self._beyond = beyond
        self._before = beyond

    def _least_beyond(self, checks: Sequence[Check]) -> float:
        """Number of its limits by which the class that is nearest to them surely is, 0 where the latency is not shown
        to be in order: what is measured with a late tracker is no calibration. The polarity need not be shown: far from
        the reference it is rarely decided, and a mirrored picture is named before this.
        """
        if not any(check.fault is Fault.LATENCY and check.verdict is VerdictKind.OK for check in checks):
            return 0.0
        return min(
            max((self._surely(check) for check in checks if check.fault is fault), default=0.0) for fault in _CLASSES
        )

    def _surely(self, check: Check) -> float:
        """Ratio to the limits, those that are shipped at least: what a tighter one calls wrong is no other probe yet. 0
        where it is not known.
        """
        share = check.limit / max(check.limit, QUANTITIES[check.fault].limit(_SHIPPED))
        sure = check.least_ratio(self._confidence_sigma) * share
        return max(sure, 0.0) if isfinite(sure) else 0.0
