"""Plans when the device is asked for poses, and in how much detail."""

import random

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.samples import Stamp
from probewatch.drivers.trackers.ndi.exchange import Answer
from probewatch.drivers.trackers.ndi.freshness import Freshness
from probewatch.drivers.trackers.ndi.link import Link, lost_by_protocol
from probewatch.drivers.trackers.ndi.negotiation import Agreed
from probewatch.drivers.trackers.ndi.readings import Snapshot
from probewatch.drivers.trackers.ndi.wire import RefusedError

_BACKWARD_READINGS = 3
"""Replies in a row with a counter that runs backward that mean that the counter restarted. Fewer take an old reply that
came late for a restart; each more costs a reply without a pose. tests/drivers/trackers/ndi/ shows both.
"""

_DETAILS_S = 0.1
"""Time between two replies with marker details, which are over twice as long: there are ten in the second over which
the marker checks take the median (docs/trackers.md). More of them cost poses on a slow line; fewer leave that median to
chance.
"""

_RETRY_NS = 1_000_000
"""Pause before the next request, ns, where nothing new was there. A shorter one loads the processor
(tests/live/test_tracker_load.py); a longer one delays poses.
"""

_LEAST_RETRIES = 4
"""Least number of requests in a period, where that is short: at 400 Hz there is one in 0.6 ms. More load the processor;
fewer delay poses by up to a period. tests/live/test_tracker_load.py measures the load at 400 Hz.
"""

_EARLY_PART = 3
"""One part in this number of a period by which a request may come early, and which a reply may fill without making
early requests rare. More room asks in vain more often; less leaves the bound of the device's clock wider. Not measured.
"""

_RISKED = 0.1
"""Share of requests that come early where a reply fills over a third of the period. Each of them may cost a pose;
without any, nothing bounds the device's clock from below. Not measured.
"""


class Polling:
    """Decides when to send the next request. next_ns: when it is due. freshness, handle: those of the probe's tool."""

    def __init__(self, link: Link, agreed: Agreed, freshness: Freshness, handle: int) -> None:
        self.next_ns = 0
        self._link, self._exchange, self._freshness, self._handle = link, agreed.exchange, freshness, handle
        self._repeats, self._details = agreed.dialect.repeats, agreed.details
        self._request_ns = link.transfer_ns(len(agreed.dialect.request(False)))
        self._random = random.Random(0)
        self._since_details = 0
        self._backward = 0

    def ask(self) -> Answer:
        """Returns the next reply, with details of the markers ten times a second. Raises DeviceLost."""
        interval = max(1, round(_DETAILS_S * 1e9 / self._freshness.period_ns))
        detailed = self._details and self._since_details >= interval
        try:
            answer = self._exchange.ask(detailed, self._refuse_old)
        except RefusedError as error:
            raise lost_by_protocol(error, self._link.where) from error
        if detailed and self._handle in answer.snapshot.tools:
            self._since_details = 0
        return answer

    def after_doubt(self, arrival_ns: int) -> None:
        """Plans the request that confirms a pose: at once where the device repeats the pose."""
        self.next_ns = arrival_ns + _RETRY_NS * (not self._repeats)

    def after_nothing_new(self, arrival_ns: int) -> None:
        """Plans the request after one that came too early: in a part of the period."""
        self.next_ns = arrival_ns + min(_RETRY_NS, round(self._freshness.period_ns / _LEAST_RETRIES))

    def after_new(self, measured: Stamp, arrival_ns: int, early_ns: float) -> None:
        """Plans the request for when the next measurement is due, or sooner while that is not known.

        Requests are spread over early_ns, the time in which the measurement may become available: a request that comes
        too early bounds the device's clock from below, one that finds the measurement bounds it from above. Where
        replies are so long that there is no time for a second request, only some requests take that risk.
        """
        self._since_details += 1
        period_ns = self._freshness.period_ns
        if self._freshness.learning:
            self.next_ns = arrival_ns + _RETRY_NS
            return
        early_ns = min(early_ns, period_ns / _EARLY_PART)
        hurried = self._exchange.reply_ns > period_ns / _EARLY_PART and self._random.random() > _RISKED
        early_ns *= 0.0 if hurried else self._random.random()
        self.next_ns = measured.t_ns + round(period_ns - early_ns) - self._request_ns

    def _refuse_old(self, snapshot: Snapshot) -> None:
        """Raises ProtocolError for an old reply that came late: the device's clock runs backward in it. If that
        persists, the device has restarted its clock.
        """
        reading = snapshot.tools.get(self._handle)
        older = reading is not None and self._freshness.is_old(reading)
        self._backward = self._backward + 1 if older else 0
        if 0 < self._backward < _BACKWARD_READINGS:
            raise ProtocolError("an old reply came once more", self._link.where)
