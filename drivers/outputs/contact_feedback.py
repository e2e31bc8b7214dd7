"""Waits until a contact that is wired back shows the commanded state."""

from collections.abc import Callable

from probewatch.drivers.clock.host_clock import HostClock

_FOLLOWS_S = 0.1
"""Seconds within which a contact must follow. Mechanical relays switch within some 15 ms; more delays the report of a
welded one, less loses a slow one. Not measured on relays.
"""

_LOOK_AGAIN_NS = 2_000_000
"""Time between two looks, ns. Less loads the processor; more adds to the time of each write."""


def follows(read_back: Callable[[], bool | None], level: bool, clock: HostClock) -> bool:
    """Returns whether read_back() gives level within 0.1 s of the clock."""
    deadline_ns = clock.now_ns() + round(_FOLLOWS_S * 1e9)
    while read_back() is not level:
        if clock.now_ns() >= deadline_ns:
            return False
        clock.sleep_until(clock.now_ns() + _LOOK_AGAIN_NS)
    return True
