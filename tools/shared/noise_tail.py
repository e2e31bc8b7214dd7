"""How far the sequential test's log likelihood ratio rises in healthy scanning, and the threshold that follows. Pure.

Maxima of blocks above a level are taken for an exponential tail, as a likelihood ratio's is; both its parameters are
bounded from above, so that few hours give a higher threshold, never a lower one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, exp, log

from scipy.stats import chi2

from probewatch.appliance.limits import FALSE_ALARM_H, NAMED_NATS

BLOCK_NS = 30_000_000_000
"""Whose largest value counts: three windows of the test, so that neighbours share little motion. A peak on the border
of two counts twice, which is to the safe side."""
LEVELS_NATS = (6.0, 8.0, 10.0, 12.0, 14.0, 16.0)
"""Above which peaks are counted. Below the first the test gives it to first order. Each of the others is heard where
enough peaks lie above it, so that a tail that becomes flatter is not taken for the steeper one of its beginning."""
_ENOUGH = 5
"""Peaks above a level from which they bound the tail by themselves, and from which a level beyond the first is heard.
With fewer the bound would be several times what was seen, and rests on the theory; with more it would do so for longer.
Not measured."""
_ASSUMED = 20
"""Peaks of 1 nat above their level that are added to those that were seen: a bound that holds with none. A likelihood
ratio becomes rarer by e for each nat (Ville), and by more with the test's inflated variances. More asks for fewer hours
and trusts the theory for longer. Not measured."""
_SURE = 0.95
"""Of each of the two bounds."""


@dataclass(frozen=True)
class Tail:
    """hours: of scanning that was tested. from_nats: level that decided. exceedances: peaks above it. tail_nats,
    per_hour: upper bounds of the tail's length and of their rate.
    """

    hours: float
    from_nats: float
    exceedances: int
    tail_nats: float
    per_hour: float

    @property
    def threshold_nats(self) -> float:
        """Which peaks pass once in FALSE_ALARM_H, by both bounds; it may lie below what probewatch ships with."""
        return self.from_nats + self.tail_nats * log(max(FALSE_ALARM_H * self.per_hour, 1.0))


def tail_of(peaks: Sequence[float], hours: float) -> Tail:
    """The tail of the level that asks for the highest threshold. peaks: largest value of each block. hours: of all,
    above 0.
    """
    tails = [_above(level, peaks, hours) for level in LEVELS_NATS]
    heard = [tail for tail in tails[1:] if tail.exceedances >= _ENOUGH]
    return max([tails[0], *heard], key=lambda tail: tail.threshold_nats)


def least_hours() -> float:
    """Hours of scanning without any peak that show the promise to be kept at the threshold that probewatch
    ships with.
    """
    return _most_events(0) * FALSE_ALARM_H / exp((NAMED_NATS - LEVELS_NATS[0]) / _tail_nats(0, 0.0))


def minutes_text(hours: float) -> str:
    """Minutes for people, rounded up."""
    return f"{ceil(hours * 60 - 1e-9)} min"


def _above(level: float, peaks: Sequence[float], hours: float) -> Tail:
    excess = [peak - level for peak in peaks if peak > level]
    return Tail(hours, level, len(excess), _tail_nats(len(excess), sum(excess)), _most_events(len(excess)) / hours)


def _tail_nats(number: int, excess: float) -> float:
    """Upper bound of the mean excess of an exponential tail: by what was assumed, and by the peaks alone where they are
    enough, whichever is longer.
    """
    assumed = _longest(number + _ASSUMED, excess + _ASSUMED)
    return max(assumed, _longest(number, excess)) if number >= _ENOUGH else assumed


def _longest(number: int, excess: float) -> float:
    """χ² of twice as many degrees of freedom."""
    return 2 * excess / float(chi2.ppf(1 - _SURE, 2 * number))


def _most_events(number: int) -> float:
    """Upper bound of a Poisson mean of which so many were seen."""
    return float(chi2.ppf(_SURE, 2 * (number + 1))) / 2
