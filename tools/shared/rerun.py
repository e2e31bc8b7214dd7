"""Runs a black box through lines that are built from its settings, and compares their verdicts with those of the live
run, bit for bit.

They are equal for the same version on the same kind of processor with one thread of BLAS, as the service and every
command have it: libraries add numbers in an order that suits the processor.
"""

import json
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.core.exact_fields import verdict_fields
from probewatch.appliance.core.line import Line
from probewatch.appliance.core.quality.report import LineReport
from probewatch.appliance.limits import Limits
from probewatch.appliance.storage.black_box import Series
from probewatch.appliance.storage.black_box_fields import Gap, Item, Made, State
from probewatch.appliance.supervision.turns import Turns
from probewatch.appliance.types import Calibration, Verdict, VerdictKind
from probewatch.drivers.samples import Frame, Matrix4, Pose, Sample


class Repeating(Protocol):
    """Describes what this module needs of a line."""

    def step(self, sample: Sample) -> tuple[Verdict, ...]: ...

    def report(self) -> LineReport: ...


MakeLine = Callable[[Calibration, Limits, int, Matrix4 | None], Repeating]
"""Builds a line from (reference, limits, stale_ns, relative_pose), as `EstimatorSettings` has them."""


class Step(NamedTuple):
    """Holds one item of the file, the time at which it was written, and the verdicts of the line on it now, of which
    there are some only for a sample.
    """

    item: Item
    now_ns: int
    verdicts: tuple[Verdict, ...]


class LiveState(NamedTuple):
    """Represents a state of the service when the box was recorded. t_ns: time of the cart's clock, or since the first
    sample.
    """

    t_ns: int
    state: str
    fault: str
    reason: str


@dataclass
class Comparison:
    """Compares the recorded verdicts with those of the rerun. recorded: number of verdicts of lines that are in the
    file from their first sample on and without a gap; equal: how many of them came again bit for bit. difference: the
    first that did not, in words. without_past, equal_anyway: the same for lines some of whose past is not in the file.
    alike: how many of both came again with the same kind and fault. unproved: how many were OK live and are not
    verified now. proved: how many are OK now and were not live. gaps: what is missing, in words. text, every: those of
    `Begun`. told: the states that the service reported live, from its first change of state on.
    """

    recorded: int = 0
    equal: int = 0
    difference: str = ""
    without_past: int = 0
    equal_anyway: int = 0
    alike: int = 0
    unproved: int = 0
    proved: int = 0
    gaps: list[str] = field(default_factory=list)
    text: str = "kept"
    every: int = 1
    told: list[LiveState] = field(default_factory=list)

    @property
    def is_empty(self) -> bool:
        """Returns whether the file holds nothing that a live run said."""
        return not (self.recorded or self.without_past or self.told)

    @property
    def exact(self) -> bool:
        """Returns whether every verdict that could come again did."""
        return self.recorded == self.equal and not self.difference

    @property
    def sentence(self) -> str:
        """Returns the comparison as a sentence for people."""
        if self.recorded + self.without_past == 0:
            return "the recording holds no verdicts to compare with"
        said = self._of_whole_lines() if self.recorded else ""
        if self.text != "kept":
            said = f"{said}; {self._likeness()}" if said else self._likeness()
        if not self.without_past:
            return said
        partial = (
            f"{self.without_past} verdicts are of lines some of whose past is not in the file ({self._why()}); "
            f"{self.equal_anyway} came again all the same"
        )
        return f"{said}; {partial}" if said else partial

    def _of_whole_lines(self) -> str:
        if self.exact:
            return f"all {self.recorded} verdicts are those of the live run, bit for bit"
        said = f"{self.equal} of {self.recorded} verdicts are those of the live run"
        if self.text == "kept" and self.every == 1:
            return f"{said}; nothing is missing in the file: another version, or processor? First: {self.difference}"
        return f"{said}; reason: {self._why()}. First: {self.difference}"

    def _likeness(self) -> str:
        """Returns what can be compared where pictures were blackened, because the figures of those are never quite the
        same.
        """
        return (
            f"{self.alike} of {self.recorded + self.without_past} verdicts came again with the same kind and fault, "
            f"{self.unproved} that were OK are not verified now, {self.proved} are OK now and were not"
        )

    def _why(self) -> str:
        why = [f"gaps: {len(self.gaps)}"] if self.gaps else []
        why += ["text was blackened"] if self.text == "blackened" else []
        why += [f"only one of {self.every} pictures was recorded"] if self.every > 1 else []
        return ", ".join(why) or "recorded from amid its work on"


