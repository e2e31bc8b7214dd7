"""Detects that one of two marker bodies on the same probe was bent or slid: their relative pose has changed.

The tracker alone shows this, without motion of the hand and without tissue. It does not show which of the two moved.
Where motion then shows rotation and offset to be within their limits, it was the second body, or too little to matter,
and the relative pose is learned again; otherwise that motion names what is wrong with the first. While the second body
is not seen, nothing is concluded.
"""

from collections import deque
from collections.abc import Callable

import numpy as np

from probewatch.appliance.core.detectors.detector import Detector
from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Check, Fault, VerdictKind
from probewatch.drivers.rigid import (
    Array,
    angle_from_rotation,
    nearest_rotation,
    rigid,
    rotation_from_vector,
    seen_from,
    vector_from_rotation,
)
from probewatch.drivers.samples import Matrix4, Pose

REPORTS_FAULTS = (Fault.MARKER_BODY_MOVED,)

LEARN_NS, LEARN_READINGS = 2_000_000_000, 20
"""ns for which, and fewest readings from which, the relative pose is learned. Higher values leave a bend in that time
unseen; lower ones add the noise of the learning to everything that follows."""
WINDOW_NS, WINDOW_READINGS = 400_000_000, 8
"""ns of the window whose median is compared with that pose, and its fewest readings. A step is named when half of the
window follows it, so a longer window names it later; a shorter one is noisier
(`python -m probewatch.tools.development.witness_law` has the figures)."""
_LONGEST_NS = 2_000_000_000
"""ns for which a window waits for its readings. A longer time mixes what is seen now with what was seen before the body
was hidden."""
LOOK_NS = 50_000_000
"""ns between two looks at the window. A shorter time costs processor time; a longer one names a step later by as much.
"""
NAMED_SHARE = 0.5
"""Share of the limit beyond which a change is named: half-way, as far from zero as from a step as large as the limit. A
lower one alarms for noise; a higher one misses such a step because of noise."""
FIRST_SHARE = 1.0
"""The same share until a minute has shown the noise: until then it is not known how the error of the tracker varies
from place to place, and half-way alarmed in each of four hours of .2 mm of such error. A lower one alarms for it; a
higher one misses what moves in that minute."""
NAMED_SIGMA = 6.0
"""The same threshold in standard deviations of a window. Three rows of noise pass 6 once in 10^7 (Maxwell, by
calculation), and 1,000 h have 10^7 windows; the scale is that of the noisiest row. A higher one misses steps; a lower
one alarms for noise."""
KEPT_SHARE = 0.7
"""Share of the threshold below which a named change is withdrawn. A higher one flickers at the limit; a lower one keeps
a change named that was bent back."""
SETTLED_BLOCKS, BLOCKS, FRESH_BLOCKS = 150, 1500, 50
"""Windows: a minute, from which the relative pose is settled; ten minutes, from which the noise is known; and how many
are new each time that it is computed. Fewer do not show how the error of the tracker varies from place to place (.1 mm
of it alarmed in one hour of four with a relative pose of two seconds); more show it later."""
_SAME_MM, _SAME_DEG = 0.01, 0.01
"""Distances below which the two are one tool under two names: no two bodies are in the same place. Lower ones are
within rounding."""
_SPREAD, _MEDIAN = 1.4826, 1.2533
"""Ratio of a normal variable's standard deviation to its median absolute deviation, and ratio of the standard deviation
of its median to that of its mean."""
_MOST_ALIKE = 0.95
"""Largest correlation of a reading with the one before that is assumed, because two seconds show no larger one."""


