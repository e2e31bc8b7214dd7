"""Two faults at once: the second is named once the first is known, and nothing is OK meanwhile."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.evidence import Evidence
from probewatch.appliance.core.quality.judgement import judge
from probewatch.appliance.core.quality.verification import VerificationStatus
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration, Check, Fault, Verdict, VerdictKind
from probewatch.drivers.rigid import rotation_from_vector
from tests.support.motions import TRUTH, tilting_path
from tests.support.windows import filled

FAULT, OK = VerdictKind.FAULT, VerdictKind.OK
BENT = replace(TRUTH, rotation=rotation_from_vector(np.deg2rad([8.0, 0, 0])) @ TRUTH.rotation)
BENT_AND_SCALED = replace(BENT, scale_mm_per_px=TRUTH.scale_mm_per_px * [1.1, 1])


def solved(whole: PathWindow, every: int = 20) -> Iterator[tuple[Verdict, Evidence]]:
    """A verdict after each solution, one for so many pictures."""
    window = PathWindow(TRUTH)
    window.poses = whole.poses
    evidence = Evidence(TRUTH, Limits(), window)
    for index, seen in enumerate(whole._seen):
        window.add(seen)
        if index % every == every - 1:
            evidence.solve(window.now_ns)
            yield judge(window.now_ns, evidence.checks(), evidence.status), evidence


def named(truth: Calibration, seconds: float = 13.0, late_s: float = 0.0) -> tuple[set[Fault], list[Verdict]]:
    """Every class that is named, and the verdicts."""
    verdicts = [verdict for verdict, _ in solved(filled(tilting_path, seconds, 6, truth=truth, late_s=late_s))]
    return {check.fault for verdict in verdicts for check in verdict.checks if check.verdict is FAULT}, verdicts


@pytest.mark.thorough
def test_each_is_named_and_nothing_else_and_never_ok() -> None:
    found, verdicts = named(BENT_AND_SCALED)
    both = {Fault.ROTATION, Fault.SCALE}
    assert found == both
    assert OK not in {verdict.kind for verdict in verdicts}
    assert {check.fault for check in verdicts[-1].checks if check.verdict is FAULT} == both
    assert verdicts[-1].reason.count("limit") == len(both), "each is told"


@pytest.mark.thorough
@pytest.mark.parametrize("late_s", [0.12, -0.2])
@pytest.mark.parametrize(
    ("truth", "beside"),
    [
        (TRUTH, set()),
        (BENT, {Fault.ROTATION}),
        (replace(TRUTH, scale_mm_per_px=TRUTH.scale_mm_per_px * [1.1, 1]), {Fault.SCALE}),
        (replace(TRUTH, offset_mm=TRUTH.offset_mm + np.array([8.0, 0, 0])), {Fault.OFFSET}),
    ],
)
def test_beside_a_latency_that_is_known_what_else_is_wrong_is_named_and_nothing_where_nothing_is(
    truth: Calibration, beside: set[Fault], late_s: float
) -> None:
    found, verdicts = named(truth, late_s=late_s)
    assert found == {Fault.LATENCY, *beside}
    first = next(verdict for verdict in verdicts if verdict.kind is FAULT)
    assert first.fault is Fault.LATENCY
    assert OK not in {verdict.kind for verdict in verdicts}


def test_the_reason_has_a_clause_for_the_worst_of_each_class() -> None:
    two = Check("scale-lateral", Fault.SCALE, 10.0, 0.4, "%", 5.0, FAULT)
    less = Check("scale-axial", Fault.SCALE, 6.0, 0.4, "%", 5.0, FAULT)
    bent = Check("rotation-lateral", Fault.ROTATION, 4.5, 0.4, "deg", 3.0, FAULT)
    verdict = judge(0, (bent, less, two), VerificationStatus(()))
    assert verdict.reason == "scale-lateral +10 %, limit 5 %; rotation-lateral +4.5 deg, limit 3 deg"
    assert verdict.fault is Fault.SCALE
