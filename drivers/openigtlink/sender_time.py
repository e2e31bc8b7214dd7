"""Determines when a message's measurement was true, by converting the sender's time to the host's clock.

A time that is reported in steps is too early by up to one step, and so is its stamp. The truth is not after the arrival
either, so the bound grows by whichever is less: where messages come quickly, a step that was found by mistake costs
next to nothing.
"""

from probewatch.drivers.clock.device_clock import DeviceClock
from probewatch.drivers.clock.monotonic_stamps import MonotonicStamps
from probewatch.drivers.clock.ticks import Ticks
from probewatch.drivers.samples import Stamp

_UNTIMED_ERR_NS = 100_000_000
"""Bound of the stamp of a message without a time, which is that of its arrival: the bound that `opencv:` states for
pictures, and the widest that the counter clock ever states. Not measured.
"""


class SenderTime:
    """Stamps the messages of one sender.

    latency_ns: known time from measurement to sending. round_trip_ns: that of the network, half of which is subtracted
    from the stamp and added to the bound, as its constant part shows in no arrival.
    """

    def __init__(self, latency_ns: int, round_trip_ns: int) -> None:
        self._latency_ns, self._half_ns = latency_ns, round_trip_ns // 2
        self._clock, self._monotonic, self._ticks = DeviceClock(), MonotonicStamps(), Ticks()
        self.untimed = 0

    @property
    def restarts(self) -> int:
        """Returns how often the sender's clock jumped, or its messages came later from then on; the two cannot be
        distinguished.
        """
        return self._clock.restarts

    @property
    def remedy(self) -> str:
        """Returns the remedy for times with a wide bound, where the messages show the cause; empty otherwise."""
        if self.untimed:
            return "Have the server stamp what it sends: messages came without a time"
        return "Keep the server's clock from being set while it sends: it jumped" if self.restarts else ""

    def note(self, time_ns: int) -> None:
        """Records the time of every message, including one that has the time of the message before and gets no stamp of
        its own.
        """
        if time_ns:
            self._ticks.take(time_ns)

    def stamp(self, time_ns: int, arrival_ns: int) -> Stamp:
        """Returns the stamp of a message. time_ns: that of the sender, 0 where it sends none. arrival_ns: that of the
        first byte of the message.
        """
        if time_ns == 0:
            self.untimed += 1
            found = Stamp(arrival_ns, _UNTIMED_ERR_NS)
        else:
            found = self._clock.stamp(time_ns, arrival_ns)
            coarse_ns = min(self._ticks.tick_ns, arrival_ns - found.t_ns)
            found = Stamp(found.t_ns, found.err_ns + coarse_ns)
        early_ns = self._latency_ns + self._half_ns
        return self._monotonic.stamp(found.t_ns - early_ns, found.err_ns + self._half_ns)

    def heard(self, t_ns: int) -> Stamp:
        """Returns the stamp of a report that there is no measurement."""
        return self._monotonic.stamp(t_ns, 0)
