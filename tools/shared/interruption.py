"""What a command says where somebody breaks it off."""

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


@contextmanager
def stopped_saying(tell: str | Callable[[], str]) -> Iterator[None]:
    """Inside, Ctrl-C, the end of the input and an answer that declines raise click.Abort with what has become of it, as
    `tell` says afterwards; what an inner block has told of it stays.
    """
    try:
        yield
    except (KeyboardInterrupt, EOFError, click.Abort) as error:
        if isinstance(error, click.Abort) and error.args:
            raise
        raise click.Abort(tell if isinstance(tell, str) else tell()) from None
