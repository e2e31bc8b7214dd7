"""A computer short of time is said as such, once, and moves no contact. In simulated time."""

import random
from dataclasses import replace
from itertools import pairwise
from math import isnan, nan
from pathlib import Path

import pytest

from probewatch.appliance.service.host.pressure import Pressure
from probewatch.appliance.supervision.alarms import DISPLAY_COLUMNS, HAZARDS, SILENCES, operator_text
from probewatch.appliance.supervision.languages import LANGUAGES, translated
from probewatch.appliance.supervision.overload import Load, Overload
from probewatch.appliance.supervision.overload_notes import OverloadNotes
from probewatch.appliance.supervision.supervisor import Durations, Inputs, Supervisor
from probewatch.appliance.types import AlarmState, Check, Fault, Kind, State, Verdict, VerdictKind

S_NS, MS_NS = 1_000_000_000, 1_000_000
TICK_NS = 50 * MS_NS
SILENT = (Check("tracker presence", Fault.TRACKER_LOST, 600.0, 0.0, "ms", 500.0, VerdictKind.FAULT),)


class Computer:
    """Ticks as a computer under one kind of load lets them come."""

    def __init__(self) -> None:
        self.overload, self.now_ns = Overload(TICK_NS), 10**12
        self.overload.step(self.now_ns, Load())

    def run(self, seconds: float, load: Load, every_ns: int = TICK_NS) -> list[VerdictKind]:
        """Verdict of every tick."""
        said = []
        for _ in range(max(1, round(seconds * 1e9 / every_ns))):
            self.now_ns += every_ns
            said.append(self.overload.step(self.now_ns, load).verdict)
        return said

    @property
    def overloaded(self) -> bool:
        return self.overload.since_ns is not None


def switches(said: list[VerdictKind]) -> int:
    return sum(a is not b for a, b in pairwise(said))


@pytest.mark.parametrize("load", [Load(0.1), Load(0.5), Load(1.0), Load(nan), Load(0.5, 3)])
def test_a_cart_that_keeps_up_is_not_overloaded_however_busy_the_others_are(load: Load) -> None:
    """Measured: beside eight busy programs on two cores the pressure is 1.0, and no tick is late."""
    assert set(Computer().run(60, load)) == {VerdictKind.OK}


@pytest.mark.parametrize("load", [Load(1.0), Load(nan)])
def test_late_ticks_are_an_overload_also_where_the_kernel_tells_no_pressure(load: Load) -> None:
    computer = Computer()
    computer.run(10, load)
    computer.run(2, load, every_ns=700 * MS_NS)
    assert computer.overloaded


def test_late_ticks_on_a_computer_at_rest_are_none() -> None:
    """As when the process is stopped again and again, or a debugger holds it."""
    computer = Computer()
    assert set(computer.run(30, Load(0.05), every_ns=700 * MS_NS)) == {VerdictKind.OK}


@pytest.mark.parametrize("load", [Load(0.0), Load(nan), Load(1.0)])
def test_a_service_that_was_stopped_once_or_slept_is_not_overloaded(load: Load) -> None:
    computer = Computer()
    computer.run(10, load)
    computer.run(2, load, every_ns=600 * S_NS)
    computer.run(10, load)
    assert not computer.overloaded


def test_an_estimator_that_cannot_keep_up_is_an_overload() -> None:
    computer = Computer()
    computer.run(3, Load(0.05, waiting=8))
    assert computer.overloaded


def test_one_long_tick_is_no_overload_two_are() -> None:
    for ticks, overloaded in ((1, False), (2, True)):
        computer = Computer()
        computer.run(10, Load(1.0))
        computer.run(0.6 * ticks, Load(1.0), every_ns=600 * MS_NS)
        assert computer.overloaded is overloaded


def test_a_load_that_comes_and_goes_is_one_overload_and_its_end_is_told() -> None:
    computer, said = Computer(), []
    for _ in range(40):
        said += computer.run(1.4, Load(1.0), every_ns=700 * MS_NS)
        said += computer.run(3.0, Load(1.0))
    assert (switches(said), computer.overloaded) == (1, True)
    said = computer.run(20, Load(0.1))
    assert (switches(said), computer.overloaded) == (1, False)


def test_no_contact_state_nor_name_depends_on_it() -> None:
    """The same hour, told to two supervisors, of which one knows of an overload that comes and goes."""
    rng = random.Random(14)
    plain, informed = Supervisor(Durations()), Supervisor(Durations())
    now_ns, closed, explained = 10**12, 0, 0
    faults = [None, None, *sorted(SILENCES), Fault.SCALE]
    overloaded = False
    for _ in range(1500):
        now_ns += rng.choice((50, 50, 50, 1000)) * MS_NS
        overloaded = overloaded ^ (rng.random() < 0.05)
        devices, verdicts = _happening(rng.choice(faults) if rng.random() < 0.2 else None, now_ns)
        notice = Check("processor time", Fault.OVERLOADED, 2.0, 0.0, "", 1.0, VerdictKind.FAULT)
        expected = plain.step(now_ns, Inputs(verdicts, devices))
        found = informed.step(now_ns, Inputs(verdicts, (*devices, notice) if overloaded else devices))
        assert found.reason.startswith(expected.reason)
        explained += found.reason != expected.reason
        closed += found.energised
        assert replace(found, notices=(), reason="") == replace(expected, notices=(), reason="")
    assert closed > 50
    assert explained > 10


