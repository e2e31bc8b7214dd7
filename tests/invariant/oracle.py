"""What must hold after every tick, from the truth of the world and what the room can see. See the package's text."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.limits import AT_REST_S, SWEPT_AGE_S, Limits, RequiredAges
from probewatch.appliance.supervision.supervisor import Durations
from probewatch.appliance.types import AlarmState, Check, State, Verdict, VerdictKind
from probewatch.drivers.rigid import angle_from_rotation, inverse
from probewatch.drivers.samples import Matrix4
from tests.invariant.world import NONE, Change

TICK_NS = 50_000_000
DISCOVERED_WITHIN_NS = 15_000_000_000
NAMED_WITHIN_NS = 1_000_000_000
GRADUAL_WITHIN_NS = 10_000_000_000
"""The same where the picture became another gradually while the probe rested: a breath takes as long."""
MAX_AGE_NS = Durations().max_verification_age_ns
SWEPT_NS = round(SWEPT_AGE_S * 1e9)
_REST_MM, _REST_RAD = 2.0, np.deg2rad(1.5)
"""Half the limits: how far apart two pictures that are said to show the same place may truly be. The rest allows itself
a quarter by what the tracker says; its noise and what the picture does not show come on top."""
_MOVED_WITHIN_NS = 300_000_000
_LEAST_MM_PER_S = 0.5
_FURTHEST_APART_NS = 250_000_000
_REACH_MM = 5.0
SHIPPED = Limits().required_age_s
STRICT = RequiredAges.model_validate(
    {"offset-lateral": 30.0, "offset-axial": 30.0, "offset-elevational": 30.0, "scale-axial": 18.0}
)
"""The offsets as often as what sweeps show, and one parameter more often than the rest."""
_SWEPT = frozenset({"polarity", "scale", "rotation"})
"""Classes of the parameters that any sweep shows; an offset takes turns."""
_ALARMED = (State.WARNING, State.HALT, State.RECALIBRATION_REQUESTED)


class Broken(AssertionError):  # noqa: N818  what is said of an invariant, not of an error
    """The invariant does not hold. clause: its letter."""

    def __init__(self, clause: str, what: str) -> None:
        super().__init__(clause, what)
        self.clause, self.what = clause, what

    def __str__(self) -> str:
        return f"({self.clause}) contact closed, but {self.what}"


Rests = Sequence[tuple[int, int]]
"""First and last picture, ns, between which the line says that the probe rested."""


@dataclass(frozen=True, slots=True)
class Genuine:
    """A picture of tissue under its own stamp. place: (3,) mm, of the probe in its plane."""

    t_ns: int
    place: NDArray[np.float64]


class Oracle:
    """max_age_ns: after which a verification is none. asked: what the contact asks for, and how old it may be;
    at_rest_s: for how much longer where the probe rested.

    shown_fault: the calibration fault that was shown since the present change, None before the first.
    """

    def __init__(
        self, max_age_ns: int = MAX_AGE_NS, asked: RequiredAges = SHIPPED, at_rest_s: float = AT_REST_S
    ) -> None:
        self._at_rest_ns = round(at_rest_s * 1e9)
        own_ns = {name: max_age_ns if age_s is None else round(age_s * 1e9) for name, age_s in asked.ages_s.items()}
        self._ages_ns, self._max_age_ns = own_ns, max_age_ns
        self._where: dict[int, tuple[Change, Matrix4]] = {}
        self._shown_ns: dict[str, int] = {}
        self.shown_fault: str | None = None
        self._change = NONE
        self._told: frozenset[str] = frozenset()
        self._told_before: frozenset[str] = frozenset()
        self._visible_ns = self._blank_ns = 0
        self._broken_ns: int | None = None
        self._told_within_ns = NAMED_WITHIN_NS
        self._pictures: deque[Genuine] = deque(maxlen=20)
        self._waiting: deque[tuple[int, Matrix4 | None, frozenset[str] | None]] = deque()
        self._pose_ns: int | None = None

    def changed(self, change: Change, told_within_ns: int = NAMED_WITHIN_NS) -> None:
        """From here on the true calibration is another. A fault that is told already says nothing of it.

        told_within_ns: after the first genuine picture of it.
        """
        self._told_within_ns = told_within_ns
        self._told_before = self._told
        self._waiting = deque((t_ns, None, right) for t_ns, _, right in self._waiting)
        self._change, self.shown_fault, self._visible_ns, self._broken_ns = change, None, 0, None
        self._pictures.clear()

    def renewed(self) -> None:
        """A recalibration was confirmed: what was shown before says nothing of the new reference."""
        self.changed(NONE)
        self._waiting.clear()
        self._shown_ns.clear()

    def picture(self, t_ns: int, pose: Matrix4) -> None:
        """A genuine, rightly stamped picture was delivered; pose: (4, 4) picture → tissue, true."""
        if self._broken_ns is None and self._change.spoils_picture:
            self._broken_ns = t_ns
        turn_mm = np.arctan2(pose[1, 0], pose[0, 0]) * _REACH_MM
        self._pictures.append(Genuine(t_ns, np.array([*pose[:2, 3], turn_mm])))
        self._waiting.append((t_ns, pose, self._change.right if self._moved(t_ns) else None))

    def pose(self, t_ns: int) -> None:
        """A genuine, rightly stamped pose was delivered: it settles the pictures before it."""
        before_ns, self._pose_ns = self._pose_ns, t_ns
        while self._waiting:
            picture_ns, place, right = self._waiting.popleft()
            if before_ns is not None and before_ns <= picture_ns and t_ns - before_ns <= _FURTHEST_APART_NS:
                if place is not None:
                    self._where[picture_ns] = self._change, place
                if right is not None:
                    self._note_shown(picture_ns, right)
        while self._where and next(iter(self._where)) < t_ns - 2 * self._max_age_ns:
            del self._where[next(iter(self._where))]

    def tick(
        self,
        now_ns: int,
        lively_in_view: bool,
        blank: bool,
        alarm: AlarmState,
        newest: Verdict | None,
        rests: Rests,
    ) -> tuple[Broken, ...]:
        """Every clause that does not hold. blank: pictures without tissue, and nothing else is wrong. rests: what the
        line says of them, each of which the truth must bear out.
        """
        self._blank_ns = self._blank_ns + TICK_NS if blank else 0
        if self._visible_ns < DISCOVERED_WITHIN_NS:
            self._visible_ns = self._visible_ns + TICK_NS if lively_in_view else 0
        self._note_fault(alarm, newest)
        if not alarm.energised:
            return ()
        said = (
            self._age(now_ns, rests),
            _contradiction(newest),
            self._relapse(),
            self._discovery(),
            self._sight(),
            self._break(now_ns),
        )
        return tuple(broken for broken in said if broken is not None)

    def _note_shown(self, picture_ns: int, right: frozenset[str]) -> None:
        """As far as any line could tell: of what any sweep shows one wrong parameter spoils the others."""
        if right >= _SWEPT:
            self._shown_ns |= {name: picture_ns for name in self._ages_ns if _class(name) in right}

    def _note_fault(self, alarm: AlarmState, newest: Verdict | None) -> None:
        told = {alarm.fault if alarm.state in _ALARMED else None, None if newest is None else newest.fault}
        self._told = frozenset(fault for fault in told if fault is not None)
        new = (self._told & self._change.faults) - self._told_before
        if self._change.gross and self.shown_fault is None and new:
            self.shown_fault = min(new)

    def _age(self, now_ns: int, rests: Rests) -> Broken | None:
        for name, age_ns in self._ages_ns.items():
            if name not in self._shown_ns:
                return Broken("a", f"no motion has shown {name}; it is {self._change}")
            shown_ns = self._shown_ns[name]
            rested_ns = min(sum(self._rested_ns(rest, shown_ns) for rest in rests), self._at_rest_ns)
            if now_ns - shown_ns > min(age_ns + rested_ns, self._max_age_ns) + TICK_NS:
                said = f"{(now_ns - shown_ns) / 1e9:.2f} s old, and it truly rested for {rested_ns / 1e9:.2f} s of it"
                return Broken("a", f"the last motion that showed {name} is {said}; it is {self._change}")
        return None

    def _rested_ns(self, rest: tuple[int, int], shown_ns: int) -> int:
        """What of a rest since then is true: both its pictures are genuine, nothing has changed between them, and the
        last shows the same.
        """
        start_ns, end_ns = rest
        if end_ns <= shown_ns or start_ns not in self._where or end_ns not in self._where:
            return 0
        (first, start), (last, end) = self._where[start_ns], self._where[end_ns]
        if first is not last:
            return 0
        between = inverse(start) @ end
        far_mm, far_rad = np.linalg.norm(between[:3, 3]), angle_from_rotation(between[:3, :3])
        return 0 if far_mm > _REST_MM or far_rad > _REST_RAD else end_ns - max(start_ns, shown_ns)

    def _relapse(self) -> Broken | None:
        if self.shown_fault is None:
            return None
        return Broken("c", f"{self.shown_fault} was shown, and it is still {self._change}")

    def _discovery(self) -> Broken | None:
        if not self._change.visible or self._visible_ns < DISCOVERED_WITHIN_NS:
            return None
        return Broken("d", f"it was {self._change} for 15 s of motion in full view")

    def _sight(self) -> Broken | None:
        what = f"the pictures have shown no tissue for {self._blank_ns / 1e9:.2f} s"
        return Broken("f", what) if self._blank_ns > NAMED_WITHIN_NS + TICK_NS else None

    def _break(self, now_ns: int) -> Broken | None:
        if self._broken_ns is None or now_ns - self._broken_ns <= self._told_within_ns + TICK_NS:
            return None
        return Broken("g", f"the picture was {self._change} for {(now_ns - self._broken_ns) / 1e9:.2f} s")

    def _moved(self, now_ns: int) -> bool:
        recent = [picture for picture in self._pictures if picture.t_ns >= now_ns - _MOVED_WITHIN_NS]
        return any(
            np.linalg.norm(b.place - a.place) >= _LEAST_MM_PER_S * (b.t_ns - a.t_ns) / 1e9 for a, b in pairwise(recent)
        )


def _class(name: str) -> str:
    """Of the parameter's check; a latency is always right in this world."""
    return "polarity" if name == "latency" else name.partition("-")[0]


def _contradiction(newest: Verdict | None) -> Broken | None:
    check = next((check for check in (() if newest is None else newest.checks) if _contradicts(check)), None)
    if check is None:
        return None
    shown = f"{check.value:.3g} ± {check.sigma:.2g} {check.unit}, limit {check.limit:g}"
    return Broken("b", f"{check.name} reads {shown}: {check.verdict.value}")


def _contradicts(check: Check) -> bool:
    beyond = check.sigma > 0 and abs(check.value) - 3 * check.sigma > check.limit
    return beyond or check.verdict is VerdictKind.FAULT
