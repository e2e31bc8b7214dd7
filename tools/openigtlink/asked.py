"""Tracks which pictures and poses a client has asked for: all from now on, or the next one. Pure."""

from typing import NamedTuple

from probewatch.drivers.openigtlink.content import NOT_FOUND, NOT_PRESENT, Status
from probewatch.drivers.openigtlink.message import Message
from probewatch.tools.openigtlink.replies import refusal, reply

_ONCE_S = 5.0
"""Seconds for which a request for the next picture or pose waits before it is answered that none comes: as long as a
client of the feed waits for its first message. Not measured."""

_GRANTED, _DENIED = b"\0", b"\1"
"""Content of RTS_…, by the specification."""


class Names(NamedTuple):
    """Names the devices of what is passed through. pose: that of the transform sensor → tracker."""

    image: str
    pose: str


USUAL_NAMES = Names("Image", "ProbeToTracker")
"""Names as PLUS gives them."""


class Asked:
    """Tracks the requests of one client. streams: types that are sent until the client stops them, IMAGE and TRANSFORM.
    started: those of them that it started itself.
    """

    def __init__(self, names: Names, streams: frozenset[str] = frozenset()) -> None:
        self.names, self.streams, self.started = names, streams, frozenset[str]()
        self._once: dict[str, float] = {}

    @property
    def kinds(self) -> frozenset[str]:
        """Returns the types that the client waits for now."""
        return self.streams | self._once.keys()

    def concerns(self, message: Message) -> bool:
        """Returns whether a message asks for pictures or poses. GET_TRANS of any other name asks for a calibration."""
        command, _, what = message.kind.partition("_")
        if command == "GET" and _KINDS.get(what) == "TRANSFORM":
            return message.device == self.names.pose
        return command in ("GET", "STT", "STP") and what in _KINDS

    def answer(self, message: Message, has_place: bool, now_s: float) -> Message | None:
        """Returns the answer; None where the data that were asked for are the answer. has_place: whether the client may
        be sent pictures.
        """
        command, _, what = message.kind.partition("_")
        kind = _KINDS[what]
        named = message.device in ("", self.names.image if kind == "IMAGE" else self.names.pose)
        granted = command == "STP" or (named and (has_place or kind != "IMAGE"))
        if command == "GET":
            if not granted:
                words = "too many look at pictures already" if named else f"there is only {self.names.image}"
                return refusal(message, NOT_FOUND, words)
            self._once[kind] = now_s + _ONCE_S
            return None
        if granted:
            started = command == "STT"
            self.streams = self.streams | {kind} if started else self.streams - {kind}
            self.started = self.started | {kind} if started else self.started - {kind}
        return reply(message, f"RTS_{what}", _GRANTED if granted else _DENIED)

    def given(self, kind: str) -> None:
        """Records that data of this type were queued for the client."""
        self._once.pop(kind, None)

    def overdue(self, now_s: float) -> tuple[str, ...]:
        """Returns the device names of what was asked for once and did not come, which is waited for no longer."""
        late = tuple(kind for kind, until_s in self._once.items() if now_s > until_s)
        for kind in late:
            del self._once[kind]
        return tuple(self.names.image if kind == "IMAGE" else self.names.pose for kind in late)


_KINDS = {"IMAGE": "IMAGE", "TRANS": "TRANSFORM", "TRANSFORM": "TRANSFORM"}
"""Names by which questions state a type → the type, by the specification and as PLUS writes it."""


def nothing_comes(device: str, why: str, version: int) -> Message:
    """Returns the STATUS which reports that neither pictures nor poses come at present; its code is never OK."""
    text = why or "the service hands on none"
    return Message("STATUS", device, Status(NOT_PRESENT, 0, "nothing comes", text).content, version=version)
