"""A raised threshold of a name delays the name, and nothing else: what opens the contact comes as before."""

from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.evidence import Evidence
from probewatch.appliance.core.quality.judgement import judge
from probewatch.appliance.core.quality.undecided import undecided
from probewatch.appliance.limits import MOST_NAMED_NATS, NAMED_NATS, Limits
from probewatch.appliance.types import Check, Fault, Verdict, VerdictKind
from probewatch.drivers.errors import ConfigurationError
from tests.appliance.core.quality.test_undecided import accusation
from tests.support.motions import TRUTH, tilting_path
from tests.support.windows import filled

SLID = replace(TRUTH, offset_mm=np.add(TRUTH.offset_mm, [0, 9, 0]))


def played(named_nats: float) -> list[tuple[Verdict, tuple[Check, ...]]]:
    """Verdict and standing contradictions at each solution, of a body that slid unseen after healthy motion."""
    evidence = Evidence(TRUTH, Limits(named_nats=named_nats), filled(tilting_path, 10.0, 1))
    evidence.solve(evidence.window.now_ns)
    whole = filled(tilting_path, 6.0, 3, truth=SLID)
    evidence.window = PathWindow(TRUTH)
    evidence.window.poses = whole.poses
    seen = []
    for index, motion in enumerate(whole._seen):
        evidence.window.add(motion)
        if index % 10 == 9:
            evidence.solve(motion.stamp.t_ns)
            verdict = judge(motion.stamp.t_ns, evidence.checks(), evidence.status)
            seen.append((verdict, tuple(contradiction.check for contradiction in evidence.status.contradictions)))
    return seen


@pytest.mark.thorough
def test_the_name_comes_later_and_the_signs_that_open_the_contact_do_not() -> None:
    shipped, raised = played(NAMED_NATS), played(MOST_NAMED_NATS)
    first, later = (
        next(index for index, (verdict, _) in enumerate(run) if verdict.fault is Fault.OFFSET)
        for run in (shipped, raised)
    )
    assert first < later
    assert [contradictions for _, contradictions in shipped] == [contradictions for _, contradictions in raised]
    opened = next(index for index, (_, contradictions) in enumerate(shipped) if contradictions)
    assert opened < first
    for run in (shipped, raised):
        assert VerdictKind.OK not in {verdict.kind for verdict, _ in run[opened:]}
    assert raised[first][0].kind is VerdictKind.NOT_VERIFIED


def test_a_choice_asks_for_the_raised_threshold_too() -> None:
    assert undecided(accusation(25.0), frozenset()) is not None
    assert undecided(accusation(25.0), frozenset(), 30.0) is None
    told = undecided(accusation(31.0), frozenset(), 30.0)
    assert told is not None
    assert told.limit == 30.0


@pytest.mark.parametrize("nats", [NAMED_NATS - 0.01, 10.0, MOST_NAMED_NATS + 0.01])
def test_no_threshold_below_the_shipped_one_or_beyond_the_most_is_taken(nats: float) -> None:
    with pytest.raises(ConfigurationError, match=r"named_nats = .*: input should be"):
        Limits(named_nats=nats)
