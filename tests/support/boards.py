"""Simulated relay boards behind a real pseudo-terminal, in this process."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import Any

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.twins.pty_line import PtyLine
from probewatch.drivers.twins.relay_board import RelayBoard


@contextmanager
def running_board(link: Path, clock: HostClock, *arguments: Any, **options: Any) -> Iterator[RelayBoard]:
    """A board that serves `link` while the block runs; arguments, options: of the board."""
    stop = Event()
    with PtyLine(link, clock) as line:
        board = RelayBoard(line, clock, *arguments, **options)
        thread = Thread(target=board.run, args=(stop,))
        thread.start()
        try:
            yield board
        finally:
            stop.set()
            thread.join()
