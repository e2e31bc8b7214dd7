"""Determines when a measurement was true: converts a device's clock into host time, with a bound of the error.

A reading arrives late, never early. The delays of all readings are lowest when nothing was in the way, so the true line
of host time over device time runs along the lower edge of the readings (the lower convex hull), as clock filters of NTP
do with the shortest round trip. Where the device answers requests, the line is bounded from below as well: what a reply
did not contain was not there yet when its request was sent. The constant part of the delay cannot be seen from here:
subtract what is known of it, the transfer time of the reply, from `arrival_ns`.

If readings come later from some moment on, either the device's clock paused or they take longer; without requests the
two cannot be distinguished. The line starts again along the later readings, and the bound reaches back to where it was
before.
"""

import math
import statistics
from collections import deque
from dataclasses import dataclass, replace
from itertools import pairwise

from probewatch.drivers.clock.lower_hull import Reading, lower_hull
from probewatch.drivers.samples import Stamp

# Figures below come from changing that constant alone, on session() and markov_session() of
# tests/drivers/clock/test_counter_clock.py (seeds 0 to 2, 60 Hz, delays of 16 ms mean with bursts to 70 ms),
# polled_session() where requests count. With the values here: median error 0.06 ms, 99 % of errors below 1.7 ms, median
# bound 2.5 ms.

_WINDOW_NS = 20_000_000_000
"""How far back readings count. A short window holds few undisturbed readings (5 s: bound 9.5 ms); a long one cannot
follow the drift of the rate (40 s: 99 % of errors below 3.4 ms, bound 2.1 ms)."""

_BIN_NS = 250_000_000
"""One reading is kept from each bin of a quarter of a second. Finer bins cost processor time (0.1 s: three times as
much); coarser ones leave fewer readings from which to judge the lowest (1 s: bound 3.8 ms)."""

_SHORTEST_EDGE_NS = 2_000_000_000
"""Length of the hull's edge from which a slope is taken; over 2 s, a delay of 1 ms left in one end tilts it by as much
as _STEEPEST. Longer edges come too late (8 s: median error 0.14 ms); 0.5 s did no worse in these sessions."""

_STEEPEST = 500e-6
"""Largest assumed difference between the rates of device and host; crystals stay within some 100 ppm. More lets
disturbed readings tilt the line. Not measured on devices; the tests run at 100 ppm."""

_USUAL_SKEW = 200e-6
"""Growth of the bound with distance while there is no slope: two crystals of 100 ppm each. More widens the bound of the
first seconds; less would promise what is not known. Not measured on devices."""

_SETTLED_SKEW = 50e-6
"""Least doubt of the slope between requests. More widens the bound (200 ppm: 0.62 ms instead of 0.58); less gives a
drifting crystal no room (10 ppm: 0.56 ms, and coverage held on drifts of about 1 ppm)."""

_RECENT_READINGS = 120
"""Readings, 2 s at 60 Hz: if none of them came near the line, the device's clock has stepped. Fewer take a busy line
for a step (30: 29 false restarts in six sessions); more notice a step later."""

_LATE_NS = 12_000_000
"""Distance that counts as near the line for that: less takes delays for a step, more misses a step smaller than it.
4 ms gave no false restart in these sessions, so the rest is margin; a step of 100 ms is found by test."""

_EARLY_NS = 2_000_000
"""A reading earlier than line and bound by this is a step of the device's clock, not a better reading. Less restarts
for noise (0.2 ms did not in these sessions); more lets a step stand."""

_SETTLING_READINGS = 60
"""Readings, 1 s at 60 Hz, in which an early one improves the line and is not taken for a step. More leaves a step
within them unnoticed; 5 did no worse in these sessions, whose delays are worst later."""

_JUMP_NS = 300_000_000
"""Difference between the times passed on the two clocks that is a jump. It must exceed the spread of delays (70 ms
there); smaller steps are found by misfit, some readings later."""

_LATE_FOR_NS = 250_000_000
"""How long readings later than that are taken as held up, in a process that was paused or on a line, before the
device's clock is assumed to have paused. Held-up readings come in one burst; less restarts while a burst is still being
read, more leaves a device that paused without usable times for longer. Not measured on devices."""

