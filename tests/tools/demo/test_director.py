"""Which faults the demo shows and when: its plan, and the director that follows the service."""

import pytest

from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Kind, State
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.twins.faults import SLIDE_MM
from probewatch.drivers.twins.scene.world import World
from probewatch.tools.demo.director import Director
from probewatch.tools.demo.outcome import History, Moment, judge
from probewatch.tools.demo.script import FAULT_CLASS, HEALTHY_S, Injection, Planned, Script, chosen_plan, default_plan
from tests.appliance.core.test_line import truth

MONITORING, WARNING, HALT = State.MONITORING, State.WARNING, State.HALT
REQUESTED, LOST = State.RECALIBRATION_REQUESTED, State.DEVICE_LOST
NOT_VERIFIED = State.NOT_VERIFIED


def test_the_default_plan_is_healthy_first_and_fits_into_the_time_given() -> None:
    plan = default_plan()
    assert plan[0].from_s == HEALTHY_S >= 20
    assert {"flip-lateral", "depth", "bend-marker", "latency", "freeze-video", "lose-tracker"} <= {
        one.fault for one in plan
    }
    assert [one.fault for one in default_plan(100)] == ["flip-lateral", "depth"]
    assert default_plan(99) == plan[:1]
    assert default_plan(20) == ()


def test_chosen_faults_come_in_time_order_and_fit_into_the_time_given() -> None:
    assert [one.fault for one in chosen_plan([("depth", 60.0), ("flip-vertical", 20.0)])] == ["flip-vertical", "depth"]
    assert chosen_plan([("depth", 20.0)], 58)
    with pytest.raises(ConfigurationError, match="--duration 57"):
        chosen_plan([("depth", 20.0)], 57)
    with pytest.raises(ConfigurationError, match=r"until 96 s.*--duration|--duration 95: .*96 s"):
        chosen_plan([("depth", 20.0), ("flip-vertical", 21.0)], 95)


def test_every_fault_has_its_class_and_its_states() -> None:
    last = {Kind.CALIBRATION: State.HALT, Kind.DEVICE: State.DEVICE_LOST}
    for fault, fault_class in FAULT_CLASS.items():
        injection = Injection(fault, 20.0, 24.0)
        assert injection.fault_class == fault_class
        more = [REQUESTED] if fault == "depth" else []
        assert [*injection.states] == [State.WARNING, last[fault_class.kind], *more]


def test_the_simulated_slide_is_one_that_motion_recovers() -> None:
    across_mm = float(truth(World()).rotation[2] @ SLIDE_MM)
    assert abs(across_mm) < Limits().offset_mm


class Play:
    """A director before a service that answers each order as `after` says, with a clock that the test moves."""

    def __init__(self, *plan: Planned) -> None:
        self.director, self.t_s = Director(plan), 0.0
        self.orders: list[float] = []

    def stay(self, state: State, seconds: float) -> None:
        """Looks eight times a second."""
        for _ in range(round(seconds * 8)):
            self.t_s += 0.125
            if self.director.step(self.t_s, state):
                self.orders.append(self.t_s)


def test_a_fault_waits_for_its_time_and_for_two_seconds_of_monitoring() -> None:
    play = Play(Planned("depth", 10.0))
    play.stay(NOT_VERIFIED, 12.0)
    assert not play.orders
    play.stay(MONITORING, 2.0)
    assert not play.orders
    play.stay(MONITORING, 0.5)
    assert play.orders == [14.125]
    (depth,) = play.director.shown
    assert (depth.from_s, depth.to_s) == (pytest.approx(14.425), pytest.approx(22.425))
    early = Play(Planned("depth", 10.0))
    early.stay(MONITORING, 11.0)
    assert early.orders == [10.0]


def test_a_fault_goes_when_it_has_led_to_its_last_state_and_the_next_waits_for_the_calibration() -> None:
    play = Play(Planned("depth", 0.0), Planned("lose-tracker", 0.0))
    play.stay(MONITORING, 3.0)
    play.stay(WARNING, 1.0)
    play.stay(HALT, 1.0)
    assert len(play.orders) == 1
    assert play.director.orders.active(play.t_s) == {"depth"}
    play.stay(REQUESTED, 5.0)
    assert play.orders[1:] == [5.125]
    assert (play.director.on(5.3), play.director.on(5.5)) == (play.director.shown[0], None)
    play.stay(MONITORING, 2.5)
    assert play.director.orders.active(play.t_s) == {"lose-tracker"}
    assert not play.director.finished(play.t_s)
    play.stay(LOST, 1.0)
    assert not play.director.finished(play.t_s)
    play.stay(MONITORING, 2.1)
    assert play.director.finished(play.t_s)
    assert play.director.script(60.0) == Script(play.director.shown, 60.0)


def test_a_fault_that_is_not_found_goes_when_its_time_is_up() -> None:
    play = Play(Planned("depth", 0.0))
    play.stay(MONITORING, 12.0)
    (depth,) = play.director.shown
    assert depth.to_s - depth.from_s == pytest.approx(8.0)
    assert play.director.orders.active(depth.to_s) == frozenset()
    assert play.director.finished(14.0)


@pytest.mark.parametrize(("before_s", "timeout_s"), [(0.0, 60.0), (5.0, 30.0)])
def test_a_calibration_that_stays_unverified_ends_the_demo_and_names_what_was_left_out(
    before_s: float, timeout_s: float
) -> None:
    play = Play(Planned("depth", 20.0))
    play.stay(MONITORING, before_s)
    play.stay(NOT_VERIFIED, timeout_s - 0.2)
    assert not play.director.finished(play.t_s)
    play.stay(NOT_VERIFIED, 0.5)
    assert play.director.finished(play.t_s)
    script = play.director.script(play.t_s)
    assert script.left_out == ("depth",)
    outcome = judge(script, History((Moment(8.0, MONITORING, None, ""),), (), (), play.t_s))
    assert "depth did not have its turn" in outcome.sentence
