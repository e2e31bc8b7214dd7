"""Handles one connection to the page. A client that asks nothing, or takes nothing, for some seconds loses its place;
at once, where all places are taken. Where all wait for an answer, the address that has most places gives up one of
them; the answers to each address are limited in rate.
"""

import asyncio
from collections import Counter
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

from probewatch.tools.page.pace import Pace

MOST_AT_ONCE = 64
"""Connections at once: six of each of eight browsers, and some. More takes memory from the cart."""
EVENTS = "/events"
"""Path of the stream that sends a page its status."""
MOST_LISTENERS = 16
"""Browsers that are sent events at once; each costs some 30 kB/s. To admit one more, one of an address that has two
more is disconnected, else the new one is asked to come later."""
_PICTURES_HZ = 10.0
"""Pictures a second of one browser: tools/page/pictures.py."""
_SILENT_S = 5.0
"""Seconds for a client to send a whole request. Less drops one on a busy computer; more keeps a place for nobody."""
_ASLEEP_S = 10.0
"""Seconds for a client to take what waits for it, so that less than 64 KiB are left. Less drops a slow network; more
keeps a place for nobody."""


class Connection(H11Protocol):
    """Extends uvicorn's connection, whose own deadline begins with the first answer and ends with the next byte.

    pace: that of all connections; all browsers that are sent events, with their pictures, may share one address. most:
    connections at once. uvicorn's own limit also counts the tasks of those that were disconnected.
    """

    most = MOST_AT_ONCE

    pace = Pace(MOST_LISTENERS * _PICTURES_HZ)

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._deadline: asyncio.TimerHandle | None = None
        self._turn: asyncio.TimerHandle | None = None
        self.idle_since_s, self.has_asked = self.loop.time(), False
        self.asked_s = 0.0

    @property
    def address(self) -> str:
        """Returns the address of the other end."""
        return "" if self.client is None else self.client[0]

    @property
    def asks(self) -> bool:
        """Returns whether it waits for an answer."""
        return self.cycle is not None and not self.cycle.response_complete

    @property
    def keeps_place(self) -> bool:
        """Returns whether it has sent a whole request; one that has sent the head of it, and no body, has not."""
        return self.asks and not self.cycle.more_body

    @property
    def listens(self) -> bool:
        """Returns whether it is sent events, which do not end."""
        return self.asks and self.scope["path"] == EVENTS

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # as uvicorn has it
        """Begins the deadline, and drops a connection where there are too many."""
        super().connection_made(transport)
        self._allow(_SILENT_S)
        self._make_room()

    def connection_lost(self, exc: Exception | None) -> None:
        """Ends the deadline and what still runs for this connection."""
        self._end_deadline()
        if self._turn is not None:
            self._turn.cancel()
        super().connection_lost(exc)

    def handle_events(self) -> None:
        """Handles a request in the turn of its address. A whole request ends the deadline; a part does not move it."""
        if self._turn is not None:
            return
        begins = not self.asks and bool(self.conn.trailing_data[0])
        wait_s = self.pace.wait_s(self.address, self.loop.time()) if begins else 0.0
        if wait_s > 0:
            self.flow.pause_reading()
            self._turn = self.loop.call_later(wait_s, self._take_turn)
            return
        self._handle()

    def on_response_complete(self) -> None:
        """Begins the deadline again for the next request."""
        self.idle_since_s = self.loop.time()
        super().on_response_complete()
        if not self.asks:
            self._allow(_SILENT_S)

    def _take_turn(self) -> None:
        self._turn = None
        if not self.transport.is_closing():
            self.flow.resume_reading()
            self._handle()

    def _handle(self) -> None:
        asked = self.asks
        super().handle_events()
        if self.asks:
            self.asked_s = self.asked_s if asked else self.loop.time()
            self.has_asked = self.has_asked or self.keeps_place
            self._end_deadline()

    def pause_writing(self) -> None:
        """Begins a deadline, as the client does not take what is sent."""
        super().pause_writing()
        self._allow(_ASLEEP_S)

    def resume_writing(self) -> None:
        """Ends that deadline, as the client takes data again."""
        super().resume_writing()
        if self.asks:
            self._end_deadline()
        else:
            self._allow(_SILENT_S)

    def give_up(self) -> None:
        """Closes the connection, whatever waits."""
        if not self.transport.is_closing():
            self.transport.abort()

    def _make_room(self) -> None:
        """Drops clients of the address that has most places: first one that has asked nothing, then the one that has
        been idle longest, then the one that has waited longest for an answer; the newcomer itself, where its own
        address has most and none of these exists.
        """
        there = [one for one in self.connections if isinstance(one, Connection) and not one.transport.is_closing()]
        held = Counter(one.address for one in there)
        others = [one for one in there if one is not self and held[one.address] >= held[self.address]]
        idle = [one for one in others if not one.keeps_place]
        leave = sorted(idle, key=lambda one: (-held[one.address], one.has_asked, one.idle_since_s))
        waiting = [one for one in others if one.keeps_place and not one.listens]
        leave += sorted(waiting, key=lambda one: (-held[one.address], one.asked_s))
        for one in [*leave, self][: max(0, len(there) - self.most)]:
            one.give_up()

    def _allow(self, seconds: float) -> None:
        self._end_deadline()
        if not self.transport.is_closing():
            self._deadline = self.loop.call_later(seconds, self.give_up)

    def _end_deadline(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
