"""The supervisor over stamps that leap by years, as a damaged or hostile recording has them."""

from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.quality.judgement import bounded, judge
from probewatch.appliance.core.quality.verification import VerificationStatus
from probewatch.appliance.supervision import timeline
from probewatch.appliance.supervision.supervisor import TICK_NS
from probewatch.appliance.supervision.timeline import Timeline
from probewatch.appliance.types import PointError, State
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp

YEAR_NS = 365 * 86_400 * 10**9
ERROR = PointError((1.0, 3.1), (1.0, 2.0), None, None, 0)
PICTURE = np.zeros((16, 16), np.uint8)


def told(stamps_ns: list[int]) -> tuple[Timeline, int]:
    """After these pictures, and how often the supervisor was asked."""
    found, asked = Timeline(0, 0, stamps_ns[-1]), 0
    tick = found._tick

    def counted(now_ns: int) -> None:
        nonlocal asked
        asked += 1
        tick(now_ns)

    found._tick = counted  # type: ignore[method-assign]
    for number, t_ns in enumerate(stamps_ns):
        found.step(Frame(Stamp(t_ns, 0), number, PICTURE), ())
    found.finish()
    return found, asked


def test_a_gap_of_years_is_passed_over_once_nothing_changes_any_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timeline, "_LONGEST_GAP", 100 * 20)
    found, asked = told([0, 10**9, 30 * YEAR_NS])
    assert asked <= 100 * 20 + 40
    assert State.DEVICE_LOST in {change.state for change in found.changes if change.t_s < 60}
    assert found._next_ns > 30 * YEAR_NS - TICK_NS


def test_leap_after_leap_is_ticked_through_for_a_day_in_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timeline, "_MOST_IDLE", 1000)
    _, asked = told([number * YEAR_NS for number in range(30)])
    assert asked <= 1000 + 30 * 200


def test_short_gaps_are_ticked_through_whole() -> None:
    _, asked = told([number * 9 * 10**9 for number in range(20)])
    assert asked == 19 * 9 * 20 + 1


def test_it_repeats_a_state_once_when_the_limit_of_a_point_alone_withholds_the_ok() -> None:
    lacking = judge(0, (), VerificationStatus(("rotation-lateral",)))
    limited = [bounded(judge(0, (), VerificationStatus(())), error, 2.5) for error in (ERROR, None)]
    found = Timeline(0, 0, 8 * 10**9)
    for number in range(160):
        t_ns = number * TICK_NS
        verdict = lacking if number < 80 or number % 20 < 5 else limited[number // 20 % 2]
        found.step(Frame(Stamp(t_ns, 0), number, PICTURE), (replace(verdict, t_ns=t_ns),))
        found.step(Pose(Stamp(t_ns, 0), number, np.eye(4), 0.1, PoseStatus.OK), ())
    found.finish()
    said = [(change.state, change.reason) for change in found.changes if change.state is State.NOT_VERIFIED]
    assert [reason.partition(":")[0].split(" 3.1")[0] for _, reason in said] == ["not shown yet", "error of a point"]
    assert said[1][1] == "error of a point 3.1 mm, limit 2.5 mm"
