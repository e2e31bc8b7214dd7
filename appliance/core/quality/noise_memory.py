"""Keeps the noise that the long windows have learned, for the windows that come after them."""

from collections import deque
from dataclasses import replace

from probewatch.appliance.core.path.noise import Noise
from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.sequential_test import WINDOW_NS
from probewatch.appliance.core.times import PRESENT_NS, QUIET_BREATH_S

_BREATHS_NS = round(2 * QUIET_BREATH_S * 1e9)
"""Window length, ns, below which the learned noise may know nothing of breaths. A solution that started from such noise
drew the axial scale to −40 % five seconds after the start (`probewatch study`, in-plane, breathing, seed 1). Of 500
windows of 3.5 to 10 s of breathing that started from no noise, none did."""
_BREATHING_KNOWN_NS = PRESENT_NS - 500_000_000
"""Window length, ns, from which the learned noise includes breathing. Until it was learned from as much, a wrong axial
scale may be a breath: it withdraws the OK, as any contradiction does, but no window names it, only the sequential test,
which allows for breathing. A window of 8 s named −13 % in a gesture over breathing tissue (pressed once in 2 s, seed 20
of 20). A depth setting changes the lateral scale as well, which is named as before. Longer names an axial scale alone
later, and from `PRESENT_NS` on never: no window under a contradiction is longer (`evidence`)."""


_MOVED_MM = 3.0
"""Way of the probe along any axis, mm, from which noise counts as learned in motion. A hand that holds still moves
.8 mm; noise of a tracker of .1 mm looks like 1.5 mm. Noise learned at rest lacks what motion adds (a walk of .01 mm
instead of .12): judged by it, the first two seconds of motion after a rest of 30 s were named `offset` by −35 mm
(tests/invariant)."""


class NoiseMemory:
    """Keeps what windows have learned of the noise. breathing_known: whether it was learned from a window long enough
    to know how the patient breathes.
    """

    def __init__(self) -> None:
        self._learned: deque[tuple[int, Noise]] = deque()
        self._in_motion: deque[tuple[int, Noise]] = deque()
        self.breathing_known = False

    def restart(self) -> None:
        """Forgets everything."""
        self._learned.clear()
        self._in_motion.clear()
        self.breathing_known = False

    def lose_sight(self) -> None:
        """Forgets all but the patient's latest breathing, from which learning continues."""
        kept = [[one for one in learned if one[1].habits][-1:] for learned in (self._learned, self._in_motion)]
        self.restart()
        self._learned.extend(kept[0])
        self._in_motion.extend(kept[1])

    def learn(self, now_ns: int, noise: Noise, span_ns: int, way_mm: float) -> None:
        """Takes the noise learned by a window of that length until now. way_mm: as in `Solution`."""
        if span_ns >= _BREATHS_NS:
            self._learned.append((now_ns, noise))
        if span_ns >= _BREATHS_NS and way_mm >= _MOVED_MM:
            self._in_motion.append((now_ns, noise))

    def see_breathing(self, span_ns: int) -> None:
        """Records that a window of that length was solved."""
        self.breathing_known |= span_ns >= _BREATHING_KNOWN_NS

    def of_motion(self, t_ns: int) -> Noise | None:
        """Returns the noise last learned in motion not after t_ns, else the oldest that is kept; new motion is judged
        by it. Returns None where nothing was learned in motion.
        """
        return _until(self._in_motion, t_ns) or (self._in_motion[0][1] if self._in_motion else None)

    def until(self, t_ns: int) -> Noise | None:
        """Returns the noise last learned not after t_ns. A short window is judged by noise from before it, to which a
        change within it has not contributed.
        """
        return _until(self._learned, t_ns)

    def for_window(self, window: PathWindow, t_ns: int) -> Noise | None:
        """Returns the noise last learned not after t_ns, with the habits of breaths that are not in the window."""
        noise = self.until(t_ns)
        if noise is None:
            return None
        before = self.until(window.start_ns - 1)
        return replace(noise, habits={} if before is None else before.habits)


def _until(learned: deque[tuple[int, Noise]], t_ns: int) -> Noise | None:
    """Returns the last noise that is not after t_ns, and drops what is older than needed."""
    while len(learned) > 1 and learned[1][0] <= learned[-1][0] - WINDOW_NS:
        learned.popleft()
    return next((noise for learned_ns, noise in reversed(learned) if learned_ns <= t_ns), None)
