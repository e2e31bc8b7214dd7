"""Decides when the next solution begins, and how much of it each picture runs. Pure."""

from probewatch.appliance.core.quality.evidence import Evidence

_SOLVE_EVERY_NS = 330_000_000
"""Time, ns, between two solutions of the window. Two in a row name a fault, so longer names it later; shorter costs the
processor (the line's share of a picture: `make bench`)."""
_SOLVE_FIRST_NS, _FIRST_NS = 200_000_000, 2_000_000_000
"""The same, ns, while the window is shorter than the second: what is wrong from the start shows within it, and short
windows cost little. Less makes two solutions in a row share more of their noise; more names flips, lags and pose
conventions later."""
_SOLVE_UNPAIRED_NS = 1_000_000_000
"""The same, ns, without poses, when only what leaves the window changes it. When a tracker returns, all waiting
pictures are settled in one step, and a step longer than `Timeouts.estimator_ns` is reported as a silent estimator."""
_WORK_SHARE = 0.17
"""Share of the time from picture to picture that a solution under way may take, by what its pieces cost (`Cost`):
5.7 ms of 33. More lengthens the longest pictures, less makes solutions ready later. They cost 17 ms on average, 37 at
nine in ten, 50 with breathing (paths without pictures, one seed), so they are ready after .1 s, .2 and .3."""


def solve_every_ns(window_ns: int, paired: bool) -> int:
    """Returns the time, ns, from one solution to the next. window_ns: length of the motion that is remembered. paired:
    whether there is a pose for the picture's time.
    """
    if not paired:
        return _SOLVE_UNPAIRED_NS
    return _SOLVE_FIRST_NS if window_ns < _FIRST_NS else _SOLVE_EVERY_NS


class SolutionSchedule:
    """Runs the solutions of `Evidence`, picture by picture."""

    def __init__(self) -> None:
        self._begun_ns: int | None = None
        self._picture_ns: int | None = None

    def step(self, evidence: Evidence, t_ns: int, paired: bool) -> int | None:
        """Begins the next solution where it is due, and goes on with the one under way. Returns when the solution began
        that is ready with this picture; None where none is. t_ns: that of the picture. paired: as for `solve_every_ns`.
        """
        since_ns = 0 if self._picture_ns is None else max(t_ns - self._picture_ns, 0)
        self._picture_ns = t_ns
        begun_ns = self._begun_ns
        if begun_ns is None or not evidence.under_way:
            every_ns = solve_every_ns(evidence.window.span_ns, paired)
            if begun_ns is not None and 0 <= t_ns - begun_ns < every_ns:
                return None
            begun_ns = self._begun_ns = t_ns
            evidence.begin(t_ns)
        evidence.go_on(round(_WORK_SHARE * since_ns / 1e3))
        return None if evidence.under_way else begun_ns
