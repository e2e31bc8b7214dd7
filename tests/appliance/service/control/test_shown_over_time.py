"""What the status says of a probe at rest, and after a gap in sight: from samples to status, in simulated time."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import pytest

from probewatch.appliance.core.line import Line
from probewatch.appliance.core.quality.shown import Shown
from probewatch.appliance.core.times import PRESENT_NS
from probewatch.appliance.limits import Limits, RequiredAges
from probewatch.appliance.service.control.status import ages_at_rest, alarm_fields, check_lists, shown_of_each
from probewatch.appliance.supervision.device_health import DeviceHealth, Timeouts
from probewatch.appliance.supervision.device_watchers import watch_devices
from probewatch.appliance.supervision.supervisor import TICK_NS, Durations, Inputs, Supervisor
from probewatch.appliance.types import State, Verdict, VerdictKind
from probewatch.drivers.samples import Frame, Matrix4, Pose, PoseStatus, Sample
from probewatch.drivers.twins.scene.trajectory import Trajectory
from probewatch.drivers.twins.scene.world import World
from tests.appliance.core.test_line import SMALL, truth
from tests.support.sessions import ORIGIN_NS, KeptWorld, session

S_NS = 1_000_000_000
SWEPT_S, OFFSET_S = 14.0, 20.0
"""How old what is shown may be: less than shipped, so that it is over sooner."""
OFFSETS = tuple(f"offset-{axis}" for axis in ("lateral", "axial", "elevational"))
AGES = RequiredAges.model_validate({name: OFFSET_S if name in OFFSETS else SWEPT_S for name in RequiredAges().ages_s})
AT_REST_S = 9.0
AGES_NS = {name: round((age_s or 0) * 1e9) for name, age_s in AGES.ages_s.items()}
RESTS_S, HELD_S, GOES_ON_S = 11.0, 11.5, 31.5
HIDDEN_S, SEEN_S, END_S = 40.5, 41.1, 42.0
"""The hand makes the gesture and comes to rest by itself; it is held there, and makes the gesture again, after which
the markers are covered for a moment.
"""


TEXTS = {
    frozenset({Shown.VERIFIED}): "Calibration verified",
    frozenset({Shown.VERIFIED, Shown.CARRIED}): "Calibration verified · in part by earlier motion",
    frozenset({Shown.CARRIED}): "Calibration verified · by earlier motion",
}


class Resting(Trajectory):
    """As it rests now and then, but for as long as is asked for here."""

    def pose(self, t_s: float) -> Matrix4:
        return super().pose(min(t_s, HELD_S) + max(0.0, t_s - GOES_ON_S))


def resting() -> World:
    world = KeptWorld(3, "gestured", "tissue", SMALL)
    world.trajectory = Resting(3, "gestured")
    return world


def samples() -> Iterator[Sample]:
    for sample in session(resting(), END_S, fps=15.0):
        t_s = (sample.stamp.t_ns - ORIGIN_NS) / 1e9
        if isinstance(sample, Pose) and HIDDEN_S <= t_s < SEEN_S:
            yield replace(sample, matrix=None, status=PoseStatus.MISSING)
        else:
            yield sample


@dataclass(frozen=True)
class Look:
    """The status at one tick."""

    t_s: float
    status: dict[str, Any]
    each: dict[str, Shown]

    def of(self, name: str) -> dict[str, Any]:
        return next(check for check in self.status["checks"] if check["name"] == name)

    @property
    def all(self) -> set[Shown]:
        return {*self.each.values()}


@cache
def looks(at_rest_s: float) -> list[Look]:
    """Of the whole session, twenty a second."""
    limits, durations = Limits(required_age_s=AGES, at_rest_s=at_rest_s), Durations()
    line, supervisor = Line(truth(World(3, settings=SMALL)), limits), Supervisor(durations)
    health, verdict, verdicts, next_ns = DeviceHealth(started_ns=ORIGIN_NS), None, list[Verdict](), ORIGIN_NS
    seen = []
    for sample in samples():
        while next_ns < sample.stamp.t_ns:
            now = replace(health, heartbeat_ns=next_ns, output_ns=next_ns)
            devices = watch_devices(next_ns, now, Timeouts(), limits)
            alarm = supervisor.step(next_ns, Inputs(tuple(verdicts), devices))
            verdict = verdicts[-1] if verdicts else verdict
            verdicts.clear()
            ages_ns = ages_at_rest(verdict, AGES_NS, durations.max_verification_age_ns)
            each = shown_of_each(next_ns, alarm, verdict, ages_ns)
            fields = alarm_fields(next_ns, alarm, "en", shown_now=each) | check_lists(
                next_ns, verdict, devices, ages_ns, each
            )
            seen.append(Look((next_ns - ORIGIN_NS) / 1e9, fields, each))
            next_ns += TICK_NS
        verdicts += line.step(sample)
        if isinstance(sample, Frame):
            health = replace(health, frame_ns=sample.stamp.t_ns)
        else:
            health = replace(health, replies=health.replies.noted(sample.status, sample.stamp.t_ns))
    return seen


def between(from_s: float, to_s: float, at_rest_s: float = 0.0) -> list[Look]:
    return [look for look in looks(at_rest_s) if from_s <= look.t_s < to_s]


@pytest.mark.thorough
def test_a_probe_in_motion_is_verified_at_rest_carried_and_then_missing() -> None:
    moving = between(RESTS_S - 1, RESTS_S)
    assert {look.status["state"] for look in moving} == {State.MONITORING.value}
    assert all(look.all == {Shown.VERIFIED} for look in moving)
    assert {look.status["text"] for look in moving} == {"Calibration verified"}
    for name, age_ns in AGES_NS.items():
        course = [look.each[name] for look in between(RESTS_S, GOES_ON_S)]
        changes = [one for k, one in enumerate(course) if k == 0 or one is not course[k - 1]]
        assert changes == [Shown.VERIFIED, Shown.CARRIED, Shown.MISSING], name
        at_s = {one: between(RESTS_S, GOES_ON_S)[course.index(one)].t_s - RESTS_S for one in (*Shown,)}
        assert at_s[Shown.CARRIED] <= PRESENT_NS / 1e9, name
        assert at_s[Shown.MISSING] <= age_ns / 1e9 + TICK_NS / 1e9, name


@pytest.mark.thorough
def test_a_probe_16_s_at_rest_is_told_as_carried_whatever_the_windows_say() -> None:
    """The longest of them still holds the motion before the rest and says OK."""
    look = between(RESTS_S + 16.0, GOES_ON_S)[0]
    assert any(look.of(name)["verdict"] == VerdictKind.OK.value for name in AGES_NS)
    assert Shown.VERIFIED not in look.all
    assert look.each["offset-axial"] is Shown.CARRIED


@pytest.mark.thorough
def test_ages_are_those_of_the_motion_and_the_contact_opens_with_the_first_that_is_missing() -> None:
    for look in between(RESTS_S, GOES_ON_S):
        still_s = look.t_s - RESTS_S
        for name, one in look.each.items():
            age_s = look.of(name)["shown_age_s"]
            assert age_s is None or age_s >= still_s - 0.1, "no motion since"
            if one is not Shown.MISSING:
                assert age_s <= AGES_NS[name] / 1e9
            assert look.of(name)["shown"] == one.value
            assert look.of(name)["carried"] is (one is Shown.CARRIED)
        closed = look.status["energised"]
        assert closed is (look.status["state"] == State.MONITORING.value)
        assert not (closed and Shown.MISSING in look.all)
        if closed:
            assert look.status["text"] == TEXTS[frozenset(look.all)]


@pytest.mark.thorough
def test_what_was_shown_counts_for_longer_while_the_probe_rests_and_is_told_so() -> None:
    """9 s of the rest are added to the 14 s of what was shown up to 6 s before it, and nothing to the rotation that was
    shown before that; the contact opens with the first, while the status told all the while what is missing.
    """
    gained_s = {}
    for name in AGES_NS:
        missing_s = [
            next(
                (look.t_s for look in between(RESTS_S, GOES_ON_S, at_rest_s) if look.each[name] is Shown.MISSING), None
            )
            for at_rest_s in (0.0, AT_REST_S)
        ]
        if None not in missing_s:
            gained_s[missing_s[0]] = missing_s[1] - missing_s[0]
    in_order = [gained_s[t_s] for t_s in sorted(gained_s)]
    first = in_order.count(0.0)
    assert first <= 1
    assert in_order == pytest.approx([0.0] * first + [AT_REST_S] * (len(in_order) - first))
    assert len(in_order) >= 4
    for look in between(RESTS_S, GOES_ON_S, AT_REST_S):
        assert look.status["energised"] is (Shown.MISSING not in look.all)
        rested_s = look.of("scale-axial")["max_age_s"] - SWEPT_S
        assert rested_s <= min(look.t_s - RESTS_S + 0.6, AT_REST_S)


@pytest.mark.thorough
def test_after_a_gap_in_sight_all_is_missing_at_once_until_new_motion_shows_it() -> None:
    assert between(HIDDEN_S - 0.1, HIDDEN_S)[-1].all == {Shown.VERIFIED}, "verified again after the rest"
    for look in between(HIDDEN_S + 0.4, SEEN_S + 0.5):
        assert look.all == {Shown.MISSING}, look.t_s
        assert not look.status["energised"]
    for look in between(SEEN_S, END_S):
        for name in AGES_NS:
            age_s = look.of(name)["shown_age_s"]
            assert age_s is None or age_s <= look.t_s - HIDDEN_S, "nothing from before the gap"