_DOUBTED_NS = 120_000_000_000
"""How long the bound reaches back to the line before, where readings suddenly came later and none has come as early
since. Less states a narrow bound while a verification from before may stand (`max_verification_age_s`, 120 s); more
keeps a wide one for longer after a clock that did pause. From then on the added delay is part of the constant one,
which cannot be seen from here.
"""

_BOUND_FLOOR_NS = 150_000.0
"""Least bound without requests: for the time that waking up and reading the clock add to every arrival alike, which no
spread shows. More claims less than is known. Not measured on a cart."""

_FIRST_BOUND_NS = 100_000_000.0
"""Bound while nothing is known, and the largest that is stated unless readings came late (docs/trackers.md, Hardware
time). It must exceed the delay of a first reading (70 ms there); more only makes first poses vaguer. A reading that is
later than usual by more than this is itself in doubt: its bound reaches to its arrival."""

_RANK = 12
"""Rank of the reading, among the lowest, that shows how late the lowest may be. A low rank says little (4: bound
3.4 ms); a high one reaches readings that are late for reasons of their own (30: 3.2 ms)."""

_TILT = 2.0
"""Doubts by which the ends of an edge may differ: each errs by one, in opposite directions. 1 gives a bound of 1.7 ms
and held in these sessions, but leaves one end out."""

_MISS = 0.003
"""Probability that the doubt is exceeded: the bound is promised for 99.7 % of readings, as
tests/drivers/clock/test_counter_clock.py counts. Less widens every bound.
"""

_FLOORS = 8
"""Newest bounds by requests that are kept, one from each bin. Fewer bound worse (2: 0.62 ms and more requests); more
cost time at every reading and gain nothing (30: the same 0.58 ms)."""

_BRACKET_FLOOR_NS = 50_000.0
"""Least bound between requests, for the calls between reading the clock and the line; it is added to every bound.
Without it coverage held as well in these sessions, which have no such calls. Not measured on a cart."""


@dataclass(frozen=True, slots=True)
class _Line:
    """Represents host time over device time, as it was until left_ns of the host: host_ns at zero_ns of the device.

    slope: excess of the host's rate, which may be wrong by skew.
    """

    zero_ns: int
    host_ns: float
    slope: float
    skew: float
    left_ns: int

    def at(self, device_ns: float) -> float:
        """Returns the host time of a device time."""
        since_ns = device_ns - self.zero_ns
        return self.host_ns + since_ns + self.slope * since_ns

    def moved(self, by_ns: float) -> "_Line":
        """Returns the same line for a device's clock that was set back by by_ns."""
        return replace(self, host_ns=self.host_ns + by_ns)


