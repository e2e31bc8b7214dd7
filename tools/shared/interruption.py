"""What a long computation says where somebody breaks it off."""

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_BREAK_OFF = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def said_when_interrupted(what: str) -> Iterator[None]:
    """Inside, Ctrl-C, SIGTERM and SIGHUP raise SystemExit with exit code 128 + signal, after `what` was being run is
    told on stderr; what more of them come changes nothing.
    """

    def end(number: int, _frame: FrameType | None) -> None:
        for one in _BREAK_OFF:
            signal.signal(one, signal.SIG_IGN)
        print(f"\ninterrupted by {signal.Signals(number).name}: {what}", file=sys.stderr, flush=True)
        raise SystemExit(128 + number)

    before = {one: signal.signal(one, end) for one in _BREAK_OFF}
    try:
        yield
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
