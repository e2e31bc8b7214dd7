"""When a measurement was true: a device's frame counter turned into host time, with a bound of the error.

A reading arrives late, never early. The delays of all readings are lowest when nothing was in the way, so the true line
of host time over counter runs along the lower edge of the readings (the lower convex hull), as clock filters of NTP do
with the shortest round trip. The constant part of the delay cannot be seen from here: subtract what is known of it,
the transfer time of the reply, from `arrival_ns`.
"""

from collections import deque
from dataclasses import dataclass
from itertools import pairwise

from drivers.samples import Stamp

_WRAP = 1 << 32
_WINDOW_NS = 20_000_000_000
_BIN_NS = 250_000_000
_SHORTEST_EDGE_NS = 2_000_000_000
_STEEPEST = 500e-6
_USUAL_SKEW = 200e-6
_RECENT_READINGS = 120
_LATE_NS = 12_000_000
_EARLY_NS = 2_000_000
_SETTLING_READINGS = 60
_JUMP_NS = 300_000_000
_BOUND_FLOOR_NS = 150_000.0
_FIRST_BOUND_NS = 100_000_000.0
_SPREAD_FLOOR_NS = 500_000.0
_LOWEST_OF_MANY = 12.0


@dataclass(frozen=True, slots=True)
class _Reading:
    """device_ns: counter × nominal period since the start. late_ns: arrival minus that."""

    device_ns: float
    late_ns: float