class DeviceClock:
    """Converts device times into stamps. It must be fed every new device time once; it detects steps of the device's
    clock.

    The device's rate may differ from the host's by 500 ppm. A reading that was held up on its way keeps its time, with
    a bound that reaches to its arrival. restarts: how often the line had to be started again.
    early_ns: how far before the last stamp the truth may lie, according to requests that came too early for it; at most
    100 ms. It assumes nothing about the delays, only how far the rates of the clocks may differ from now on.
    """

    def __init__(self) -> None:
        self.restarts = 0
        self.early_ns = _FIRST_BOUND_NS
        self._last_t_ns = 0
        self._count = 0
        self._shortest_ns = 0
        self._before: _Line | None = None
        self._doubted_until_ns, self._came_back = 0, False
        self._begin(0, 0)

    def stamp(
        self, device_ns: int, arrival_ns: int, absent_ns: int | None = None, asked_ns: int | None = None
    ) -> Stamp:
        """Returns the host time of the measurement, never before an earlier stamp; the bound holds for 99.7 % of all
        readings.

        device_ns: the device's clock, any zero. arrival_ns: CLOCK_MONOTONIC of the last byte, less the known transfer
        time. absent_ns: when the last request went out whose answer did not contain this measurement yet, None where
        that is not known. asked_ns: when the request went out that the reading answers; the shortest time from there to
        the arrival bounds the delay that may be common to all readings, which is taken as 0 where it is not known.
        """
        if self._count == 0:
            self._begin(device_ns, arrival_ns)
        elif self._jumped(device_ns, arrival_ns):
            self._restart(device_ns, arrival_ns)
        elif self._held_up(device_ns, arrival_ns):
            return self._held_up_estimate(device_ns, arrival_ns)
        if asked_ns is not None:
            self._shortest_ns = min(self._shortest_ns or arrival_ns - asked_ns, arrival_ns - asked_ns)
        self._device_ns = float(device_ns - self._zero_ns)
        late_ns = arrival_ns - self._origin_ns - self._device_ns
        self._add(Reading(self._device_ns, late_ns), arrival_ns)
        if absent_ns is not None:
            self._add_floor(Reading(self._device_ns, late_ns - (arrival_ns - absent_ns)), arrival_ns)
        stamp = self._estimate(arrival_ns)
        late_ns = arrival_ns - stamp.t_ns
        return stamp if self._floors or late_ns < _FIRST_BOUND_NS else _reaching(stamp, arrival_ns)

    @property
    def usual_delay_ns(self) -> int:
        """Returns the median of how much later than their stamps the recent readings arrived.

        Added to the stamps, it gives a filter through the middle of the readings, which leaves a latency that was
        calibrated on arrival times unchanged.
        """
        return round(statistics.median(self._recent)) if self._recent else 0

    def _restart(self, device_ns: int, arrival_ns: int) -> None:
        self._remember(device_ns, arrival_ns)
        self.restarts += 1
        self._begin(device_ns, arrival_ns)

    def _remember(self, device_ns: int, arrival_ns: int) -> None:
        """Keeps the line that may still be true. A reading that comes later does not show why; time that runs back, or
        further ahead than that lateness, is a step of the clock, which leaves the lateness in doubt.
        """
        late_ns = self._later_than_usual_ns(device_ns, arrival_ns)
        went_back = device_ns - self._zero_ns < self._device_ns
        self._came_back = late_ns <= 0
        before = self._before  # which `_doubted_ns` forgets once there is no doubt
        if late_ns > 0 and not went_back:
            level_ns = self._origin_ns + self._level_ns
            self._before = before or _Line(self._zero_ns, level_ns, self._slope, self._skew, arrival_ns)
            self._doubted_until_ns = arrival_ns + _DOUBTED_NS
        elif before is not None and (went_back or -late_ns > self._doubted_ns(arrival_ns) + _FIRST_BOUND_NS):
            self._before = before.moved(late_ns - max(self._recent, default=0.0))  # as late as any other, at most

    def _doubted_ns(self, arrival_ns: int) -> float:
        """Returns how far the line lies above the one before, which may still be true."""
        if self._before is None:
            return 0.0
        now_ns = self._origin_ns + self._device_ns + self._line(self._device_ns)
        doubted_ns = now_ns - self._before.at(self._device_ns + self._zero_ns)
        drift_ns = self._before.skew * (arrival_ns - self._before.left_ns)
        as_before_ns = _EARLY_NS + (drift_ns if self._came_back else 0.0)
        if arrival_ns > self._doubted_until_ns or doubted_ns < as_before_ns:
            self._before = None  # too long ago, or readings come as early as before
            return 0.0
        return doubted_ns + drift_ns

    def _begin(self, device_ns: int, arrival_ns: int) -> None:
        self._origin_ns, self._last_arrival_ns, self._zero_ns = arrival_ns, arrival_ns, device_ns
        self._device_ns = 0.0
        self._lowest: deque[Reading] = deque()
        self._floors: deque[Reading] = deque(maxlen=_FLOORS)
        self._recent: deque[float] = deque(maxlen=_RECENT_READINGS)
        self._level_ns, self._slope, self._count = 0.0, 0.0, 0
        self._edge_ns = (0.0, float(_BIN_NS))
        self._doubt_ns = _FIRST_BOUND_NS
        self._held_up_ns: int | None = None

    def _jumped(self, device_ns: int, arrival_ns: int) -> bool:
        """Returns whether the device's clock moved back, or by a time unseen by the host's clock, or paused."""
        moved_ns = device_ns - self._zero_ns - self._device_ns
        late_ns = self._later_than_usual_ns(device_ns, arrival_ns)
        paused = self._held_up_ns is not None and arrival_ns - self._held_up_ns > _LATE_FOR_NS
        return moved_ns < 0 or late_ns < -self._most_ns(arrival_ns) or (paused and late_ns > self._most_ns(arrival_ns))

    def _held_up(self, device_ns: int, arrival_ns: int) -> bool:
        """Returns whether the reading came far later than the line predicts; such a one does not change the line."""
        if self._later_than_usual_ns(device_ns, arrival_ns) <= self._most_ns(arrival_ns):
            self._held_up_ns = None
            return False
        if self._held_up_ns is None:
            self._held_up_ns = arrival_ns
        return True

    def _held_up_estimate(self, device_ns: int, arrival_ns: int) -> Stamp:
        """Returns the estimate by the line, with a bound to the arrival: the truth if the device's clock paused."""
        self._device_ns = float(device_ns - self._zero_ns)
        return _reaching(self._estimate(arrival_ns), arrival_ns)

    def _later_than_usual_ns(self, device_ns: int, arrival_ns: int) -> float:
        device_ns -= self._zero_ns
        return arrival_ns - self._origin_ns - device_ns - self._line(device_ns)

    def _most_ns(self, arrival_ns: int) -> float:
        """Returns how far from the line a reading may arrive; it grows with the time since the last one near it."""
        return _JUMP_NS + 2 * _STEEPEST * (arrival_ns - self._last_arrival_ns)

    def _add(self, reading: Reading, arrival_ns: int) -> None:
        if self._count and self._misfits(reading):
            self._restart(round(self._device_ns) + self._zero_ns, arrival_ns)
            reading = Reading(0.0, 0.0)
        self._last_arrival_ns = arrival_ns
        self._count += 1
        if self._keep_lowest(reading):
            self._fit()
        self._recent.append(reading.late_ns - self._line(reading.device_ns))

    def _add_floor(self, floor: Reading, arrival_ns: int) -> None:
        """Adds a lower bound of the truth. A line far below it has been left behind by a step of the device's clock."""
        below_ns = floor.late_ns - self._line(floor.device_ns)
        if self._count > _SETTLING_READINGS and below_ns > _EARLY_NS + self._bound_ns():
            self._restart(round(self._device_ns) + self._zero_ns, arrival_ns)
            self._add(Reading(0.0, 0.0), arrival_ns)
            return
        if self._floors and floor.device_ns // _BIN_NS == self._floors[-1].device_ns // _BIN_NS:
            if floor.late_ns <= self._floors[-1].late_ns:
                return
            self._floors.pop()
        self._floors.append(floor)

    def _misfits(self, reading: Reading) -> bool:
        """Returns whether the reading is far earlier than the line allows, or no recent one came near the line."""
        excess_ns = reading.late_ns - self._line(reading.device_ns)
        full = len(self._recent) == _RECENT_READINGS
        too_early = self._count > _SETTLING_READINGS and excess_ns < -_EARLY_NS - self._bound_ns()
        return too_early or (full and min(*self._recent, excess_ns) > _LATE_NS)

    def _keep_lowest(self, reading: Reading) -> bool:
        """Keeps one reading per bin, the lowest. Returns whether the line must be fitted again."""
        lowest = self._lowest
        while lowest and reading.device_ns - lowest[0].device_ns > _WINDOW_NS:
            lowest.popleft()
        if lowest and reading.device_ns // _BIN_NS == lowest[-1].device_ns // _BIN_NS:
            if reading.late_ns >= lowest[-1].late_ns:
                return False
            lowest.pop()
        lowest.append(reading)
        return True

    def _fit(self) -> None:
        """Fits the line that lies closest below all readings: the hull's edge below their middle."""
        middle_ns = sum(reading.device_ns for reading in self._lowest) / len(self._lowest)
        hull = lower_hull(self._lowest)
        edges = pairwise(hull)
        left, right = next((edge for edge in edges if edge[1].device_ns >= middle_ns), (hull[-1], hull[-1]))
        length_ns = right.device_ns - left.device_ns
        slope = (right.late_ns - left.late_ns) / length_ns if length_ns >= _SHORTEST_EDGE_NS else 0.0
        self._slope = min(max(slope, -_STEEPEST), _STEEPEST)
        self._edge_ns = ((left.device_ns + right.device_ns) / 2, length_ns)
        self._level_ns = min(reading.late_ns - self._slope * reading.device_ns for reading in self._lowest)
        self._doubt_ns = _doubt_ns(sorted(reading.late_ns - self._line(reading.device_ns) for reading in self._lowest))

    def _line(self, device_ns: float) -> float:
        return self._level_ns + self._slope * device_ns

    def _estimate(self, arrival_ns: int) -> Stamp:
        """Returns the stamp, never back in time, never after the arrival; what that moves it is added to its bound."""
        raw_ns = self._origin_ns + round(self._device_ns + self._line(self._device_ns))
        self._last_t_ns = min(max(raw_ns, self._last_t_ns), arrival_ns)
        bound_ns, bracket_ns = self._bound_ns() + self._shortest_ns, self._bracket_ns() + _BRACKET_FLOOR_NS
        bound_ns = min(bound_ns, bracket_ns) if self._floors else bound_ns + self._doubted_ns(arrival_ns)
        return Stamp(self._last_t_ns, round(bound_ns) + abs(self._last_t_ns - raw_ns))

    def _bound_ns(self) -> float:
        """Returns how far the line may lie above the truth: the more, the farther from the readings that carry it."""
        middle_ns, length_ns = self._edge_ns
        away_ns = abs(self._device_ns - middle_ns)
        tilt = _TILT * self._doubt_ns / length_ns if length_ns >= _SHORTEST_EDGE_NS else _USUAL_SKEW
        return min(_BOUND_FLOOR_NS + self._doubt_ns + tilt * away_ns, _FIRST_BOUND_NS)

    def _early_ns(self, skew: float) -> float:
        return max(min((self._room_ns(floor, skew, -1.0) for floor in self._floors), default=_FIRST_BOUND_NS), 0.0)

    @property
    def _skew(self) -> float:
        """Returns how far the slope of the line may be wrong."""
        length_ns = self._edge_ns[1]
        if length_ns < _SHORTEST_EDGE_NS:
            return _STEEPEST
        return min(_SETTLED_SKEW + _TILT * self._doubt_ns / length_ns, _STEEPEST)

    def _bracket_ns(self) -> float:
        """Returns how far the truth can be from the line: above what was not there yet, below what had arrived."""
        skew = self._skew
        newest = list(self._lowest)[-_FLOORS:]
        above_ns = min(self._room_ns(reading, skew, 1.0) for reading in newest)
        self.early_ns = self._early_ns(skew)
        return max(above_ns, self.early_ns)

    def _room_ns(self, reading: Reading, skew: float, side: float) -> float:
        away_ns = abs(self._device_ns - reading.device_ns)
        return side * (reading.late_ns - self._line(reading.device_ns)) + skew * away_ns


def _reaching(stamp: Stamp, arrival_ns: int) -> Stamp:
    """Returns the stamp with a bound to its arrival, which is the truth if the device's clock paused."""
    return Stamp(stamp.t_ns, max(stamp.err_ns, arrival_ns - stamp.t_ns))


def _doubt_ns(lateness_ns: list[float]) -> float:
    """Returns how late the lowest readings themselves may be, judged by how closely they lie together; exceeded in
    0.3 % of cases.

    lateness_ns: that of the lowest reading of every bin above the line, rising; two are 0, as they carry the line.
    Where the chance of a delay below x grows as x², as for requests that come at any time, the squares of the lowest
    are spaced like random arrivals: the first exceeds 1 / (ρ − 1) times its distance to one m places further with the
    chance (1 + 1 / (ρ² − 1))⁻ᵐ. Where the chance grows as x, as for exponential delays, it does so less often.
    """
    places = min(_RANK, len(lateness_ns) - 1) - 1
    if places < 1:
        return _FIRST_BOUND_NS
    rho = math.sqrt(1 + 1 / (_MISS ** (-1 / places) - 1))
    return min(lateness_ns[places + 1] / (rho - 1), _FIRST_BOUND_NS)
