"""Defines the request of a client of the feed, one line of JSON."""

import json
from dataclasses import dataclass
from typing import Any

from probewatch.appliance.service.feed.message import VERSION
from probewatch.appliance.service.host.request_line import request_fields, unknown_fields
from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.printable import printable

LONGEST_LINE = 4096
"""Bytes, as for the control socket; a request has some 80."""
_MOST_EVERY, _LEAST_PX, _MOST_PX = 1000, 16, 16_384
"""Bounds of `every`, at most one picture in half a minute at 30 Hz, and of the sides of a picture, px, which are those
of the configuration.
"""


@dataclass(frozen=True, slots=True)
class FeedRequest:
    """Holds what a client wants. `pictures` states whether frames are sent. `every` selects one frame of this many.
    `most_px` limits the longest side of a picture, which is averaged over whole blocks of pixels to fit; None leaves
    the size unchanged. `ignored` lists fields that mean nothing here.
    """

    pictures: bool = True
    every: int = 1
    most_px: int | None = None
    ignored: tuple[str, ...] = ()

    def line(self) -> bytes:
        """Returns the request as the line that is sent."""
        asked = {"v": VERSION, "pictures": self.pictures, "every": self.every, "most_px": self.most_px}
        return json.dumps(asked).encode() + b"\n"


def request_of(line: bytes) -> FeedRequest:
    """Parses a request. Raises ProtocolError with a message for the client."""
    try:
        asked = request_fields(line, VERSION)
    except ValueError as error:
        raise _refused(str(error)) from None
    pictures, every, most_px = asked.get("pictures", True), asked.get("every", 1), asked.get("most_px")
    if not isinstance(pictures, bool):
        raise _refused(f"pictures is true or false, not {printable(repr(pictures))}")
    if not _whole(every, 1, _MOST_EVERY):
        raise _refused(f"every is a whole number, 1 … {_MOST_EVERY}, not {printable(repr(every))}")
    if most_px is not None and not _whole(most_px, _LEAST_PX, _MOST_PX):
        raise _refused(f"most_px is null or a whole number, {_LEAST_PX} … {_MOST_PX}, not {printable(repr(most_px))}")
    return FeedRequest(pictures, every, most_px, unknown_fields(asked, ("pictures", "every", "most_px")))


def _whole(value: Any, least: int, most: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and least <= value <= most


def _refused(why: str) -> ProtocolError:
    return ProtocolError(why, "feed", 'Send one line such as {"v": 1}; docs/feed.md has the fields')
