"""Lets one client recalibrate at a time, and only while its connection lives.

A second client that began would end the first one's scan, or take over a cart that has just been verified; so it is
refused, with the name of the holder. A page that was killed or hangs cannot end what it began, and nobody would know
why the cart does not monitor: once its connection is gone, or silent for too long, the recalibration is given up.
Giving up does not close the contact: the previous reference is in force again, and has to be verified again by motion.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from probewatch.appliance.service.control.server import ControlRefused, Peer
from probewatch.appliance.service.host.log import get_log
from probewatch.appliance.storage.alarm_chain import Event

SHORTEST_S, LONGEST_S = 1.0, 3600.0
"""s, bounds of the silence that a client may ask for. Less gives up when the computer is busy; more protects nobody."""


@dataclass(slots=True)
class _Begun:
    """Describes the recalibration that was begun. who: in words. hold_s: s, longest silence of the connection that it
    depends on; None when it depends on none. given: a new calibration was taken, and is being verified. ended: why it
    was given up.
    """

    peer: Peer
    who: str
    hold_s: float | None
    began_ns: int
    heard_ns: int
    given: bool = False
    ended: str | None = None


class Hold:
    """Tracks who recalibrates. abort: gives the recalibration up. note: adds an entry to the alarm log. is_open:
    returns whether the connection of that number is open.
    """

    def __init__(self, abort: Callable[[], None], note: Callable[..., None], is_open: Callable[[int], bool]) -> None:
        self._abort, self._note, self._is_open = abort, note, is_open
        self._begun: _Begun | None = None
        self._log = get_log()

    def refuse_other(self, peer: Peer, now_ns: int, begins: bool = False) -> None:
        """Raises ControlRefused while another client recalibrates. begins: the request begins a recalibration. One that
        depends on no connection may be ended by anybody, but not begun a second time.
        """
        begun = self._held_by_another(peer, now_ns)
        if begun is None or (begun.hold_s is None and not begins):
            return
        for_s = (now_ns - begun.began_ns) / 1e9
        if begun.given:
            raise ControlRefused(
                f"{begun.who} has recalibrated for {for_s:.0f} s, and the new calibration is being verified. "
                "Move the probe over tissue, or have it ended there"
            )
        if begun.hold_s is None:
            raise ControlRefused(
                f"{begun.who} has recalibrated for {for_s:.0f} s. Wait, or end that first: abort-recalibration"
            )
        raise ControlRefused(
            f"{begun.who} has recalibrated for {for_s:.0f} s. Wait, or end it there; it is given up once that "
            f"process is gone, or silent for {begun.hold_s:g} s"
        )

    def begin(self, peer: Peer, who: str, hold_s: float | None, now_ns: int) -> None:
        """Records that a recalibration begins. hold_s: s, longest silence of its connection; None: it needs none."""
        self._begun = _Begun(peer, who, hold_s, now_ns, now_ns)

    @property
    def link(self) -> int | None:
        """Returns the number of the connection that the recalibration depends on; None when there is none."""
        begun = self._begun
        return None if begun is None or begun.ended is not None or begun.hold_s is None else begun.peer.link

    def hear(self, peer: Peer, now_ns: int) -> None:
        """Records that this connection has sent a request."""
        if self._begun is not None and self._begun.peer.link == peer.link:
            self._begun.heard_ns = now_ns

    def give(self) -> None:
        """Records that a new calibration was taken. The service now verifies it by itself; no other client begins a
        recalibration while the one that gave it waits.
        """
        if self._begun is not None:
            self._begun.given = True

    @property
    def scans(self) -> bool:
        """Returns whether a recalibration has begun and no new calibration was taken yet."""
        return self._begun is not None and not self._begun.given

    def release(self) -> None:
        """Releases the hold when a person has given the recalibration up."""
        self._begun = None

    def look(self, now_ns: int, recalibrating: bool) -> None:
        """Checks the holder's connection, once a tick. recalibrating: whether that is the state in force."""
        begun = self._begun
        if begun is None or begun.ended is not None:
            return
        if not recalibrating:
            self._begun = None  # verified, or a device was lost, for example; the holder begins again
            return
        lost = self._lost(begun, now_ns)
        if lost and begun.given:
            self._begun = None
        elif lost:
            self._give_up(begun, lost)

    def _held_by_another(self, peer: Peer, now_ns: int) -> _Begun | None:
        begun = self._begun
        if begun is None or begun.ended is not None or _same(begun.peer, peer) or self._lost(begun, now_ns):
            return None
        return begun

    def _lost(self, begun: _Begun, now_ns: int) -> str:
        """Returns how the holder was lost; empty while it is present. While it scans, a holder that depends on no
        connection counts as present.
        """
        if begun.hold_s is None:
            return "who hangs on no connection" if begun.given else ""
        if not self._is_open(begun.peer.link):
            return "whose connection is gone"
        silent = now_ns - begun.heard_ns > begun.hold_s * 1e9
        return f"who has been silent for {begun.hold_s:g} s" if silent else ""

    def _give_up(self, begun: _Begun, how: str) -> None:
        begun.ended = f"given up for {begun.who}, {how}; the calibration is as before, and not verified"
        self._log.warning("recalibration given up", why=begun.ended)
        self._note(Event.GIVEN_UP, who=begun.who, why=begun.ended)
        self._abort()

    def fields(self, peer: Peer, now_ns: int, recalibrating: bool, monitoring: bool) -> dict[str, Any] | None:
        """Returns the fields that docs/control.md describes, for this peer.

        What was given up is reported until the cart monitors again.
        """
        begun = self._begun
        if begun is None or monitoring or not (recalibrating or begun.ended):
            return None
        return {
            "who": begun.who,
            "yours": begun.ended is None and _same(begun.peer, peer),
            "since_s": (now_ns - begun.began_ns) / 1e9,
            "hold_s": begun.hold_s,
            "silent_s": None if begun.hold_s is None else (now_ns - begun.heard_ns) / 1e9,
            "ended": begun.ended,
        }


def _same(one: Peer, other: Peer) -> bool:
    """Returns whether both are the same connection, or are of the same process as far as the kernel identifies it."""
    return one.link == other.link or (0 != one.pid == other.pid and one.uid == other.uid)


def hold_s_of(asked: object) -> float | None:
    """Returns the hold_s of a request, s, or None. Raises ControlRefused when it is invalid."""
    if asked is None:
        return None
    if isinstance(asked, bool) or not isinstance(asked, int | float) or not SHORTEST_S <= asked <= LONGEST_S:
        raise ControlRefused(f"hold_s must be {SHORTEST_S:g} to {LONGEST_S:g} seconds")
    return float(asked)
