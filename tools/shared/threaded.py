"""Provides the base class of objects that work in a thread of their own."""

import threading
from typing import Self

from probewatch.drivers.closable import Closable


class Threaded(Closable):
    """Runs `_run` in a thread of that name from the beginning of its `with` block; `close` must end the thread."""

    def __init__(self, name: str) -> None:
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def _run(self) -> None:
        raise NotImplementedError
