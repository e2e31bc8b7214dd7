"""How the contract suites start each simulated device: rows beside the simulated device that they are about, in
`tests/support/simulated_*.py`, as RIGS (a process, over its own line) and LINES (in this process, with faults).
"""

import importlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from probewatch.drivers.clock.host_clock import HostClock


@dataclass(frozen=True, slots=True)
class Rig:
    """One source. start: folder → arguments of `probewatch simulate`. query: what its URL needs besides. is_variant:
    another way of a device that has a rig already, whose loss and return are not tried again.
    """

    name: str
    scheme: str
    kind: str
    start: Callable[[Path], list[str]]
    query: str = ""
    is_variant: bool = False


class Bench(Protocol):
    """A simulated device in a thread."""

    @property
    def clock(self) -> HostClock: ...
    def show(self, *faults: str) -> None:
        """Exactly these from now on."""

    def is_back(self) -> bool:
        """Whether no fault acts any longer, and the device has started again if it had to."""


@dataclass(frozen=True, slots=True)
class Line:
    """One tracker. open: (folder, how fast its time runs) → its URL and its bench. silences: faults after which nothing
    comes. restarts: those after which it comes back by itself.
    """

    scheme: str
    open: Callable[[Path, float], AbstractContextManager[tuple[str, Bench]]]
    silences: tuple[str, ...]
    restarts: tuple[str, ...] = ("reset",)


def _rows(name: str) -> Iterator[object]:
    for file in sorted(Path(__file__).parent.glob("simulated_*.py")):
        if f"\n{name} = " in file.read_text():  # else whole carts would be imported for nothing
            yield from getattr(importlib.import_module(f"tests.support.{file.stem}"), name)


def rigs() -> dict[str, Rig]:
    """Name → rig, of every simulated source."""
    return {rig.name: rig for rig in _rows("RIGS") if isinstance(rig, Rig)}


def lines() -> dict[str, Line]:
    """Scheme → line, of every simulated tracker."""
    return {line.scheme: line for line in _rows("LINES") if isinstance(line, Line)}
