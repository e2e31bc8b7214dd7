"""What a process can do on a cart, found by trying. As a program it prints that, on a machine that has the package."""

import json
import socket
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from probewatch.appliance.service.feed.request import FeedRequest
from probewatch.tools.shared.feed import Feed

PLACES = {
    "/var/lib/probewatch": "alarm log",
    "/var/lib/probewatch-recorder": "recordings",
    "/var/lib/probewatch-page": "scans",
    "/var/lib/probewatch-reports": "reports",
    "/etc/probewatch": "configuration",
}
CONTENT = "content"
"""Name of the file by which it is tried whether a folder can be read."""
CONTROL, FEED, DOOR = "run/probewatch/control", "run/probewatch/feed", "run/probewatch-page/door"
REQUESTS = ("acknowledge", "lamp-test", "clear-bump")
"""Of those that harm nothing where they are granted."""


def everything(root: Path, requests: Iterable[str] = REQUESTS) -> set[str]:
    """What this process can do on the cart whose files lie under root."""
    found = {what for place, what in PLACES.items() if readable(root / place.removeprefix("/") / CONTENT)}
    found |= {"status"} if answered(root / CONTROL, "status") else set()
    found |= {"requests"} if any(answered(root / CONTROL, name) for name in requests) else set()
    found |= {"token"} if answered(root / DOOR, "token") else set()
    for name, pictures in (("feed", False), ("pictures", True)):
        with suppress(Exception):
            Feed(root / FEED, FeedRequest(pictures=pictures)).close()
            found.add(name)
    return found


def readable(file: Path) -> bool:
    with suppress(OSError):
        file.read_bytes()
        return True
    return False


def answered(path: Path, do: str) -> bool:
    """Whether it is done, or refused for what was said and not for who said it."""
    with suppress(OSError), socket.socket(socket.AF_UNIX) as link:
        link.settimeout(5)
        link.connect(str(path))
        link.sendall(json.dumps({"v": 1, "do": do, "seconds": 1, "reason": "x", "number": 1}).encode() + b"\n")
        reply = json.loads(link.makefile("rb").readline())
        return bool(reply["ok"]) or " may " not in reply["error"]
    return False


if __name__ == "__main__":
    print(json.dumps(sorted(everything(Path("/")))))
