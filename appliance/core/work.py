"""Work in pieces, so that no picture has to wait for the whole of it."""

from collections.abc import Generator
from typing import TypeVar

Result = TypeVar("Result")
Work = Generator[int, None, Result]
"""Yields before each piece what that piece costs, µs; returns the result. Counted from the sizes of its arrays and never
timed, so that live and replay are cut alike.
"""


def whole(work: Work[Result]) -> Result:
    """All pieces at once."""
    while True:
        try:
            next(work)
        except StopIteration as done:
            result: Result = done.value
            return result
