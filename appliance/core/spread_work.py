"""Runs computations in steps, so that no picture has to wait for the whole of one.

A computation yields the cost of each step before the step is done. Costs are counted from the sizes of arrays and never
timed, so that a recording is cut where it was cut live, on any computer.
"""

from collections.abc import Generator
from typing import NamedTuple, TypeVar

Result = TypeVar("Result")
Steps = Generator[int, None, Result]
"""Computation in steps, which yields before each its cost, µs, and returns the result."""


class Cost(NamedTuple):
    """Represents the cost of a step, µs: a part for any size, and a part for each picture (of a round: for each pair of
    blocks).
    """

    base_us: float
    each_us: float = 0.0

    def of(self, count: int = 0) -> int:
        """Returns the cost, µs, of a step of that size; without one where it does not matter."""
        return round(self.base_us + self.each_us * count)


# Costs, µs of processor time a step: means over windows of up to 200 blocks in 20 s of rendered sweep on one core. Over
# other sessions (four of a minute, paths without pictures) the sum was within 2 % of the time taken, and no step took
# more than 6.4 ms. A cost that is too small delays the picture at which the step is done, one that is too large makes
# solutions ready later. Only their ratios matter: a slower computer is slower with the pictures by the same factor.
LATENCY, SAMPLES = Cost(1000, 3.3), Cost(150, 0.3)
"""Cost of the search for the lag of two paths, and of the poses at the times of the pictures; µs, and µs a picture,
measured as above.
"""
RESIDUAL, ROUND = Cost(200, 1.0), Cost(250, 0.05)
"""Cost of what a solution needs once, µs and µs a picture; and of each of its rounds, µs and µs a pair of blocks."""
MISFIT, POLARITY = Cost(600, 0.5), Cost(850, 1.8)
"""Cost of the reference's misfit at one lag, and of weighing the four polarities; µs, and µs a picture, measured as
above.
"""
LAG, LAGS, CONVENTIONS = Cost(550), Cost(600), Cost(3000)
"""Cost of lags of the latest motion, of all motion that is considered, and with the poses read in other ways; µs,
measured as above.
"""
INNOVATIONS, TRIAL = Cost(1000, 2.7), Cost(1500)
"""Cost of the whitened disagreement of the sequential test, µs and µs a picture; and of one start of a change, µs.
Measured as above.
"""


def run_to_end(steps: Steps[Result]) -> Result:
    """Runs all steps at once, and returns their result."""
    while True:
        try:
            next(steps)
        except StopIteration as done:
            result: Result = done.value
            return result


class SpreadWork:
    """Runs a computation in steps, a share of it at a time. next_us: cost of its next step, µs; 0 before the first."""

    def __init__(self) -> None:
        self._steps: Steps[None] | None = None
        self.next_us = 0

    @property
    def under_way(self) -> bool:
        """Returns whether a computation has begun and is not done."""
        return self._steps is not None

    def begin(self, steps: Steps[None]) -> None:
        """Begins a computation; one that is under way is dropped."""
        self._steps, self.next_us = steps, 0

    def drop(self) -> None:
        """Drops the computation under way."""
        self._steps = None

    def go_on(self, most_us: int) -> None:
        """Runs the next step, and further steps while the total stays within `most_us`."""
        left_us = max(most_us, self.next_us)
        while self._steps is not None and self.next_us <= left_us:
            left_us -= self.next_us
            cost_us = next(self._steps, None)
            if cost_us is None:
                self._steps = None
            self.next_us = cost_us or 0

    def finish(self) -> None:
        """Runs all steps that are left."""
        while self.under_way:
            self.go_on(0)