class CounterClock:
    """Feed every new counter value once; wrap-around, restart and jumps of the counter are noticed here.

    nominal_hz: counts per second by the data sheet; the true rate may differ by 500 ppm.
    """

    def __init__(self, nominal_hz: float) -> None:
        self._period_ns = 1e9 / nominal_hz
        self.restarts = 0
        self._counter, self._count, self._last_t_ns = 0, 0, 0
        self._begin(0, 0)

    def stamp(self, counter: int, arrival_ns: int) -> Stamp:
        """Host time of the count, never before an earlier stamp; the bound holds for 99.7 % of all readings.

        arrival_ns: CLOCK_MONOTONIC of the last byte, less the known transfer time. counter: 32 bits.
        """
        steps = (counter - self._counter) % _WRAP
        if self._count == 0:
            self._begin(counter, arrival_ns)
            steps = 0
        elif steps >= _WRAP // 2 or self._jumped(steps, arrival_ns):
            self._restart(counter, arrival_ns)
            steps = 0
        self._counter = counter
        self._device_ns += steps * self._period_ns
        self._add(_Reading(self._device_ns, arrival_ns - self._origin_ns - self._device_ns), arrival_ns)
        return self._estimate(arrival_ns)

    def _restart(self, counter: int, arrival_ns: int) -> None:
        self.restarts += 1
        self._begin(counter, arrival_ns)

    def _begin(self, counter: int, arrival_ns: int) -> None:
        self._origin_ns, self._last_arrival_ns = arrival_ns, arrival_ns
        self._device_ns, self._counter = 0.0, counter
        self._lowest: deque[_Reading] = deque()
        self._bin_sizes: deque[int] = deque()
        self._seen = 0
        self._recent: deque[float] = deque(maxlen=_RECENT_READINGS)
        self._level_ns, self._slope, self._count = 0.0, 0.0, 0
        self._edge_ns = (0.0, float(_BIN_NS))
        self._spread_ns = _FIRST_BOUND_NS / 10

    def _jumped(self, steps: int, arrival_ns: int) -> bool:
        """The counter moved by a time that the host's clock did not see pass."""
        elapsed_ns = arrival_ns - self._last_arrival_ns
        return abs(steps * self._period_ns - elapsed_ns) > _JUMP_NS + 2 * _STEEPEST * elapsed_ns

    def _add(self, reading: _Reading, arrival_ns: int) -> None:
        if self._count and self._misfits(reading):
            self._restart(self._counter, arrival_ns)
            reading = _Reading(0.0, 0.0)
        self._last_arrival_ns = arrival_ns
        self._count += 1
        if self._keep_lowest(reading):
            self._fit()
        self._recent.append(reading.late_ns - self._line(reading.device_ns))
        excess_ns = max(self._recent[-1], 0.0)
        self._spread_ns += (excess_ns - self._spread_ns) / min(self._count + 10, 600)

    def _misfits(self, reading: _Reading) -> bool:
        """Far earlier than the line allows, or none of the recent readings came near it."""
        excess_ns = reading.late_ns - self._line(reading.device_ns)
        full = len(self._recent) == _RECENT_READINGS
        too_early = self._count > _SETTLING_READINGS and excess_ns < -_EARLY_NS - self._bound_ns()
        return too_early or (full and min(*self._recent, excess_ns) > _LATE_NS)

    def _keep_lowest(self, reading: _Reading) -> bool:
        """One reading per bin stays, the lowest. Returns whether the line must be drawn anew."""
        lowest = self._lowest
        while lowest and reading.device_ns - lowest[0].device_ns > _WINDOW_NS:
            lowest.popleft()
            self._seen -= self._bin_sizes.popleft()
        self._seen += 1
        if lowest and reading.device_ns // _BIN_NS == lowest[-1].device_ns // _BIN_NS:
            self._bin_sizes[-1] += 1
            if reading.late_ns >= lowest[-1].late_ns:
                return False
            lowest.pop()
        else:
            self._bin_sizes.append(1)
        lowest.append(reading)
        return True

    def _fit(self) -> None:
        """The line under all readings that lies closest to them: the hull's edge below their middle."""
        middle_ns = sum(reading.device_ns for reading in self._lowest) / len(self._lowest)
        hull = _lower_hull(self._lowest)
        edges = pairwise(hull)
        left, right = next((edge for edge in edges if edge[1].device_ns >= middle_ns), (hull[-1], hull[-1]))
        length_ns = right.device_ns - left.device_ns
        slope = (right.late_ns - left.late_ns) / length_ns if length_ns >= _SHORTEST_EDGE_NS else 0.0
        self._slope = min(max(slope, -_STEEPEST), _STEEPEST)
        self._edge_ns = ((left.device_ns + right.device_ns) / 2, length_ns)
        self._level_ns = min(reading.late_ns - self._slope * reading.device_ns for reading in self._lowest)

    def _line(self, device_ns: float) -> float:
        return self._level_ns + self._slope * device_ns

    def _estimate(self, arrival_ns: int) -> Stamp:
        """Never back in time, never after the arrival; what that moves the stamp is added to its bound."""
        raw_ns = self._origin_ns + round(self._device_ns + self._line(self._device_ns))
        self._last_t_ns = min(max(raw_ns, self._last_t_ns), arrival_ns)
        return Stamp(self._last_t_ns, round(self._bound_ns()) + abs(self._last_t_ns - raw_ns))

    def _bound_ns(self) -> float:
        """The lowest of n exponential delays of mean m lies about m ÷ n above zero; so do the two readings that carry
        the line, and the error of its slope grows with the distance from them.
        """
        middle_ns, length_ns = self._edge_ns
        away_ns = abs(self._device_ns - middle_ns)
        level_ns = _LOWEST_OF_MANY * max(self._spread_ns, _SPREAD_FLOOR_NS) / max(self._seen, 1)
        tilt = 3 * level_ns / length_ns if length_ns >= _SHORTEST_EDGE_NS else _USUAL_SKEW
        return min(_BOUND_FLOOR_NS + level_ns + tilt * away_ns, _FIRST_BOUND_NS)


def _lower_hull(readings: deque[_Reading]) -> list[_Reading]:
    hull: list[_Reading] = []
    for reading in readings:
        while len(hull) >= 2 and not _turns_up(hull[-2], hull[-1], reading):
            hull.pop()
        hull.append(reading)
    return hull


def _turns_up(a: _Reading, b: _Reading, c: _Reading) -> bool:
    before = (b.late_ns - a.late_ns) * (c.device_ns - b.device_ns)
    return before < (c.late_ns - b.late_ns) * (b.device_ns - a.device_ns)
