"""Waits until a contact that is wired back shows what it was told."""

from collections.abc import Callable

from drivers.hosttime import HostClock

_FOLLOWS_S, _LOOK_AGAIN_NS = 0.1, 2_000_000


def follows(read_back: Callable[[], bool | None], level: bool, clock: HostClock) -> bool:
    """Whether read_back() gives level within 0.1 s of the clock."""
    deadline_ns = clock.now_ns() + round(_FOLLOWS_S * 1e9)
    while read_back() is not level:
        if clock.now_ns() >= deadline_ns:
            return False
        clock.sleep_until(clock.now_ns() + _LOOK_AGAIN_NS)
    return True
