"""Distinguishes new measurements of a tool from repeated ones, learns their period, and detects when they fail to come.

The rules differ: TX and BX list a tool in every reply, so the data are stale when the tool's clock does not advance.
BX2 leaves a tool out until there is something new, so the data are stale when the tool is absent.
"""

from probewatch.drivers.clock.counter_clock import COUNTS
from probewatch.drivers.trackers.ndi.readings import Reading
from probewatch.drivers.trackers.ndi.replies import Transform
from probewatch.drivers.trackers.staleness import FROZEN_READINGS, SLOWEST_PERIOD_NS, STALE_PERIODS

_LEARNING_READINGS = 20
"""Steps of the counter after which the shortest is taken for the period; until then the next measurement is requested
every millisecond. More costs requests; fewer may take the double step of a slow start for the period. Not measured.
"""


class Freshness:
    """Tracks the measurements of one tool.

    frame: last frame number. device_ns: device time of the last measurement, wrap-around undone. period_ns: time
    between two measurements; at first an upper bound. frozen: whether the pose repeats while the clock runs. tick_ns:
    length of a tick of the readings: that of the frame counter for TX and BX, 1 for BX2. repeats: whether old data are
    sent again.
    """

    def __init__(self, tick_ns: float, repeats: bool) -> None:
        self.frame = -1
        self.device_ns = 0
        self.period_ns = SLOWEST_PERIOD_NS
        self.frozen = False
        self._tick_ns, self._repeats = tick_ns, repeats
        self._modulus = COUNTS if repeats else 0
        self._tick: int | None = None
        self._new_ns: int | None = None
        self._reported_ns = 0
        self._learning = _LEARNING_READINGS
        self._transform: Transform | None = None
        self._equal = 0

    @property
    def learning(self) -> bool:
        """Returns whether there have been too few measurements so far to know the period."""
        return self._learning > 0

    def is_old(self, reading: Reading) -> bool:
        """Returns whether the device's clock runs backward in the reading: it is an old reply that came late, or the
        clock restarted.
        """
        return self._tick is not None and reading.tick is not None and self._steps(reading.tick) < 0

    def is_new(self, reading: Reading | None, arrival_ns: int) -> bool:
        """Returns whether the reading is another measurement than the last; if so, pass it to take()."""
        if self._new_ns is None:
            self._new_ns = arrival_ns
        return reading is not None and reading.tick is not None and reading.tick != self._tick

    def take(self, reading: Reading, arrival_ns: int) -> None:
        """Records the reading as the latest."""
        assert reading.tick is not None
        if self._tick is not None:
            passed_ns = self._steps(reading.tick) * self._tick_ns
            if passed_ns > 0:
                self.period_ns = min(self.period_ns, passed_ns)
                self._learning -= 1
        self.device_ns = self.time_ns(reading)
        repeated = reading.transform is not None and reading.transform == self._transform
        self._equal = self._equal + 1 if repeated else 0
        self.frozen = self._equal >= FROZEN_READINGS - 1
        self._transform, self._tick = reading.transform, reading.tick
        self.frame = reading.tick if reading.frame is None else reading.frame
        self._new_ns = self._reported_ns = arrival_ns

    def time_ns(self, reading: Reading) -> int:
        """Returns the device time of a reading that has one; negative steps from the last one go back in time."""
        assert reading.tick is not None
        if self._tick is None:
            return round(reading.tick * self._tick_ns)
        return self.device_ns + round(self._steps(reading.tick) * self._tick_ns)

    def overdue(self, arrival_ns: int) -> str:
        """Returns why the data are stale; empty while they are not, or if that was reported less than a period ago."""
        assert self._new_ns is not None
        age_ns = arrival_ns - self._new_ns
        if age_ns <= STALE_PERIODS * self.period_ns or arrival_ns - self._reported_ns < self.period_ns:
            return ""
        self._reported_ns = arrival_ns
        what = (
            "the frame counter has stood still" if self._repeats else "the tracker has reported nothing new of the tool"
        )
        return f"{what} for {age_ns / 1e6:.0f} ms"

    def _steps(self, tick: int) -> int:
        """Returns the ticks since the last measurement; negative when the clock ran backward."""
        assert self._tick is not None
        steps = tick - self._tick
        if not self._modulus:
            return steps
        steps %= self._modulus
        return steps - self._modulus if steps >= self._modulus // 2 else steps
