"""Counts delays by length since the start; the counts of any period can later be derived from two readings."""

from bisect import bisect_left
from collections.abc import Sequence
from typing import Any


class DelayHistogram:
    """Counts delays. One thread may note, any other may read.

    bounds_ms: upper bounds, ascending; longer delays have a count of their own.
    """

    def __init__(self, bounds_ms: Sequence[float]) -> None:
        self._bounds_ms = tuple(bounds_ms)
        self._counts = [0] * (len(self._bounds_ms) + 1)
        self._sum_ms = 0.0

    def note(self, delay_ms: float) -> None:
        """Counts a delay; one that equals a bound belongs to the count below it."""
        self._counts[bisect_left(self._bounds_ms, delay_ms)] += 1
        self._sum_ms += delay_ms

    def fields(self) -> dict[str, Any]:
        """Returns the fields for the status: `le_ms`, one count more than bounds in `counts`, and `sum_ms`."""
        return {"le_ms": list(self._bounds_ms), "counts": list(self._counts), "sum_ms": round(self._sum_ms, 3)}
