"""A real control socket that answers as the test wants: a status that a real service once gave, or anything else."""

import copy
import json
import threading
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from probewatch.appliance.service.control.server import ControlRefused, ControlServer, Peer

RECORDED: dict[str, Any] = json.loads((Path(__file__).parents[1] / "data" / "status.json").read_text())


def recorded(**fields: Any) -> dict[str, Any]:
    """The recorded status with other fields."""
    return {**copy.deepcopy(RECORDED), **fields}


class Answers(ABC):
    """Serves `path` while the block runs. mute: it says nothing, as one that hangs."""

    def __init__(self, path: Path) -> None:
        self.path, self.mute = path, False

    def __enter__(self) -> Self:
        self._end = threading.Event()
        self._server = ControlServer(self.path)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()
        self._server.close()

    def restart(self) -> None:
        """As when the service is killed, and is there again at once."""
        self.__exit__()
        self.__enter__()

    def _run(self) -> None:
        while not self._end.wait(0.002):
            if not self.mute:
                self._server.poll(self._answer)

    @abstractmethod
    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        """As `Answer`."""


class Answering(Answers):
    """Answers nothing but `status`. tell: makes each answer's status, with `changes`. asked: how often what was."""

    def __init__(self, path: Path, tell: Callable[..., dict[str, Any]] = recorded) -> None:
        super().__init__(path)
        self.tell = tell
        self.changes: dict[str, Any] = {}
        self.asked: Counter[str] = Counter()

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        self.asked[do] += 1
        if do != "status":
            raise ControlRefused("only the status is answered here")
        return {"status": self.tell(**self.changes)}