class Witness(Detector):
    """Compares the relative pose of two marker bodies with the one that was learned.

    relative_pose: (4, 4) second body → first, mm, of the minute in which it was learned under this calibration; None
    before.
    """

    def __init__(self, limits: Limits, relative_pose: Matrix4 | None = None) -> None:
        self._limits = np.array([limits.witness_mm, limits.witness_deg])
        self.relative_pose = self._relative_pose = relative_pose
        self._last_ns = 0
        self._seen_ns: int | None = None
        self._named_ns: int | None = None
        self._changed = False
        self._looked_ns = 0
        self._learning: list[tuple[int, Matrix4]] | None
        self._begin()

    @property
    def thresholds(self) -> Array:
        """Returns the thresholds, (2,) mm and deg, beyond which a change is named."""
        return thresholds(self._limits, self._scale, len(self._blocks))

    def pose(self, pose: Pose) -> None:
        """See Detector."""
        t_ns = self._last_ns = pose.stamp.t_ns
        if pose.matrix is None or pose.witness is None:
            return
        relative_pose = seen_from(pose.matrix, pose.witness)
        if same_place(relative_pose):
            return
        self._seen_ns = t_ns
        if self._learning is not None:
            self._learn(t_ns, relative_pose)
        elif self._relative_pose is not None:
            self._window.append((t_ns, apart(self._relative_pose, relative_pose)))
            if not 0 <= t_ns - self._looked_ns < LOOK_NS:
                self._looked_ns = t_ns
                self._look(t_ns)

    def see(self, seen: Observation) -> bool:
        """See Detector. Returns True once when a change is named.

        What motion showed before says nothing about the first body now.
        """
        changed, self._changed = self._changed, False
        return changed

    def forget_poses(self, since_ns: int) -> None:
        """See Detector. The window begins again, and so does learning where it is under way."""
        self._window.clear()
        self._looked_ns = self._block_ns = 0
        if self._learning:
            self._learning = []

    def on_verified(self, shows: Callable[[Fault], bool], until_ns: int) -> None:
        """See Detector. The first body is where the calibration has it, so the relative pose is learned again."""
        if self._named_ns is not None and until_ns > self._named_ns and shows(Fault.ROTATION) and shows(Fault.OFFSET):
            self._named_ns = self.relative_pose = self._relative_pose = None
            self._begin()

    def checks(self) -> tuple[Check, ...]:
        """Returns the slide, mm, and the turn, deg, of the two bodies against each other.

        The limit is the threshold beyond which a change is named. Returns none before a second body is seen.
        """
        if self._seen_ns is None:
            return ()
        known = self._extents is not None and (
            self._named_ns is not None or self._last_ns - self._seen_ns < _LONGEST_NS
        )
        extents = self._extents if known and self._extents is not None else np.full(2, np.nan)
        limits = self.thresholds
        beyond = extents > limits * (1.0 if self._named_ns is None else KEPT_SHARE)
        rows = zip(("witness-slide", "witness-turn"), extents, self._scale, ("mm", "deg"), limits, beyond, strict=True)
        return tuple(self._check(*row) for row in rows)

    def _check(self, name: str, extent: float, sigma: float, unit: str, limit: float, beyond: bool) -> Check:
        known = VerdictKind.OK if np.isfinite(extent) else VerdictKind.NOT_VERIFIED
        verdict = VerdictKind.FAULT if beyond and self._named_ns is not None else known
        return Check(name, Fault.MARKER_BODY_MOVED, float(extent), float(sigma), unit, float(limit), verdict)

    def _begin(self) -> None:
        """Begins to learn the noise, and the relative pose where it is not known."""
        self._learning = []
        self._window: deque[tuple[int, Array]] = deque()
        self._blocks: deque[Array] = deque(maxlen=BLOCKS)
        self._scale = self._learned_scale = np.zeros(2)
        self._extents: Array | None = None
        self._fresh, self._looked_ns, self._block_ns = 0, 0, 0

    def _learn(self, t_ns: int, relative_pose: Matrix4) -> None:
        assert self._learning is not None
        if self._learning and not 0 <= t_ns - self._learning[-1][0] < _LONGEST_NS:
            self._learning.clear()
        self._learning.append((t_ns, relative_pose))
        if len(self._learning) < LEARN_READINGS or t_ns - self._learning[0][0] < LEARN_NS:
            return
        relative_poses = np.array([one for _, one in self._learning])
        middle = _middle(relative_poses)
        readings = np.array([apart(middle, one) for one in relative_poses])
        period_ns = (t_ns - self._learning[0][0]) / (len(relative_poses) - 1)
        self._scale = self._learned_scale = first_scale(readings, readings_of_window(period_ns))
        self._relative_pose = middle if self._relative_pose is None else self._relative_pose
        self._learning = None

    def _look(self, t_ns: int) -> None:
        window = self._window
        while len(window) > WINDOW_READINGS and window[0][0] <= t_ns - WINDOW_NS:
            window.popleft()
        while window[0][0] <= t_ns - _LONGEST_NS:
            window.popleft()
        if len(window) < WINDOW_READINGS:
            return
        found = np.median([row for _, row in window], axis=0)
        self._extents = extents(found)
        was_named = self._named_ns is not None
        if np.any(self._extents > self.thresholds * (KEPT_SHARE if was_named else 1.0)):
            if not was_named:
                self._named_ns, self._changed = t_ns, True
            return
        self._named_ns = None
        if not 0 <= t_ns - self._block_ns < WINDOW_NS:
            self._block_ns = t_ns
            self._note_noise(found)

    def _note_noise(self, block: Array) -> None:
        self._blocks.append(block)
        if self.relative_pose is None and len(self._blocks) >= SETTLED_BLOCKS:
            self._settle()
        self._fresh += 1
        if self._fresh >= FRESH_BLOCKS:
            self._fresh = 0
            self._scale = np.maximum(self._learned_scale, scale_of(np.array(self._blocks)))

    def _settle(self) -> None:
        """Keeps the relative pose over a minute, and refers to it what was compared with that of two seconds."""
        assert self._relative_pose is not None
        middle = np.median(np.array(self._blocks), axis=0)
        turn = rotation_from_vector(np.deg2rad(middle[3:]))
        self.relative_pose = self._relative_pose = rigid(
            turn @ self._relative_pose[:3, :3], self._relative_pose[:3, 3] + middle[:3]
        )
        self._blocks = deque((row - middle for row in self._blocks), maxlen=BLOCKS)
        self._window = deque((t_ns, row - middle) for t_ns, row in self._window)


