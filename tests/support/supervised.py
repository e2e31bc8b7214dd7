"""A supervisor with a clock that the test moves, what it is told, and the states it is brought into."""

import pytest

from probewatch.appliance.supervision.supervisor import Durations, Inputs, Request, Supervisor
from probewatch.appliance.types import AlarmState, Check, Fault, State, Verdict, VerdictKind

S_NS = 1_000_000_000
TICK_NS = 50_000_000
DURATIONS = Durations()


def ok(t_ns: int) -> Inputs:
    return Inputs(verdicts=(Verdict(t_ns, VerdictKind.OK, (), verified_ns=t_ns),))


def unsure(t_ns: int) -> Inputs:
    return Inputs(verdicts=(Verdict(t_ns, VerdictKind.NOT_VERIFIED, (), reason="still"),))


def resting(t_ns: int) -> Inputs:
    """What was shown stands, and is as old as the tick before."""
    shown_ns = t_ns - TICK_NS
    return Inputs(verdicts=(Verdict(t_ns, VerdictKind.NOT_VERIFIED, (), reason="still", verified_ns=shown_ns),))


def fault(t_ns: int, name: str = "polarity") -> Inputs:
    return Inputs(verdicts=(Verdict(t_ns, VerdictKind.FAULT, (), Fault(name), "seen"),))


def scale(t_ns: int) -> Inputs:
    return fault(t_ns, "scale")


def faults(t_ns: int, *checks: str) -> Inputs:
    """Several at once, each told by the check of that name; the first names the verdict."""
    failing = tuple(Check(name, Fault(name.partition("-")[0]), 9.0, 0.1, "", 4.0, VerdictKind.FAULT) for name in checks)
    healthy = Check("scale-lateral", Fault.SCALE, 0.0, 0.1, "%", 5.0, VerdictKind.OK)
    return Inputs(
        verdicts=(Verdict(t_ns, VerdictKind.FAULT, (healthy, *failing), failing[0].fault, ", ".join(checks)),)
    )


def device(name: str = "video-lost", verdict: VerdictKind = VerdictKind.FAULT) -> Inputs:
    return Inputs(devices=(Check("watcher", Fault(name), 900.0, 0.0, "ms", 500.0, verdict),))


UNSEEN = device("line-of-sight", VerdictKind.NOT_VERIFIED)


class Room:
    """A supervisor with a clock that the test moves."""

    def __init__(self, latched: State | None = None, fault: str | None = None) -> None:
        self.supervisor = Supervisor(DURATIONS, latched, fault)
        self.now_ns = 100 * S_NS
        self.alarm: AlarmState

    def step(self, inputs: Inputs = Inputs()) -> State:  # noqa: B008  frozen value
        self.alarm = self.supervisor.step(self.now_ns, inputs)
        return self.alarm.state

    def at(self, delta_ns: int, inputs: Inputs = Inputs()) -> State:  # noqa: B008  frozen value
        self.now_ns += delta_ns
        return self.step(inputs)

    def ok(self, delta_ns: int = TICK_NS) -> State:
        return self.at(delta_ns, ok(self.now_ns + delta_ns))

    def fault(self, delta_ns: int = TICK_NS, name: str = "polarity") -> State:
        return self.at(delta_ns, fault(self.now_ns + delta_ns, name))

    def ask(self, request: Request) -> State:
        return self.at(TICK_NS, Inputs(request=request))


def room_in(state: State) -> Room:
    """A room brought into a state by the path that leads there in the clinic."""
    room = Room()
    if state is State.SELF_TEST:
        room.step(device("output-failed"))
    elif state is State.WAITING:
        room.step(device())
    elif state is State.NOT_VERIFIED:
        room.step()
        room.at(TICK_NS)
    elif state is State.INTERNAL_FAULT:
        room.step(device("memory-damaged"))
    else:
        room.step()
        room.ok()
        room.ok()
        _lead_on(room, state)
    assert room.alarm.state is state
    return room


def _lead_on(room: Room, state: State) -> None:
    if state is State.RECALIBRATING:
        room.ask(Request.BEGIN_RECALIBRATION)
    elif state is State.DEVICE_LOST:
        room.at(TICK_NS, device())
        room.at(S_NS, device())
    elif state is not State.MONITORING:
        room.fault(name="scale")
        for _ in range({State.WARNING: 0, State.HALT: 1, State.RECALIBRATION_REQUESTED: 3}[state]):
            room.fault(S_NS, "scale")


T, A, N, M, W, H, Q, R, L, I = (  # noqa: E741  one letter a state keeps the table readable
    State.SELF_TEST,
    State.WAITING,
    State.NOT_VERIFIED,
    State.MONITORING,
    State.WARNING,
    State.HALT,
    State.RECALIBRATION_REQUESTED,
    State.RECALIBRATING,
    State.DEVICE_LOST,
    State.INTERNAL_FAULT,
)
INPUTS = {
    "nothing": lambda _: Inputs(),
    "ok": ok,
    "unsure": unsure,
    "resting": resting,
    "fault": fault,
    "frozen": lambda t_ns: fault(t_ns, "frozen-video"),
    "device": lambda _: device(),
    "output": lambda _: device("output-failed"),
    "estimator": lambda _: device("estimator-silent"),
    "damage": lambda _: device("memory-damaged"),
    "log": lambda _: device("log-not-written"),
    "unseen": lambda _: UNSEEN,
    "acknowledge": lambda _: Inputs(request=Request.ACKNOWLEDGE),
    "begin": lambda _: Inputs(request=Request.BEGIN_RECALIBRATION),
    "end": lambda _: Inputs(request=Request.END_RECALIBRATION),
    "abort": lambda _: Inputs(request=Request.ABORT_RECALIBRATION),
}
LATCHED = pytest.mark.parametrize("state", [State.HALT, State.RECALIBRATION_REQUESTED])
REQUEST_AFTER_NS = DURATIONS.halt_after_ns + DURATIONS.recalibrate_after_ns
