"""The second marker body on the probe, as `witness=` of a tracker's URL names it: when it counts as seen, and what is
said of one that is not.

Nothing is concluded from a body that is not seen, so a person must see that it is not: else it stays unknown that what
was asked for does not watch.
"""

import numpy as np

from probewatch.drivers.samples import Matrix4

_AWAY_NS = 5_000_000_000
"""For which it may be hidden before it is said. A hand passes in less; more leaves it unsaid for longer."""


class WitnessSight:
    """name: for people. Give it each reading of both that were measured together, in the order of time."""

    def __init__(self, name: str, now_ns: int) -> None:
        self._name, self._since_ns = name, now_ns
        self._ever = False
        self._last: tuple[Matrix4, Matrix4] | None = None

    def take(self, t_ns: int, probe: Matrix4, witness: Matrix4 | None) -> Matrix4 | None:
        """The witness, or None: also where it stands still to the last bit while the probe moves, as servers repeat the
        last pose of a tool that they no longer see. t_ns: host time.
        """
        if witness is None:
            return None
        last, self._last = self._last, (probe, witness)
        if last is not None and np.array_equal(last[1], witness) and not np.array_equal(last[0], probe):
            return None
        self._since_ns, self._ever = t_ns, True
        return witness

    def remarks(self, now_ns: int) -> tuple[str, ...]:
        """That it is not seen, in words; empty while it is."""
        away_ns = now_ns - self._since_ns
        if away_ns <= _AWAY_NS:
            return ()
        since = f"for {away_ns / 1e9:.0f} s" if self._ever else "yet"
        return (f"the second marker body ({self._name}) was not seen {since}: whether either has moved is not watched",)
