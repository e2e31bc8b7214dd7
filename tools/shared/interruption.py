"""Reports what a command leaves behind when it is interrupted."""

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

import click

_BREAK_OFF = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def said_when_interrupted(what: str) -> Iterator[None]:
    """Makes Ctrl-C, SIGTERM and SIGHUP print their name and `what` on stderr, and then raise SystemExit with exit code
    128 + signal; further signals have no effect.
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


class Stopped(click.Abort):
    """Reports that a command was stopped, with the outcome. word: "stopped" in the language of the outcome."""

    def __init__(self, outcome: str, word: str = "stopped") -> None:
        super().__init__(outcome)
        self.word = word


@contextmanager
def stopped_saying(tell: str | Callable[[], str], word: str = "stopped") -> Iterator[None]:
    """Turns Ctrl-C, the end of the input and a declined question into Stopped with the outcome, which is `tell` or what
    it returns; a message set by an inner block takes precedence. word: that of Stopped.
    """
    try:
        yield
    except (KeyboardInterrupt, EOFError, click.Abort) as error:
        if isinstance(error, click.Abort) and error.args:
            raise
        raise Stopped(tell if isinstance(tell, str) else tell(), word) from None
