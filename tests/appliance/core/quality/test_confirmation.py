"""Which failed checks are named at once, and which wait: each rule alone, on findings made by hand."""

from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.path.blocks import AXIAL
from probewatch.appliance.core.path.noise import Habit
from probewatch.appliance.core.quality.confirmation import (
    Memory,
    Solved,
    by_breathing_alone,
    decidable,
    decide,
    since_change,
)
from probewatch.appliance.core.quality.examination import Finding, examine, examine_nothing
from probewatch.appliance.core.times import CHANGE_WINDOW_NS
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration, Check, VerdictKind
from tests.support.motions import TRUTH, tilting_path
from tests.support.windows import filled

LIMITS = Limits()
S = 1_000_000_000
NOTHING = examine_nothing(LIMITS)


def found(**values: float) -> Finding:
    """Checks of which these are beyond their limit, by value, the latency is in order, and all others are undecided."""
    failed = {name.replace("_", "-"): value for name, value in values.items()}

    def made(check: Check) -> Check:
        if check.name in failed:
            return replace(check, value=failed[check.name], sigma=0.1, verdict=VerdictKind.FAULT)
        return replace(check, value=0.0, sigma=1.0, verdict=VerdictKind.OK) if check.name == "latency" else check

    checks = [made(check) for check in NOTHING.checks]
    assert failed.keys() <= {check.name for check in checks}
    return Finding(tuple(checks))


def doubtful_s(memory: Memory, finding: Finding, now_s: float, lag_explained: bool = False) -> tuple[Memory, set[str]]:
    solved = Solved(decidable(finding), finding, 10 * S, round(now_s * S), lag_explained)
    memory, doubtful = decide(memory, solved, LIMITS)
    return memory, set(doubtful)


def test_a_fault_is_named_by_the_second_solution_that_shows_it() -> None:
    wrong = found(scale_lateral=9.0)
    memory, doubtful = doubtful_s(Memory(), wrong, 1.0)
    assert doubtful == {"scale-lateral"}
    assert doubtful_s(memory, wrong, 1.3)[1] == set()
    assert doubtful_s(doubtful_s(memory, found(), 1.3)[0], wrong, 1.6)[1] == {"scale-lateral"}, "begun again"


def test_a_lag_that_its_explanation_found_needs_no_second_solution() -> None:
    late = found(latency=100.0)
    assert doubtful_s(Memory(), late, 1.0)[1] == {"latency"}
    assert doubtful_s(Memory(), late, 1.0, lag_explained=True)[1] == set()


def test_what_only_tilts_show_waits_until_the_short_window_is_new() -> None:
    wrong = found(offset_axial=9.0, scale_axial=9.0)
    memory, _ = doubtful_s(Memory(), wrong, 1.0)
    within_s = CHANGE_WINDOW_NS / S
    assert doubtful_s(memory, wrong, 1.0 + within_s - 0.1)[1] == {"offset-axial"}
    assert doubtful_s(memory, wrong, 1.0 + within_s)[1] == set()


@pytest.mark.parametrize("sigma", [9.0, 40.0])
def test_every_parameter_of_x_waits_so_while_the_latency_is_not_shown_within_half_its_limit(sigma: float) -> None:
    wrong = found(scale_axial=9.0)
    unsure = tuple(replace(one, sigma=sigma) if one.name == "latency" else one for one in wrong.checks)
    memory, _ = doubtful_s(Memory(), Finding(unsure), 1.0)
    assert (doubtful_s(memory, Finding(unsure), 1.3)[1] == set()) is (3 * sigma <= 30.0)


def test_just_after_a_change_only_what_changed_is_named_or_a_latency() -> None:
    memory = Memory(suspects=frozenset({"scale-lateral", "polarity", "latency"}), culprits={"polarity": 1.0})
    memory = replace(memory, settled_ns=5 * S)
    wrong = found(scale_lateral=9.0, polarity=1.0, latency=100.0)
    assert doubtful_s(memory, wrong, 4.9)[1] == {"scale-lateral"}
    assert doubtful_s(memory, wrong, 5.0)[1] == {"scale-lateral"}, "the latency is not in order"
    in_time = found(scale_lateral=9.0, polarity=1.0)
    assert doubtful_s(memory, in_time, 4.9)[1] == {"scale-lateral"}
    assert doubtful_s(memory, in_time, 5.0)[1] == set()


def test_a_scale_that_only_followed_breaths_tell_waits_for_half_a_window() -> None:
    wrong: Calibration = replace(TRUTH, scale_mm_per_px=TRUTH.scale_mm_per_px / [1, 0.9])
    finding = examine(filled(tilting_path, 8.0, 2, reference=wrong), wrong, LIMITS)
    assert finding.solution is not None
    noise = replace(finding.solution.noise, habits={AXIAL: Habit(np.ones(8), 4.0)})
    followed = Finding(finding.checks, replace(finding.solution, noise=noise))
    assert by_breathing_alone(finding) == set()
    assert by_breathing_alone(followed) == {"scale-axial"}
    memory, _ = doubtful_s(Memory(), followed, 1.0)
    assert doubtful_s(memory, followed, 5.9)[1] == {"scale-axial"}
    assert doubtful_s(memory, followed, 6.0)[1] == set()
    memory, doubtful = doubtful_s(memory, finding, 5.9)
    assert doubtful == set()
    assert doubtful_s(memory, followed, 6.0)[1] == {"scale-axial"}, "begun again"


def test_motion_before_a_confirmed_change_is_dropped_once() -> None:
    wrong = decidable(found(scale_lateral=9.0))
    seen = Memory(suspects=frozenset({"scale-lateral"}))
    assert since_change(Memory(), wrong, 20 * S) == Memory(), "one solution confirms nothing"
    changed = since_change(seen, wrong, 20 * S)
    assert changed.valid_ns == 20 * S - CHANGE_WINDOW_NS
    assert changed.settled_ns == 20 * S + CHANGE_WINDOW_NS
    assert changed.culprits == {"scale-lateral": 9.0}
    later_ns = changed.settled_ns
    assert since_change(changed, wrong, later_ns) == changed, "as wrong as it was"
    assert since_change(changed, decidable(found(scale_lateral=11.4)), later_ns) == changed, "half a limit is 2.5 %"
    worse = decidable(found(scale_lateral=11.6))
    assert since_change(changed, worse, later_ns - 1) == changed, "the window holds motion from before the change"
    assert since_change(changed, worse, later_ns).valid_ns == later_ns - CHANGE_WINDOW_NS


def test_motion_before_a_correction_is_dropped_as_well() -> None:
    memory = Memory(culprits={"latency": 100.0})
    right = since_change(memory, decidable(found()), 20 * S)
    assert right.culprits == {}
    assert right.valid_ns == 20 * S - CHANGE_WINDOW_NS
    assert since_change(memory, NOTHING, 20 * S) == memory, "nothing shows that it is right again"


def test_older_motion_never_counts_again() -> None:
    memory = Memory().valid_from(7 * S)
    assert memory.valid_from(3 * S) == memory
    assert memory.lagged_from(5 * S) == replace(memory, lagged_ns=5 * S)
    assert memory.lagged_from(9 * S).valid_ns == 9 * S
