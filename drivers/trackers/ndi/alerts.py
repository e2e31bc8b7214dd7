"""Asks the device for its alerts, when a reply reports that there are new ones or when an active one may be over."""

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import DeviceLost, ProtocolError
from probewatch.drivers.trackers.ndi.exchange import Answer, Exchange
from probewatch.drivers.trackers.ndi.health import Health, HealthWatch
from probewatch.drivers.trackers.ndi.link import SilentError
from probewatch.drivers.trackers.ndi.session import Session
from probewatch.drivers.trackers.ndi.status_text import BUMPED

_SHARE_OF_DEADLINE = 0.5
"""Share of the deadline for one question about alerts, so that a tracking reply still fits before the deadline. More
loses the device together with the question; less gives up on slow replies.
"""

_UNANSWERED = 3
"""Questions in a row without an answer that lose the tracker: what it does not report may be grave. Fewer lose it for
two damaged replies (tests/drivers/trackers/ndi/test_tracker.py); each more leaves an unknown alert for half a deadline
longer.
"""


class Alerts:
    """Keeps the alerts of the device up to date. watch: what is known so far, including a bump before this session.
    deadline_ms: that of the tracker.
    """

    def __init__(
        self, session: Session, watch: HealthWatch, exchange: Exchange, deadline_ms: float, clock: HostClock
    ) -> None:
        self._session, self._watch, self._exchange, self._clock = session, watch, exchange, clock
        self._wait_s = _SHARE_OF_DEADLINE * deadline_ms / 1e3
        self._unanswered = 0

    @property
    def health(self) -> Health:
        """Returns the health of the device as a whole."""
        return self._watch.health

    def follow(self, answer: Answer) -> None:
        """Notes what a tracking reply reports, and asks for the rest. Raises DeviceLost.

        Tools that were plugged in or unplugged require a complete restart of the session.
        """
        if answer.snapshot.ports_changed:
            raise self._lost("a tool was plugged in or unplugged", "The connection is made again")
        self._watch.note(answer.snapshot, answer.detailed, answer.arrival_ns)
        if self._watch.asks_for_new():
            self._look_up("Info.Status.New Alerts")
        elif self._watch.asks_for_standing(answer.arrival_ns):
            self._look_up("Info.Status.Alerts")

    def clear_bump(self) -> None:
        """Clears the bump, after a person has checked the position sensor. Raises DeviceLost, ProtocolError."""
        self._session.clear_bump()
        self._watch.clear_bump()
        self._exchange.rest()

    def _look_up(self, name: str) -> None:
        """Asks for the alerts. A device that announces new alerts but does not list them counts as bumped, the gravest
        meaning.

        A single question without an answer does not mean that the device is silent; the next tracking reply decides
        that. But what it fails to report several times may be grave.
        """
        try:
            alerts = self._session.parameter(name, self._wait_s)
        except (ProtocolError, SilentError) as error:
            self._exchange.refused += 1
            self._unanswered += 1
            if self._unanswered >= _UNANSWERED:
                raise self._lost(f"the tracker does not report its alerts ({error.what})", error.remedy) from error
            return
        self._unanswered = 0
        if name == "Info.Status.Alerts":
            self._watch.note_standing(alerts, self._clock.now_ns())
        else:
            self._watch.note_new(BUMPED if alerts is None else alerts, self._clock.now_ns())
        self._exchange.rest()

    def _lost(self, what: str, remedy: str) -> DeviceLost:
        return DeviceLost(what, self._session.link.where, remedy)
