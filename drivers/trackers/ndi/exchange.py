"""Obtains one good tracking reply at a time: it asks again when a reply is damaged or late, refuses old replies, and
gives up at the deadline.
"""

from collections.abc import Callable
from dataclasses import dataclass

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.trackers.ndi.link import Link, SilentError, refuse_reset
from probewatch.drivers.trackers.ndi.readings import Dialect, Snapshot
from probewatch.drivers.trackers.ndi.wire import EXTENDED_START, RefusedError, decode_text

_GAP_NS = 25_000_000
"""Silence after which a broken reply has run out, ns. USB adapters hold bytes back for up to 16 ms (the latency timer's
default), so less takes the rest of it for the next reply; more delays the next attempt. A property of the adapters, not
measured.
"""

_LEAST_TRY_NS = 50_000_000
"""Least time of a request, ns, in addition to its time on the line, when this host gets to it after the deadline. More
reports a loss later (250 ms in all, tests/live/test_tracker_loss.py); less takes a busy host for a silent device.
"""

_TRY_SHARE, _SPARE_SHARE = 0.4, 0.5
"""Shares of the deadline. One request waits for _TRY_SHARE, so that two fit: more leaves no time for a second, less
gives up on slow replies. Where two replies take more than the rest, a silence of _SPARE_SHARE is added to them: 9600
baud with four tools (tests/drivers/trackers/ndi/test_tracker.py).
"""

_UNSURE_ANSWERS = 3
"""Answers after an unanswered request whose sending time bounds nothing, since the late reply may have come in place of
the right one. More leaves poses with the wider bound; fewer risks a false one. Not measured.
"""

Accept = Callable[[Snapshot], None]
"""Inspects a good reply, and raises ProtocolError to have it refused all the same."""


@dataclass(frozen=True, slots=True)
class Answer:
    """Holds one good reply.

    sent_ns: the earliest time at which the request had reached the device; None while a late reply may have come in
    place of the right one. detailed: whether the reply was requested with details. arrival_ns: when the device began to
    send: the time after the last byte of the reply, less the time that the reply takes on the line.
    """

    snapshot: Snapshot
    sent_ns: int | None
    arrival_ns: int
    detailed: bool


class Exchange:
    """Sends requests until a good reply comes. refused: count of replies dropped because they were damaged.
    deadline_ns: silence after which the tracker is lost.

    longest: bytes of the longest reply that is expected; a longer one is noted.
    """

    def __init__(self, link: Link, dialect: Dialect, deadline_ns: int, longest: int, clock: HostClock) -> None:
        self.refused = 0
        self._link, self._dialect, self._deadline_ns, self._clock = link, dialect, deadline_ns, clock
        self._good_ns = clock.now_ns()
        self._longest = longest
        self._unsure = 0

    def ask(self, detailed: bool, accept: Accept | None = None) -> Answer:
        """Returns one good reply. Raises DeviceLost when none has come within the deadline, RefusedError when the
        device refuses.

        The deadline runs from the last good reply, so that a silence between two requests counts as well. It is
        extended only on a line on which a reply takes more than a quarter of it.
        """
        least_ns = 2 * self.reply_ns
        timeout_ns = max(self._deadline_ns, round(_SPARE_SHARE * self._deadline_ns) + least_ns)
        deadline_ns = max(self._good_ns + timeout_ns, self._clock.now_ns() + _LEAST_TRY_NS + least_ns)
        while True:
            try_ns = min(deadline_ns, self._clock.now_ns() + max(round(_TRY_SHARE * self._deadline_ns), least_ns))
            try:
                return self._ask_once(detailed, accept, try_ns)
            except RefusedError:
                raise
            except SilentError:
                if self._clock.now_ns() >= deadline_ns:
                    raise
                self._unsure = _UNSURE_ANSWERS
            except ProtocolError:
                pass
            self.refused += 1
            self._link.wait_quiet(_GAP_NS, deadline_ns)

    @property
    def reply_ns(self) -> int:
        """Returns the time on the line of the longest reply, ns."""
        return self._link.transfer_ns(self._longest)

    def rest(self) -> None:
        """Restarts the deadline: the device was busy with another command until now, so its silence did not count."""
        self._good_ns = self._clock.now_ns()

    def _ask_once(self, detailed: bool, accept: Accept | None, deadline_ns: int) -> Answer:
        request = self._dialect.request(detailed)
        sent_ns = self._link.send(request) + self._link.transfer_ns(len(request))
        data = self._link.read_reply(deadline_ns)
        read_ns = self._clock.now_ns()
        snapshot = self._decode(data, detailed)
        if accept is not None:
            accept(snapshot)
        self._good_ns, self._longest = read_ns, max(self._longest, len(data))
        self._unsure = max(self._unsure - 1, 0)
        sure_ns = None if self._unsure else sent_ns
        return Answer(snapshot, sure_ns, read_ns - self._link.transfer_ns(len(data)), detailed)

    def _decode(self, data: bytes, detailed: bool) -> Snapshot:
        """Decodes a reply. The long form of a binary reply has no checksum, so over a serial line it is refused."""
        if data.startswith(EXTENDED_START) and self._link.baud is not None:
            raise ProtocolError("a reply without check sum over a serial line", self._link.where)
        if data.endswith(b"\r") and len(data) < 16:
            refuse_reset(decode_text(data), self._link.where)
        return self._dialect.decode(data, detailed)
