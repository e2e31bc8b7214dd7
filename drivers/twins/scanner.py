"""Simulates a scanner with a video output for `sim:PATH`, and prints what changes."""

import socket
import stat
import time
from math import ceil
from pathlib import Path
from threading import Event
from typing import Self

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable
from probewatch.drivers.samples import GreyImage
from probewatch.drivers.twins.events import Events
from probewatch.drivers.twins.fault_control import FaultControl
from probewatch.drivers.twins.faults import FUTURE_S, blank_image, frozen_image
from probewatch.drivers.twins.scene.tank import PlaceOfWork
from probewatch.drivers.twins.scene.world import World
from probewatch.drivers.video.sim import pack_frame

_STAMP_ERR_NS = 1_000_000
"""Nanoseconds: bound that the frames state. Their times are exact; it represents what a grabber does not know of
them."""

_SEND_S = 0.5
"""Seconds for a viewer to take a frame. One that does not is dropped, or the next viewer's video would wait for it."""

_LONGEST_COST_S = 0.2
"""Seconds of the clock: cost of one frame at most. A frame that waited long for the processor would otherwise let the
scanner render so far ahead that it shows one picture in as many seconds, long after the processor is free again."""


class VideoPlug(Closable):
    """Represents the socket's server end: it has one viewer at a time, and the next one waits until that one is gone.

    path: replaced when an earlier scanner has left it; unlinked on leaving the context.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._door: socket.socket | None = None
        self._viewer: socket.socket | None = None

    def __enter__(self) -> Self:
        self.plug()
        return self

    def close(self) -> None:
        """See Closable."""
        self.unplug()

    def plug(self) -> None:
        """Listens, unless it already does."""
        if self._door is not None:
            return
        if self._path.exists() and stat.S_ISSOCK(self._path.stat().st_mode):
            self._path.unlink()
        self._door = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._door.bind(str(self._path))
        self._door.listen(1)
        self._door.setblocking(False)

    def unplug(self) -> None:
        """Refuses every new viewer, then drops the present one, as when the cable is pulled."""
        if self._door is not None:
            self._path.unlink(missing_ok=True)
        for line in (self._door, self._viewer):
            if line is not None:
                line.close()
        self._door = self._viewer = None

    def send(self, frame: bytes) -> bool:
        """Sends a frame. Returns False where there is no viewer; one that does not take a frame within half a second is
        dropped.
        """
        while self._viewer is not None or self._accept():
            assert self._viewer is not None
            try:
                self._viewer.sendall(frame)
                return True
            except OSError:
                self._viewer.close()
                self._viewer = None
        return False

    def _accept(self) -> bool:
        if self._door is None:
            return False
        try:
            self._viewer, _ = self._door.accept()
        except BlockingIOError:
            return False
        self._viewer.settimeout(_SEND_S)
        return True


class Scanner:
    """Renders ahead, sends on time, and numbers the frames by time, so one that was too late is a visible gap."""

    def __init__(self, world: World | PlaceOfWork, plug: VideoPlug, clock: HostClock, faults: FaultControl) -> None:
        self._world, self._plug, self._clock, self._faults = world, plug, clock, faults
        self._events = Events(clock)
        self._period_s = 1 / world.settings.fps
        self._cost_s = 0.0
        self._held: GreyImage | None = None
        self._active: frozenset[str] = frozenset()
        self._watched = False
        self._first: int | None = None
        self._last = 0
        self._sent = 0

    @property
    def account(self) -> dict[str, int]:
        """Returns how many frames were sent. sent: frames that a viewer took. skipped: numbers between the first and
        the last of them that no viewer took.
        """
        spanned = 0 if self._first is None else self._last - self._first + 1
        return {"sent": self._sent, "skipped": spanned - self._sent}

    def run(self, stop: Event) -> None:
        """Serves until stop is set."""
        number = -1
        while not stop.is_set():
            ready_s = (self._clock.now_ns() - self._clock.origin_ns) / 1e9 + self._cost_s
            number = max(number + 1, ceil(ready_s / self._period_s))
            self._show(number)

    def _show(self, number: int) -> None:
        t_s = number * self._period_s
        t_ns = self._clock.origin_ns + round(t_s * 1e9)
        active = self._faults.active(t_s)
        frame = None if "lose-video" in active else self._rendered(number, t_s, t_ns, active)
        self._clock.sleep_until(t_ns)
        self._events.faults(active, self._faults.new_refusal())
        self._active = active
        if frame is None:
            self._plug.unplug()
        else:
            self._plug.plug()
        watched = frame is not None and self._plug.send(frame)
        if watched:
            self._first, self._last = number if self._first is None else self._first, number
            self._sent += 1
        if watched != self._watched:
            self._events.note("watched", watched)
        self._watched = watched

    def _rendered(self, number: int, t_s: float, t_ns: int, active: frozenset[str]) -> bytes:
        """Returns the frame as the socket carries it, and remembers how long rendering takes, in seconds of the
        clock.
        """
        began_s = time.monotonic()
        if self._held is None or not active & {"freeze-video", "user-freeze"}:
            self._held = self._world.frame(t_s, number, active)
        image = frozen_image(self._held) if "user-freeze" in active else self._held
        if "flicker-blank" in active and number % 2:
            image = blank_image(image.shape, number)
        ahead_ns = round(FUTURE_S * 1e9) if "future-stamp" in active - self._active else 0
        frame = pack_frame(number, t_ns + ahead_ns, _STAMP_ERR_NS, image)
        cost_s = min((time.monotonic() - began_s) * self._clock.rate, _LONGEST_COST_S)
        self._cost_s += 0.2 * (cost_s - self._cost_s)
        return frame
