"""Lets a process end in its own time after SIGTERM or SIGINT."""

import signal
from collections.abc import Iterable
from threading import Event


def termination(numbers: Iterable[int] = (signal.SIGTERM, signal.SIGINT)) -> Event:
    """Returns an event that these signals set from now on instead of ending the process. For the main thread only."""
    stop = Event()
    for number in numbers:
        signal.signal(number, lambda *_: stop.set())
    return stop
