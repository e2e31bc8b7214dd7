"""A real control socket that answers `status` with one that a real service once gave, changed as the test wants."""

import copy
import json
import threading
from pathlib import Path
from typing import Any

from appliance.service.control.server import ControlRefused, ControlServer, Peer

RECORDED: dict[str, Any] = json.loads((Path(__file__).parents[1] / "data" / "status.json").read_text())


def recorded(**fields: Any) -> dict[str, Any]:
    """The recorded status with other fields."""
    return {**copy.deepcopy(RECORDED), **fields}


class Answering:
    """Serves `path` while the block runs. status: what it answers. mute: it says nothing, as one that hangs."""

    def __init__(self, path: Path) -> None:
        self.status = recorded()
        self.mute = False
        self.asked: list[str] = []
        self.path, self._end = path, threading.Event()

    def __enter__(self) -> "Answering":
        self._server = ControlServer(self.path)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()
        self._server.__exit__()

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        self.asked.append(do)
        if do != "status":
            raise ControlRefused("only the status is answered here")
        return {"status": self.status}

    def _run(self) -> None:
        while not self._end.wait(0.002):
            if not self.mute:
                self._server.poll(self._answer)
