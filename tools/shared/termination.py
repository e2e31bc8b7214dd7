"""The end of a process by SIGTERM or SIGINT."""

import signal
from collections.abc import Iterable
from threading import Event


def termination(numbers: Iterable[int] = (signal.SIGTERM, signal.SIGINT)) -> Event:
    """Returns an event that these signals set from now on in place of ending the process. For the main thread."""
    stop = Event()
    for number in numbers:
        signal.signal(number, lambda *_: stop.set())
    return stop
