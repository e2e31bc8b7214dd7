"""Which pictures and poses a client has asked for: all from now on, or the next one. Pure."""

from typing import NamedTuple

from probewatch.drivers.openigtlink.content import NOT_FOUND, NOT_PRESENT, Status
from probewatch.drivers.openigtlink.message import Message
from probewatch.tools.openigtlink.replies import refusal, reply

_ONCE_S = 5.0
"""For which one who asked for the next picture or pose waits, until it is answered that none comes: as long as a client
of the feed waits for its first word. Not measured."""

_GRANTED, _DENIED = b"\0", b"\1"
"""Of RTS_…, by the specification."""


class Names(NamedTuple):
    """Device names of what is passed through. pose: of the transform sensor → tracker."""

    image: str
    pose: str


USUAL_NAMES = Names("Image", "ProbeToTracker")
"""In PLUS's manner."""


class Asked:
    """streams: types that come until it says stop, IMAGE and TRANSFORM. started: those of them that it asked for."""

    def __init__(self, names: Names, streams: frozenset[str] = frozenset()) -> None:
        self.names, self.streams, self.started = names, streams, frozenset[str]()
        self._once: dict[str, float] = {}

    @property
    def kinds(self) -> frozenset[str]:
        """Types that it waits for now."""
        return self.streams | self._once.keys()

    def concerns(self, message: Message) -> bool:
        """Whether it asks for pictures or poses. GET_TRANS of any other name asks for a calibration."""
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
        """One of them was put to it."""
        self._once.pop(kind, None)

    def overdue(self, now_s: float) -> tuple[str, ...]:
        """Device names of what it asked for once and that did not come; it is waited for no longer."""
        late = tuple(kind for kind, until_s in self._once.items() if now_s > until_s)
        for kind in late:
            del self._once[kind]
        return tuple(self.names.image if kind == "IMAGE" else self.names.pose for kind in late)


_KINDS = {"IMAGE": "IMAGE", "TRANS": "TRANSFORM", "TRANSFORM": "TRANSFORM"}
"""How questions name a type → the type, by the specification and as PLUS writes it."""


def nothing_comes(device: str, why: str, version: int) -> Message:
    """That neither pictures nor poses come at present; never OK."""
    text = why or "the service hands on none"
    return Message("STATUS", device, Status(NOT_PRESENT, 0, "nothing comes", text).content, version=version)
