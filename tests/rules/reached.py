"""Pytest's part of a run that notes which test runs which lines, and how long it takes."""

import sys
import time
from collections.abc import Callable, Collection, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType

import pytest

Line = tuple[str, int]
"""(path of a file, number of a line in it)."""
Tracer = Callable[[FrameType, str, object], object]


@dataclass(slots=True)
class Reach:
    """Lines that one test ran, and the processor time that it took."""

    lines: set[Line] = field(default_factory=set)
    took_s: float = 0.0


class Reached:
    """Plugin: lines of `files`, by the name of the test that runs them or whose fixtures do, and those that run before
    any test does. share of shares: only every shares-th test runs, from that one on.
    """

    def __init__(self, files: Collection[str], share: int = 0, shares: int = 1) -> None:
        self._files, self._share, self._shares = frozenset(files), share, shares
        self.by_test: dict[str, Reach] = {}
        self.at_import: set[Line] = set()

    @pytest.hookimpl(wrapper=True)
    def pytest_collection(self) -> Generator[None, object, object]:
        with self._noting(self.at_import):
            return (yield)

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = items[self._share :: self._shares]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        reach = self.by_test[item.nodeid] = Reach()
        began_s = time.process_time()
        with self._noting(reach.lines):
            result = yield
        reach.took_s = time.process_time() - began_s
        return result

    @contextmanager
    def _noting(self, lines: set[Line]) -> Iterator[None]:
        def inside(frame: FrameType, event: str, argument: object) -> Tracer:
            lines.add((frame.f_code.co_filename, frame.f_lineno))
            return inside

        def entering(frame: FrameType, event: str, argument: object) -> Tracer | None:
            return inside if frame.f_code.co_filename in self._files else None

        sys.settrace(entering)
        try:
            yield
        finally:
            sys.settrace(None)