def why_unusable(report: LineReport, live: Comparison | None) -> str:
    """Returns why nothing at all can be judged, also nothing that was said live; empty where something can."""
    return report.unusable_because if live is None or live.is_empty else ""


class Rerun:
    """Runs a series through lines. line: the latest line, None before the first. settings: those of each line that was
    built.
    """

    def __init__(self, series: Series, make_line: MakeLine = Line) -> None:
        self._series, self._make_line = series, make_line
        self._said: deque[Verdict] = deque()
        self._again: deque[Verdict] = deque()
        self._whole, self._turns = False, Turns()
        self.line: Repeating | None = None
        self.settings: list[EstimatorSettings] = []
        self.comparison = Comparison(text=series.begun.text, every=series.begun.every)

    def steps(self) -> Iterator[Step]:
        """Yields every item in order; `comparison` is complete after the last. Raises RecordingError where the disk
        fails.
        """
        for item, now_ns in self._series.items():
            verdicts: tuple[Verdict, ...] = ()
            if isinstance(item, Made):
                self._obey(item)
            elif isinstance(item, Frame | Pose) and self.line is not None:
                verdicts = self.line.step(item)
                self._again += verdicts
            elif isinstance(item, Verdict):
                self._count()
                self._said.append(item)
            elif isinstance(item, State):
                self._note_live_state(item, now_ns)
            elif isinstance(item, Gap):
                self._left_over()
                self._whole = False
                self.comparison.gaps.append(item.reason)
            self._compare()
            yield Step(item, now_ns, verdicts)
        self._left_over()

    def _obey(self, made: Made) -> None:
        """Builds the line that the settings in the file require. Verdicts of the previous line that are not in the file
        do not count: live, they were given when these settings had already arrived.
        """
        self._left_over()
        settings = made.settings
        self.line = (
            None
            if settings is None
            else self._make_line(settings.reference, settings.limits, settings.stale_ns, settings.relative_pose)
        )
        if settings is not None:
            self.settings.append(settings)
        self._whole = made.step == 0

    def _note_live_state(self, item: State, now_ns: int) -> None:
        said = [str(item.status.get(name) or "") for name in ("state", "fault", "reason")]
        told = LiveState(now_ns, *said)
        if self._turns.begins(told.state, told.fault, told.reason):
            self.comparison.told.append(told)

    def _count(self) -> None:
        if self._whole:
            self.comparison.recorded += 1
        else:
            self.comparison.without_past += 1

    def _compare(self) -> None:
        while self._said and self._again:
            said, again = self._said[0], self._again[0]
            if said.t_ns >= again.t_ns:
                self._again.popleft()
            if said.t_ns <= again.t_ns:
                self._said.popleft()
            if said.t_ns < again.t_ns:
                self._differs(f"at {said.t_ns} ns, there was one that does not come again")
            elif said.t_ns > again.t_ns:
                self._differs(f"at {again.t_ns} ns, there comes one that was not there")
            else:
                self._hold_against(said, again)

    def _hold_against(self, said: Verdict, again: Verdict) -> None:
        """Compares two verdicts on the same picture."""
        if json.dumps(verdict_fields(said)) != json.dumps(verdict_fields(again)):
            self._differs(f"at {said.t_ns} ns, {_difference(said, again)}")
        elif self._whole:
            self.comparison.equal += 1
        else:
            self.comparison.equal_anyway += 1
        self.comparison.alike += (said.kind, said.fault) == (again.kind, again.fault)
        self.comparison.unproved += said.kind is VerdictKind.OK and again.kind is VerdictKind.NOT_VERIFIED
        self.comparison.proved += said.kind is not VerdictKind.OK and again.kind is VerdictKind.OK

    def _left_over(self) -> None:
        if self._said:
            self._differs(f"at {self._said[0].t_ns} ns, there was one that does not come again")
        self._said.clear()
        self._again.clear()

    def _differs(self, how: str) -> None:
        if self._whole:
            self.comparison.difference = self.comparison.difference or how


def _difference(said: Verdict, again: Verdict) -> str:
    """Returns, in words, the first field that differs."""
    before, now = verdict_fields(said), verdict_fields(again)
    for name in ("verdict", "fault", "reason", "verified_ns"):
        if before[name] != now[name]:
            return f"{name} was {before[name]!r}, now {now[name]!r}"
    for one, other in zip(before["checks"], now["checks"], strict=False):
        for name in one:
            if one[name] != other[name]:
                return f"{name} of {one['name']} was {one[name]!r}, now {other[name]!r}"
    return f"there were {len(before['checks'])} checks, now {len(now['checks'])}"