def apart(relative_pose: Matrix4, now: Matrix4) -> Array:
    """Returns the change, (6,), of the relative pose: shift, mm, and turn, deg, both in the axes of the first body."""
    turn = vector_from_rotation(now[:3, :3] @ relative_pose[:3, :3].T)
    return np.concatenate([now[:3, 3] - relative_pose[:3, 3], np.rad2deg(turn)])


def extents(rows: Array) -> Array:
    """Returns the lengths, (…, 2), of shift, mm, and turn, deg, of changes, (…, 6)."""
    return np.asarray(np.sqrt(np.square(rows.reshape(*rows.shape[:-1], 2, 3)).sum(axis=-1)))


def thresholds(limits: Array, scale: Array, blocks: int) -> Array:
    """Returns the thresholds, (2,) mm and deg, beyond which a change is named.

    scale: as from `scale_of`. blocks: number of windows from which it is known.
    """
    share = NAMED_SHARE if blocks >= SETTLED_BLOCKS else FIRST_SHARE
    return np.maximum(share * limits, NAMED_SIGMA * scale)


def scale_of(blocks: Array) -> Array:
    """Returns the standard deviation of the median of a window, (2,) mm and deg, in the row where it is largest.

    blocks: (n, 6) medians of windows that do not overlap.
    """
    spread = _SPREAD * np.median(np.abs(blocks - np.median(blocks, axis=0)), axis=0)
    return np.asarray(spread.reshape(2, 3).max(axis=1))


def first_scale(readings: Array, of_window: int) -> Array:
    """Returns the same for windows of `of_window` readings, by the correlation of each reading with the next.

    readings: (n, 6) in a row.
    """
    left = readings - np.median(readings, axis=0)
    power = np.maximum(np.square(left).sum(axis=0), 1e-12)
    alike = np.clip((left[1:] * left[:-1]).sum(axis=0) / power, 0.0, _MOST_ALIKE)
    spread = _MEDIAN * np.sqrt((1 + alike) / (1 - alike) / of_window) * _SPREAD * np.median(np.abs(left), axis=0)
    return np.asarray(spread.reshape(2, 3).max(axis=1))


def readings_of_window(period_ns: float) -> int:
    """Returns how many readings a window has from a tracker with this period."""
    return max(WINDOW_READINGS, round(WINDOW_NS / period_ns))


def same_place(relative_pose: Matrix4) -> bool:
    """Returns whether the two are one body under two names."""
    turn = np.rad2deg(angle_from_rotation(relative_pose[:3, :3]))
    return bool(np.abs(relative_pose[:3, 3]).max() < _SAME_MM and turn < _SAME_DEG)


def _middle(relative_poses: Array) -> Matrix4:
    """Returns the median of the places and the mean of the turns, (4, 4), of relative poses, (n, 4, 4)."""
    return rigid(nearest_rotation(relative_poses[:, :3, :3].mean(axis=0)), np.median(relative_poses[:, :3, 3], axis=0))
