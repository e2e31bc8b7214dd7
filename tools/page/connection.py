"""One connection to the page: who asks nothing, or takes nothing, for some seconds loses the place; at once, where all
places are taken.
"""

import asyncio
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

_SILENT_S = 5.0
"""For a client to have sent a whole request. Less drops one on a busy computer; more keeps a place for nobody."""
_ASLEEP_S = 10.0
"""For a client to take what waits for it, so that less than 64 KiB are left. Less drops a slow network; more keeps a
place for nobody."""


class Connection(H11Protocol):
    """uvicorn's, whose own deadline begins with the first answer and ends with the next byte."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._deadline: asyncio.TimerHandle | None = None
        self.idle_since_s, self.has_asked = self.loop.time(), False

    @property
    def asks(self) -> bool:
        """Waits for an answer."""
        return self.cycle is not None and not self.cycle.response_complete

    @property
    def keeps_place(self) -> bool:
        """It has asked all of it; who sends the head of a request, and no body, has not."""
        return self.asks and not self.cycle.more_body

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # as uvicorn has it
        """Who has nothing to say makes room for it."""
        super().connection_made(transport)
        self._allow(_SILENT_S)
        self._make_room()

    def connection_lost(self, exc: Exception | None) -> None:
        """Nothing is waited for any more."""
        self._end_deadline()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """A whole request ends the deadline; a part of one does not move it."""
        super().data_received(data)
        if self.asks:
            self.has_asked = self.has_asked or self.keeps_place
            self._end_deadline()

    def on_response_complete(self) -> None:
        """For the next request the deadline begins anew."""
        self.idle_since_s = self.loop.time()
        super().on_response_complete()
        if not self.asks:
            self._allow(_SILENT_S)

    def pause_writing(self) -> None:
        """It does not take what is sent."""
        super().pause_writing()
        self._allow(_ASLEEP_S)

    def resume_writing(self) -> None:
        """It does again."""
        super().resume_writing()
        if self.asks:
            self._end_deadline()
        else:
            self._allow(_SILENT_S)

    def give_up(self) -> None:
        """Close it, whatever waits."""
        if not self.transport.is_closing():
            self.transport.abort()

    def _make_room(self) -> None:
        """uvicorn never gives the last place. Who has asked nothing leaves first, then who has been idle longest."""
        there = [one for one in self.connections if isinstance(one, Connection) and not one.transport.is_closing()]
        idle = [one for one in there if one is not self and not one.keeps_place]
        too_many = 0 if self.limit_concurrency is None else max(0, len(there) + 1 - self.limit_concurrency)
        for one in sorted(idle, key=lambda one: (one.has_asked, one.idle_since_s))[:too_many]:
            one.give_up()

    def _allow(self, seconds: float) -> None:
        self._end_deadline()
        if not self.transport.is_closing():
            self._deadline = self.loop.call_later(seconds, self.give_up)

    def _end_deadline(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
