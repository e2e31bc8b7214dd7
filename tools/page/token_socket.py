"""Serves one-time tokens of the page to the tool: on a Unix socket that the group of the control socket may use.

A token lets a browser request a recalibration, so a user who may only view gets none.
"""

import json
import pwd
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from probewatch.appliance.service.control.rights import join_group
from probewatch.appliance.service.control.server import ControlRefused, ControlServer, Owner, Peer, Reply
from probewatch.appliance.service.host.unix_socket import Lines, connected
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.printable import printable
from probewatch.tools.shared.threaded import Threaded

_EVERY_S = 0.05
"""Seconds between two looks for requests: a person waits no longer. More often is work for nothing."""
_ANSWER_S = 2.0
"""Seconds for a running page to answer whole: forty looks."""
_MOST_BYTES = 4096
"""Bytes of an answer at most; one has some 100."""


class Door(Threaded):
    """Serves `path` while the block runs. invite: makes (token, URL) for a user, whose name the kernel gives.
    onlookers: ids of users who get none. Raises ConfigurationError, DeviceLost where it cannot.
    """

    def __init__(
        self, path: Path, group: str, invite: Callable[[str], tuple[str, str]], onlookers: frozenset[int] = frozenset()
    ) -> None:
        owner = Owner("page", "End that page, or give this one another --door", f"--door {path}")
        self._server, self._invite, self._onlookers = ControlServer(path, group, owner=owner), invite, onlookers
        self._ended = threading.Event()
        super().__init__("door")

    def close(self) -> None:
        """Ends the thread, and closes the socket."""
        self._ended.set()
        self._thread.join()
        self._server.close()

    def _run(self) -> None:
        while not self._ended.wait(_EVERY_S):
            self._server.poll(self._answer)

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> Reply:
        if do != "token":
            raise ControlRefused("only a token can be asked for here")
        if who.uid in self._onlookers:
            raise ControlRefused(f"{_name(who.uid)} may look on alone (viewers of [control] and [feed])")
        token, url = self._invite(_name(who.uid))
        return {"token": token, "url": url}


def invitation(path: Path) -> tuple[str, str]:
    """Returns (token, URL) from the page that runs here. Raises DeviceLost."""
    try:
        with connected(path, _ANSWER_S) as link:
            link.sendall(b'{"v": 1, "do": "token"}\n')
            said = json.loads(Lines(link, _MOST_BYTES).next(_ANSWER_S))
        if said.get("ok") is False:
            raise DeviceLost(f"the page gives no token: {printable(str(said.get('error')))}", str(path))
        return str(said["token"]), str(said["url"])
    except PermissionError:
        raise DeviceLost("your user may not ask the page for a token", str(path), join_group(path)) from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        why = error.strerror if isinstance(error, OSError) else None
        what = f"no page answers ({why or printable(str(error)) or 'nothing'})"
        remedy = f"Start it: systemctl start probewatch-page, or: probewatch page --door {path}"
        raise DeviceLost(what, str(path), remedy) from None


def _name(uid: int) -> str:
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return f"uid {uid}"
