"""Which calibration verdicts speak of while a person recalibrates, whatever ends it."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from appliance.calibration_file import write_calibration
from appliance.service.errands import Errands
from appliance.service.estimator_host import EstimatorHost
from appliance.service.recalibration import Recalibration
from appliance.supervision.supervisor import Durations, Inputs, Request, Supervisor
from appliance.types import Calibration, Check, State, Verdict, VerdictKind

OLD = Calibration(np.eye(3), (1, 1), np.array([0.2, 0.2]), np.array([1.0, 2.0, 3.0]), (640, 480))


class Estimator(SimpleNamespace):
    """Knows only which reference it was given last."""

    reference = OLD

    def refer(self, reference: Calibration) -> None:
        self.reference = reference


class Cart:
    """A supervisor that ticks, and the recalibration beside it, wired as the service wires them."""

    def __init__(self, latched: State | None = None) -> None:
        self.estimator = Estimator()
        self.supervisor = Supervisor(Durations(), latched, None if latched is None else "scale")
        self.recalibration = Recalibration(self.supervisor, cast(EstimatorHost, self.estimator), self.ask, Errands())
        self.now_ns = 0
        self.state = self.supervisor.state

    def ask(self, request: Request) -> None:
        self.step(Inputs(request=request))
        assert self.supervisor.refused == ""

    def step(self, inputs: Inputs) -> None:
        self.now_ns += 50_000_000
        before, self.state = self.state, self.supervisor.step(self.now_ns, inputs).state
        self.recalibration.follow(before, self.state)

    def fail(self, fault: str) -> None:
        for _ in range(30):
            self.step(Inputs(devices=(Check(fault, fault, 2, 0, "", 1, VerdictKind.FAULT),)))


@pytest.fixture
def new(tmp_path):
    path = tmp_path / "new.toml"
    write_calibration(path, OLD, {})
    return path


@pytest.mark.parametrize("latched", [None, State.HALT, State.RECALIBRATION_REQUESTED])
@pytest.mark.parametrize("fault", ["video-lost", "estimator-silent"])
def test_what_fails_before_the_new_reference_is_confirmed_returns_to_the_old_one(new, latched, fault):
    cart = Cart(latched)
    while cart.state is not (latched or State.NOT_VERIFIED):
        cart.step(Inputs())
    cart.recalibration.begin()
    cart.recalibration.end(new)
    assert cart.estimator.reference is not OLD
    cart.fail(fault)
    assert cart.state is not State.RECALIBRATING
    assert cart.estimator.reference is OLD


def test_a_recalibration_given_up_returns_to_the_old_reference(new):
    cart = Cart(State.HALT)
    cart.recalibration.begin()
    cart.recalibration.end(new)
    cart.recalibration.abort()
    assert (cart.state, cart.estimator.reference) == (State.HALT, OLD)


def test_a_confirmed_reference_stays(new):
    cart = Cart(State.HALT)
    cart.recalibration.begin()
    cart.recalibration.end(new)
    for _ in range(3):
        cart.step(
            Inputs((Verdict(cart.now_ns + 50_000_000, VerdictKind.OK, (), verified_ns=cart.now_ns + 50_000_000),))
        )
    assert cart.state is State.MONITORING
    cart.fail("video-lost")
    assert cart.estimator.reference is not OLD
