"""A recalibration that hangs on the connection of who began it: when that is gone, or silent too long, it is given up.

A page that was killed, or that hangs, cannot end what it began, and nobody would know why the cart does not monitor.
Giving up closes nothing: the reference before is in force, and has to be verified again by motion.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from appliance.service.control.server import ControlRefused, Peer
from appliance.service.host.log import get_log

SHORTEST_S, LONGEST_S = 1.0, 3600.0
"""Of the silence that who begins may ask for. Shorter gives up for a busy computer; longer is no guard."""


@dataclass(slots=True)
class _Begun:
    """who: in words. link: of the connection it hangs on, None where it hangs on none. ended: why it was given up."""

    who: str
    link: int | None
    hold_s: float | None
    heard_ns: int
    ended: str | None = None


class Hold:
    """abort: gives the recalibration up. note: adds an entry to the alarm log."""

    def __init__(self, abort: Callable[[], None], note: Callable[..., None]) -> None:
        self._abort, self._note = abort, note
        self._begun: _Begun | None = None
        self._log = get_log()

    def begin(self, peer: Peer, who: str, hold_s: float | None, now_ns: int) -> None:
        """hold_s: longest silence of that connection, s; None: the recalibration hangs on nothing."""
        self._begun = _Begun(who, None if hold_s is None else peer.link, hold_s, now_ns)

    def hear(self, peer: Peer, now_ns: int) -> None:
        """That connection has asked something."""
        if self._begun is not None and self._begun.link == peer.link:
            self._begun.heard_ns = now_ns

    def release(self) -> None:
        """What it was held for is over: taken, or given up by a person."""
        self._begun = None

    def look(self, now_ns: int, recalibrating: bool, is_open: Callable[[int], bool]) -> None:
        """Once a tick. recalibrating: the state in force. is_open: whether the connection of that number is."""
        begun = self._begun
        if begun is None or begun.link is None or begun.ended is not None or begun.hold_s is None:
            return
        if not recalibrating:
            begun.link = None  # a device was lost, say; who held it begins again
        elif not is_open(begun.link):
            self._give_up(begun, "whose connection is gone")
        elif now_ns - begun.heard_ns > begun.hold_s * 1e9:
            self._give_up(begun, f"who has been silent for {begun.hold_s:g} s")

    def _give_up(self, begun: _Begun, how: str) -> None:
        begun.ended = f"given up for {begun.who}, {how}; the calibration before is in force, and not verified"
        self._log.warning("recalibration given up", why=begun.ended)
        self._note("recalibration given up", who=begun.who, why=begun.ended)
        self._abort()

    def fields(self, now_ns: int, recalibrating: bool, monitoring: bool) -> dict[str, Any] | None:
        """As docs/control.md tells them; what was given up is told until the cart monitors again."""
        begun = self._begun
        if begun is None or monitoring or not (recalibrating or begun.ended):
            return None
        silent_s = None if begun.link is None else (now_ns - begun.heard_ns) / 1e9
        return {"who": begun.who, "hold_s": begun.hold_s, "silent_s": silent_s, "ended": begun.ended}


def hold_s_of(asked: object) -> float | None:
    """What a request says. Raises ControlRefused."""
    if asked is None:
        return None
    if isinstance(asked, bool) or not isinstance(asked, int | float) or not SHORTEST_S <= asked <= LONGEST_S:
        raise ControlRefused(f"hold_s must be {SHORTEST_S:g} to {LONGEST_S:g} seconds")
    return float(asked)