def _happening(fault: Fault | None, now_ns: int) -> tuple[tuple[Check, ...], tuple[Verdict, ...]]:
    if fault is None or fault.kind is Kind.CALIBRATION:
        kind = VerdictKind.OK if fault is None else VerdictKind.FAULT
        return (), (Verdict(now_ns, kind, (), fault, "", now_ns if kind is VerdictKind.OK else None),)
    return (replace(SILENT[0], fault=fault),), ()


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_text_of_the_lamps_names_the_overload_and_not_the_cable(language: str) -> None:
    hazard = HAZARDS[Fault.OVERLOADED]
    said, remedy = translated(hazard.text, language), translated(hazard.remedy, language)
    for state, fault in ((State.DEVICE_LOST, "tracker-lost"), (State.NOT_VERIFIED, None)):
        text, advice = operator_text(state, fault, language, overloaded=True)
        assert (said in text, advice) == (True, remedy)
    for state, other in ((State.HALT, "scale"), (State.DEVICE_LOST, "marker-body"), (State.MONITORING, None)):
        assert operator_text(state, other, language, overloaded=True) == operator_text(state, other, language)


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_text_that_tells_of_it_fits_the_display(language: str) -> None:
    for state in State:
        for fault in (None, *SILENCES):
            texts = operator_text(state, fault, language, overloaded=True)
            assert all(0 < len(text) <= DISPLAY_COLUMNS for text in texts), texts


def alarm(state: State, fault: str | None = None, latched: State | None = None) -> AlarmState:
    return AlarmState(state, 0, fault, "", state is State.MONITORING, None, latched, notices=(Fault.OVERLOADED,))


def test_an_hour_of_flapping_is_written_in_few_entries_and_counted() -> None:
    notes, entries = OverloadNotes(), 0
    assert [notes.begin(0, 3), notes.begin(S_NS, 4)] == [True, False]
    for _ in range(130):
        for one in (alarm(State.WARNING, "tracker-lost"), alarm(State.NOT_VERIFIED), alarm(State.MONITORING)):
            entries += notes.worth_an_entry(None, one)
    told = notes.end(3600 * S_NS, 133)
    repeated = {"warning (tracker-lost)": 129, "not verified": 129, "monitoring": 129}
    assert told == {
        "for_s": 3600.0, "device_losses": 130, "repeated": repeated, "state": "monitoring", "fault": None,
    }  # fmt: skip
    assert entries == 3
    assert notes.end(3601 * S_NS, 133) is None


def test_what_latches_or_is_no_silence_is_written_each_time() -> None:
    notes = OverloadNotes()
    notes.begin(0, 0)
    halted = alarm(State.HALT, "scale", State.HALT)
    for before, one in (
        (None, alarm(State.WARNING, "scale")),
        (None, halted),
        (halted, alarm(State.MONITORING)),
        (None, alarm(State.DEVICE_LOST, "marker-body")),
    ):
        assert all(notes.worth_an_entry(before, one) for _ in range(3)), one
    calm = replace(alarm(State.WARNING, "tracker-lost"), notices=())
    assert all(notes.worth_an_entry(None, calm) for _ in range(3)), "nothing is folded without an overload"


class Kernel:
    """The files of a kernel: stalled µs of each resource."""

    def __init__(self, folder: Path, group: str | None = None) -> None:
        self._proc, self._groups = folder / "proc", folder / "cgroup"
        (self._proc / "self").mkdir(parents=True)
        (self._proc / "self/cgroup").write_text(f"1:cpu:/x\n0::/{group or ''}\n")
        self._where = self._groups / group if group else self._proc / "pressure"
        self._suffix = ".pressure" if group else ""

    def stall(self, **total_us: int) -> None:
        self._where.mkdir(parents=True, exist_ok=True)
        for resource, us in total_us.items():
            line = f"avg10=0.00 avg60=0.00 avg300=0.00 total={us}\n"
            (self._where / f"{resource}{self._suffix}").write_text(f"some {line}full {line}")

    def pressure(self) -> Pressure:
        return Pressure(self._proc, self._groups)


@pytest.fixture(params=[None, "system.slice/probewatch.service"])
def kernel(request: pytest.FixtureRequest, tmp_path: Path) -> Kernel:
    return Kernel(tmp_path, request.param)


def test_the_share_is_of_the_time_between_two_looks(kernel: Kernel) -> None:
    kernel.stall(cpu=1_000_000, memory=0)
    pressure = kernel.pressure()
    assert isnan(pressure.share(0)), "nothing is known at first"
    for total_us, at_ms, share in ((1_020_000, 50, 0.4), (1_080_000, 100, 1.0), (1_080_000, 150, 0.0)):
        kernel.stall(cpu=total_us, memory=0)
        assert pressure.share(at_ms * MS_NS) == pytest.approx(share)
    kernel.stall(cpu=1_080_000, memory=25_000)
    assert pressure.share(200 * MS_NS) == pytest.approx(0.5), "memory counts as well"
    pressure.close()


def test_a_kernel_without_pressure_is_said_to_tell_nothing(kernel: Kernel) -> None:
    pressure = kernel.pressure()
    assert all(isnan(share) for share in map(pressure.share, (0, TICK_NS, 2 * TICK_NS)))
    kernel.stall(cpu=1)
    half = kernel.pressure()
    assert all(isnan(share) for share in map(half.share, (TICK_NS, 2 * TICK_NS))), "memory is missing"


def test_this_kernels_own_files_are_understood() -> None:
    pressure = Pressure()
    pressure.share(0)
    share = pressure.share(10**18)
    assert isnan(share) or 0 <= share <= 1
    pressure.close()
