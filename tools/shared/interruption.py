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
    """Inside, Ctrl-C, SIGTERM and SIGHUP raise SystemExit with exit code 128 + signal, after `what` was being run is
    printed on stderr; further signals have no effect.
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
    """What was stopped, and what is the outcome. word: "stopped" in the language of that."""

    def __init__(self, outcome: str, word: str = "stopped") -> None:
        super().__init__(outcome)
        self.word = word


@contextmanager
def stopped_saying(tell: str | Callable[[], str], word: str = "stopped") -> Iterator[None]:
    """Inside, Ctrl-C, the end of the input and a declined question raise Stopped with the outcome, which `tell`
    returns; a message set by an inner block takes precedence. word: as of Stopped.
    """
    try:
        yield
    except (KeyboardInterrupt, EOFError, click.Abort) as error:
        if isinstance(error, click.Abort) and error.args:
            raise
        raise Stopped(tell if isinstance(tell, str) else tell(), word) from None
