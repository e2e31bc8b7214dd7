"""Limits how often each user may send requests that are written to the alarm log: a burst, then one now and then. Pure.

The log keeps its last 40,000 entries; a client that asks as fast as it can must not push out the entries that a person
will look for.
"""

BURST = 30
EVERY_NS = 60_000_000_000
"""Requests that may come at once, and ns for one more. Fewer would refuse a person at work; more pushes out sooner what
a person will look for: at one a minute the 40,000 entries last 27 days (docs/control.md).
"""


class Allowance:
    """Keeps a bucket of BURST requests for each user, refilled by one every EVERY_NS. Times: ns of the host clock."""

    def __init__(self) -> None:
        self._full_ns: dict[int, int] = {}
        """When the bucket of a user is full again; users who are not named have a full one."""

    def wait_ns(self, user: int, now_ns: int) -> int:
        """Returns how long this user must wait before the next request, ns; 0 when no wait is needed."""
        missing_ns = self._full_ns.get(user, now_ns) - now_ns
        return max(0, missing_ns - (BURST - 1) * EVERY_NS)

    def take(self, user: int, now_ns: int) -> None:
        """Records that a request of this user was granted."""
        self._full_ns[user] = max(self._full_ns.get(user, now_ns), now_ns) + EVERY_NS
