"""Models how far the sequential test's log likelihood ratio rises in healthy scanning, and derives a threshold from it.
Pure.

The maxima of blocks above a level are assumed to have an exponential tail, as that of a likelihood ratio is; both its
parameters are bounded from above, so that few hours give a higher threshold, never a lower one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, exp, log

from scipy.stats import chi2

from probewatch.appliance.limits import FALSE_ALARM_H, NAMED_NATS

BLOCK_NS = 30_000_000_000
"""ns, length of a block, of which the largest value counts: three windows of the test, so that neighbouring blocks
share little motion. A peak on the border of two blocks counts twice, which errs on the safe side."""
LEVELS_NATS = (6.0, 8.0, 10.0, 12.0, 14.0, 16.0)
"""nats, levels above which peaks are counted. Below the first, the test gives the ratio only to first order. Each of
the others is considered where enough peaks lie above it, so that a tail that flattens is not mistaken for the steeper
one with which it begins."""
_ENOUGH = 5
"""Number of peaks above a level from which they bound the tail by themselves, and from which a level beyond the first
is considered. With fewer peaks such a bound would be several times what was seen, so the theory gives it; a larger
number would rely on the theory for longer. Not measured."""
_ASSUMED = 20
"""Number of peaks of 1 nat above their level that are added to those that were seen, so that there is a bound even
where none was. A likelihood ratio becomes rarer by a factor of e for each nat (Ville), and by more with the test's
inflated variances. More peaks require fewer hours and trust the theory for longer. Not measured."""
_SURE = 0.95
"""Confidence of each of the two bounds."""


@dataclass(frozen=True)
class Tail:
    """Describes the tail above one level. hours: those of scanning that was tested. from_nats: the level. exceedances:
    number of peaks above it. tail_nats, per_hour: upper bounds of the tail's mean excess and of the rate of peaks.
    """

    hours: float
    from_nats: float
    exceedances: int
    tail_nats: float
    per_hour: float

    @property
    def threshold_nats(self) -> float:
        """Returns the threshold that peaks pass once in FALSE_ALARM_H, by both bounds; it may lie below the one that
        probewatch ships with.
        """
        return self.from_nats + self.tail_nats * log(max(FALSE_ALARM_H * self.per_hour, 1.0))


def tail_of(peaks: Sequence[float], hours: float) -> Tail:
    """Returns the tail of the level that requires the highest threshold. peaks: largest value of each block, nats.
    hours: those of all blocks, above 0.
    """
    tails = [_above(level, peaks, hours) for level in LEVELS_NATS]
    heard = [tail for tail in tails[1:] if tail.exceedances >= _ENOUGH]
    return max([tails[0], *heard], key=lambda tail: tail.threshold_nats)


def least_hours() -> float:
    """Returns the hours of scanning without any peak that show that the threshold with which probewatch ships is passed
    no more than once in FALSE_ALARM_H.
    """
    return _most_events(0) * FALSE_ALARM_H / exp((NAMED_NATS - LEVELS_NATS[0]) / _tail_nats(0, 0.0))


def minutes_text(hours: float) -> str:
    """Returns the time in minutes, rounded up, as text for people."""
    return f"{ceil(hours * 60 - 1e-9)} min"


def _above(level: float, peaks: Sequence[float], hours: float) -> Tail:
    excess = [peak - level for peak in peaks if peak > level]
    return Tail(hours, level, len(excess), _tail_nats(len(excess), sum(excess)), _most_events(len(excess)) / hours)


def _tail_nats(number: int, excess: float) -> float:
    """Returns the upper bound of the mean excess of an exponential tail, nats: with the assumed peaks added, or by the
    peaks alone where there are enough, whichever is longer.
    """
    assumed = _longest(number + _ASSUMED, excess + _ASSUMED)
    return max(assumed, _longest(number, excess)) if number >= _ENOUGH else assumed


def _longest(number: int, excess: float) -> float:
    """Returns the upper bound of the mean of an exponential distribution, of which `number` values sum to `excess`: it
    follows from χ² with 2 `number` degrees of freedom.
    """
    return 2 * excess / float(chi2.ppf(1 - _SURE, 2 * number))


def _most_events(number: int) -> float:
    """Returns the upper bound of the mean of a Poisson distribution, where `number` events were seen."""
    return float(chi2.ppf(_SURE, 2 * (number + 1))) / 2
