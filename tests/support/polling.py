"""Waiting for what a real process does: look often, give up at a deadline."""

import time
from collections.abc import Callable
from typing import TypeVar

_T = TypeVar("_T")


def until(
    look: Callable[[], _T],
    deadline_s: float = 10.0,
    every_s: float = 0.005,
    otherwise: Callable[[], object] = lambda: "nothing",
) -> _T:
    """First true value of look(); AssertionError after deadline_s, with what `otherwise` found instead."""
    end_s = time.monotonic() + deadline_s
    while True:
        found = look()
        if found:
            return found
        assert time.monotonic() < end_s, f"after {deadline_s:g} s: {otherwise()}"
        time.sleep(every_s)
