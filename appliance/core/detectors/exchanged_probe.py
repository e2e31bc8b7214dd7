"""Detects that probe and marker body are not the pair that was calibrated: body and picture are wrong at once.

A clamp that gives way turns and slides the body and leaves the picture as it is; a new depth leaves the body as it is.
Where rotation, offset and scale are all beyond their limits, most likely another probe is in use, the body is mounted
on another probe, or the file belongs to another probe.
"""

from collections.abc import Callable, Sequence
from math import isfinite

from probewatch.appliance.core.detectors.detector import Detector
from probewatch.appliance.core.parameters import QUANTITIES
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Check, Fault, VerdictKind

REPORTS_FAULTS = (Fault.EXCHANGED_PROBE,)

_CLASSES = (Fault.ROTATION, Fault.OFFSET, Fault.SCALE)
"""Classes that must all be wrong: a bent clamp changes rotation and offset alone."""
_SHIPPED = Limits()
_AT_ONCE = 2.0
"""Multiple of the limits from which one solution is enough. With a higher one the marker body is named first; a lower
one lets one bad window name a probe. The first solution of the study's exchanged probe reaches 2.8 to 3.8 (gesture,
five runs)."""


class ExchangedProbe(Detector):
    """Names an exchanged probe after two solutions in a row that show one, or one far beyond the limits.

    It never says OK. measured: returns the checks of the latest solution. confidence_sigma: as in Limits.
    """

    def __init__(self, measured: Callable[[], Sequence[Check]], confidence_sigma: float) -> None:
        self._measured, self._confidence_sigma = measured, confidence_sigma
        self._before = self._beyond = 0.0

    def on_verified(self, shows: Callable[[Fault], bool], until_ns: int) -> None:
        """See Detector. With another probe none of the classes is right.

        This is called with every solution, so each solution is examined here.
        """
        if any(shows(fault) for fault in _CLASSES):
            self._before = self._beyond = 0.0
        else:
            self._note(self._measured())

    def checks(self) -> tuple[Check, ...]:
        """Returns a check of how many times its limit the class nearest to its limit is; none before this is known."""
        if not self._beyond:
            return ()
        return (Check("exchanged-probe", Fault.EXCHANGED_PROBE, self._beyond, 0.0, "×", 1.0, VerdictKind.FAULT),)

    def _note(self, checks: Sequence[Check]) -> None:
        beyond = self._least_beyond(checks)
        if beyond >= _AT_ONCE or (beyond > 1 and self._before > 1):
            self._beyond = beyond
        self._before = beyond

    def _least_beyond(self, checks: Sequence[Check]) -> float:
        """Returns how many times its limit the class nearest to its limit certainly is.

        Returns 0 where the latency is not shown to be within its limit, because measurements with a late tracker are
        not a calibration. The polarity need not be shown: far from the reference it is rarely decided, and a mirrored
        picture is named before an exchanged probe.
        """
        if not any(check.fault is Fault.LATENCY and check.verdict is VerdictKind.OK for check in checks):
            return 0.0
        return min(
            max((self._surely(check) for check in checks if check.fault is fault), default=0.0) for fault in _CLASSES
        )

    def _surely(self, check: Check) -> float:
        """Returns the ratio that is certain, to the limit or to the default limit where that is wider.

        An error beyond a tighter limit alone does not yet indicate another probe. Returns 0 where the ratio is unknown.
        """
        share = check.limit / max(check.limit, QUANTITIES[check.fault].limit(_SHIPPED))
        sure = check.least_ratio(self._confidence_sigma) * share
        return max(sure, 0.0) if isfinite(sure) else 0.0
