"""Prints the events of a simulated device as lines of JSON."""

import json
import sys
from collections.abc import Mapping

from probewatch.drivers.clock.host_clock import HostClock


class Events:
    """Prints a JSON object per line, on the standard output that was current when it was created: a command that later
    runs in this process with another one, as in tests, does not get its lines.

    Every method raises BrokenPipeError if nobody reads any longer.
    """

    def __init__(self, clock: HostClock) -> None:
        self._clock, self._stream = clock, sys.stdout
        self._active: frozenset[str] = frozenset()

    def tell(self, event: Mapping[str, object]) -> None:
        """Prints one event at once."""
        print(json.dumps(event), file=self._stream, flush=True)

    def note(self, what: str, value: object) -> None:
        """Prints a new value of something, with the time."""
        self.tell({"t_ns": self._clock.now_ns(), what: value})

    def faults(self, active: frozenset[str], refusal: str | None) -> None:
        """Prints the active faults where they differ from those before, and why a change of them was refused."""
        if active != self._active:
            self._active = active
            self.note("faults", sorted(active))
        if refusal is not None:
            self.note("refused", refusal)
