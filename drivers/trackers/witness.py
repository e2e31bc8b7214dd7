"""Watches the second marker body on the probe, which `witness=` of a tracker's URL names: decides when it counts as
seen, and reports when it is not.

Nothing is concluded from a body that is not seen. A person must therefore be told, or it would remain unknown that the
requested second body does not watch.
"""

import numpy as np

from probewatch.drivers.samples import Matrix4

_AWAY_NS = 5_000_000_000
"""How long the body may be hidden before that is reported, ns. A hand passes in less; more reports it later."""


class WitnessSight:
    """Tracks whether the second marker body is seen. name: that of the body, for people. It must be given each reading
    of both bodies that were measured together, in the order of time.
    """

    def __init__(self, name: str, now_ns: int) -> None:
        self._name, self._since_ns = name, now_ns
        self._ever = False
        self._last: tuple[Matrix4, Matrix4] | None = None

    def take(self, t_ns: int, probe: Matrix4, witness: Matrix4 | None) -> Matrix4 | None:
        """Returns the witness, or None where it is not seen. A witness that is identical to the last bit while the
        probe moves is not seen either: servers repeat the last pose of a tool that they no longer see. t_ns: host time.
        """
        if witness is None:
            return None
        last, self._last = self._last, (probe, witness)
        if last is not None and np.array_equal(last[1], witness) and not np.array_equal(last[0], probe):
            return None
        self._since_ns, self._ever = t_ns, True
        return witness

    def remarks(self, now_ns: int) -> tuple[str, ...]:
        """Returns a remark that the second body is not seen; empty while it is."""
        away_ns = now_ns - self._since_ns
        if away_ns <= _AWAY_NS:
            return ()
        since = f"for {away_ns / 1e9:.0f} s" if self._ever else "yet"
        return (f"the second marker body ({self._name}) was not seen {since}: whether either has moved is not watched",)
