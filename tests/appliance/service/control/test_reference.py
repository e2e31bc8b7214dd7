"""Which calibration verdicts speak of while a person recalibrates, whatever ends it."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from typing import cast

import pytest

from probewatch.appliance.configuration.config import load_config
from probewatch.appliance.limits import Limits
from probewatch.appliance.service.control.deadline_worker import DeadlineWorker
from probewatch.appliance.service.control.recalibration import Recalibration, Wanted
from probewatch.appliance.service.control.references import References
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.service.estimator.process_host import EstimatorHost
from probewatch.appliance.supervision.supervisor import Durations, Inputs, Request, Supervisor
from probewatch.appliance.types import PARAMETERS, Calibration, Check, Fault, State, Verdict, VerdictKind
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.samples import Matrix4
from tests.support.polling import until
from tests.support.stores import configuration, kept, log, settled, started, written

pytestmark = pytest.mark.usefixtures("log")
__all__ = ["log"]


class Estimator(SimpleNamespace):
    """Knows only which reference it was given last."""

    reference: Calibration | None = None
    relative_pose: Matrix4 | None = None

    def set_reference(self, reference: Calibration, relative_pose: Matrix4 | None = None) -> None:
        self.reference, self.relative_pose = reference, relative_pose


class Cart:
    """A supervisor that ticks, and the recalibration beside it, wired as the service wires them."""

    def __init__(self, config, latched: State | None = None) -> None:
        self.estimator = Estimator()
        self.supervisor = Supervisor(Durations(), latched, None if latched is None else "scale")
        self.references = started(config)
        self.took = []
        self.recalibration = Recalibration(
            self.supervisor,
            cast(EstimatorHost, self.estimator),
            self.references,
            self.ask,
            DeadlineWorker(),
            limits=Limits,
            took=self.took.append,
        )
        self.now_ns = 0
        self.state = self.supervisor.state
        self.step(Inputs())
        self.old = self.estimator.reference
        assert self.old is not None

    def ask(self, request: Request) -> None:
        self.step(Inputs(request=request))
        assert self.supervisor.refused == ""

    def step(self, inputs: Inputs) -> None:
        self.now_ns += 50_000_000
        inputs = Inputs(self.references.judged(inputs.verdicts), inputs.devices, inputs.request)
        before, self.state = self.state, self.supervisor.step(self.now_ns, inputs).state
        self.recalibration.follow(before, self.state)

    def fail(self, fault: str) -> None:
        for _ in range(30):
            self.step(Inputs(devices=(Check(fault, Fault(fault), 2, 0, "", 1, VerdictKind.FAULT),)))

    def verify(self, *names: str) -> None:
        """OK three times, with these checks shown; not before the disk has what is in force."""
        until(lambda: self.references.on_disk)
        checks = tuple(Check(name, Fault.SCALE, 0, 0, "", 1, VerdictKind.OK) for name in names)
        for _ in range(3):
            t_ns = self.now_ns + 50_000_000
            self.step(Inputs((Verdict(t_ns, VerdictKind.OK, checks, verified_ns=t_ns),)))

    def offset_mm(self) -> float:
        """ζ of the calibration that verdicts speak of."""
        return float(self.estimator.reference.offset_mm[2])


@pytest.fixture
def config(tmp_path):
    return configuration(tmp_path)


@pytest.fixture
def new(tmp_path):
    return Wanted(file=written(tmp_path / "new.toml", 0, 0, 1))


@pytest.mark.parametrize("latched", [None, State.HALT, State.RECALIBRATION_REQUESTED])
@pytest.mark.parametrize("fault", ["video-lost", "estimator-silent"])
def test_what_fails_before_the_new_reference_is_confirmed_returns_to_the_old_one(config, new, latched, fault):
    cart = Cart(config, latched)
    while cart.state is not (latched or State.NOT_VERIFIED):
        cart.step(Inputs())
    cart.recalibration.begin()
    cart.recalibration.end(new)
    assert cart.offset_mm() == 4.0
    cart.fail(fault)
    assert cart.state is not State.RECALIBRATING
    assert cart.estimator.reference is cart.old
    settled(cart.references)
    origins = [entry.origin for entry in kept(config).entries]
    assert origins == ["configuration", "recalibration", "went back to 1"]
    assert settled(started(config)).current.calibration.offset_mm[2] == 3.0


def test_the_history_tells_a_file_that_lay_there_from_one_that_a_scan_made(config, new):
    """Also that its content is one of an earlier reference."""
    cart = Cart(config, State.HALT)
    for wanted in (new, replace(new, scanned=False), replace(new, file=config.calibration.file, scanned=False)):
        cart.recalibration.begin()
        cart.recalibration.end(replace(wanted, confirm=cart.recalibration.propose(wanted)["text"]))
    other = replace(new, file=written(config.alarm.folder.parent / "other.toml", 0, 0, 2), scanned=False)
    cart.recalibration.begin()
    cart.recalibration.end(replace(other, confirm=cart.recalibration.propose(other)["text"]))
    settled(cart.references)
    origins = [entry.origin for entry in kept(config).entries]
    assert origins == ["configuration", "recalibration", "file of reference 2", "file of reference 1", "file"]


def test_a_recalibration_given_up_returns_to_the_old_reference(config, new):
    cart = Cart(config, State.HALT)
    cart.recalibration.begin()
    cart.recalibration.end(new)
    cart.recalibration.abort()
    assert (cart.state, cart.estimator.reference) == (State.HALT, cart.old)
    settled(cart.references)


def test_a_scan_given_up_before_its_end_changes_nothing(config):
    cart = Cart(config, State.HALT)
    cart.recalibration.begin()
    cart.recalibration.abort()
    settled(cart.references)
    assert len(kept(config).entries) == len(cart.took) == 1


def test_a_confirmed_reference_stays_also_after_a_restart(config, new):
    cart = Cart(config, State.HALT)
    cart.recalibration.begin()
    cart.recalibration.end(new)
    cart.verify()
    assert cart.state is State.MONITORING
    cart.fail("video-lost")
    assert cart.offset_mm() == 4.0
    settled(cart.references)
    assert Cart(config).offset_mm() == 4.0
    entry = kept(config).in_force
    assert (entry.number, entry.origin, entry.verified_utc is not None) == (2, "recalibration", True)
    assert "moved by 1.00 mm (lateral +0.00, axial +0.00, elevational +1.00)" in entry.difference


@pytest.mark.parametrize(
    ("shift_mm", "said"), [((0, 0, -30), "moved by 30.00 mm"), ((4.1, 0, 0), "moved by 4.10 mm (lateral +4.10")]
)
def test_a_far_reference_needs_its_difference_confirmed_and_everything_shown(config, tmp_path, shift_mm, said):
    far = written(tmp_path / "far.toml", *shift_mm)
    cart = Cart(config, State.HALT)
    cart.recalibration.begin()
    for confirm in ("", "yes", "moved by 29.00 mm"):
        with pytest.raises(ControlRefused, match="differs from the reference in force: turned by") as refusal:
            cart.recalibration.end(Wanted(file=far, confirm=confirm))
        assert said in str(refusal.value)
    assert cart.estimator.reference is cart.old
    proposal = cart.recalibration.propose(Wanted(file=far))
    assert proposal["confirm"]
    cart.recalibration.end(Wanted(file=far, confirm=proposal["text"]))
    cart.verify("polarity", "scale-lateral", "scale-axial", "rotation-elevational")
    assert cart.state is State.RECALIBRATING, "what is enough for a reference that is near is not enough"
    cart.verify("polarity", *(name for name in PARAMETERS if name != "offset-elevational"))
    assert cart.state is State.RECALIBRATING, "ζ included"
    cart.verify("polarity", *PARAMETERS)
    assert cart.state is State.MONITORING
    settled(cart.references)


def test_a_near_reference_needs_no_confirmation(config, new):
    cart = Cart(config, State.HALT)
    assert not cart.recalibration.propose(new)["confirm"]
    settled(cart.references)


def test_near_references_one_after_the_other_that_lead_far_need_everything_shown(config, tmp_path):
    cart = Cart(config, State.HALT)
    for z_mm in (3, 6):
        cart.recalibration.begin()
        cart.recalibration.end(Wanted(file=written(tmp_path / "step.toml", 0, 0, z_mm)))
    cart.verify("polarity", "scale-lateral", "scale-axial", "rotation-elevational")
    assert cart.state is State.RECALIBRATING
    cart.verify("polarity", *PARAMETERS)
    assert cart.state is State.MONITORING
    settled(cart.references)


def test_a_restart_between_near_references_hides_no_way_that_leads_far(config, tmp_path):
    """The one that was verified last is not in force any more, so how far it is was not known."""
    stopped = Cart(config, State.HALT)
    stopped.recalibration.begin()
    stopped.recalibration.end(Wanted(file=written(tmp_path / "step.toml", 0, 0, 3)))
    settled(stopped.references)
    cart = Cart(config, State.HALT)
    cart.recalibration.begin()
    cart.recalibration.end(Wanted(file=written(tmp_path / "step.toml", 0, 0, 6)))
    cart.verify("polarity", "scale-lateral", "scale-axial", "rotation-elevational")
    assert cart.state is State.RECALIBRATING
    cart.verify("polarity", *PARAMETERS)
    assert cart.state is State.MONITORING
    cart.recalibration.begin()
    cart.recalibration.end(Wanted(file=written(tmp_path / "step.toml", 0, 0, 7)))
    cart.verify()
    assert cart.state is State.MONITORING, "from a verified one a near one is enough again"
    settled(cart.references)


def test_going_back_states_its_difference_and_is_confirmed_and_logged(config, new):
    cart = Cart(config, State.HALT)
    cart.recalibration.begin()
    cart.recalibration.end(new)
    cart.verify()
    cart.recalibration.begin()
    with pytest.raises(ControlRefused, match=r"moved by 1\.00 mm"):
        cart.recalibration.end(Wanted(number=1))
    text = cart.recalibration.propose(Wanted(number=1))["text"]
    cart.recalibration.end(Wanted(number=1, confirm=text, who="anna"))
    assert cart.state is State.RECALIBRATING
    assert cart.offset_mm() == 3.0
    cart.verify()
    assert cart.state is State.MONITORING
    assert [reference.entry.number for reference in cart.took] == [1, 2, 3]
    settled(cart.references)
    entry = kept(config).in_force
    assert (entry.origin, entry.who, entry.sha256) == ("went back to 1", "anna", kept(config).entries[0].sha256)


def test_a_number_that_there_is_not_is_refused(config):
    cart = Cart(config, State.HALT)
    with pytest.raises(ConfigurationError, match=r"reference 7: is not a reference .*, there is only number 1"):
        cart.recalibration.propose(Wanted(number=7))
    settled(cart.references)


def test_a_simulated_scan_is_refused_by_a_cart_with_real_devices(config, tmp_path):
    cart = Cart(config, State.HALT)
    cart.recalibration.begin()
    with pytest.raises(ConfigurationError, match="made of a simulated scan"):
        cart.recalibration.end(Wanted(file=written(tmp_path / "sim.toml", 0, 0, 1, simulated=True)))
    assert cart.estimator.reference is cart.old
    settled(cart.references)


def test_a_cart_without_a_calibration_waits_and_takes_the_first_one_only_when_everything_is_shown(tmp_path) -> None:
    """From then on it is the reference, also after a restart, and the history may not be lost."""
    configuration(tmp_path)
    path = tmp_path / "probewatch.toml"
    path.write_text("".join(line for line in path.read_text().splitlines(True) if "calibration.file" not in line))
    config = load_config(path)
    assert config.calibration.file is None
    references = started(config)
    assert references.current is None
    assert "there is no calibration yet" in references.waits
    candidate = references.from_content((tmp_path / "probe.toml").read_bytes(), "scan.toml")
    references.take(candidate, "recalibration", to_show=("latency",))
    settled(references)
    assert references.current.entry.number == 1
    assert references.waits == "it is the first calibration, and of it is not shown yet: latency"
    again = started(config)
    assert again.current.entry.sha256 == references.current.entry.sha256


@pytest.mark.parametrize("overdue", ["advise", "expires"])
def test_what_has_expired_is_verified_no_more_where_the_configuration_says_so(tmp_path, overdue) -> None:
    """The clock steps over the date and back: verification is withheld, and comes back with the next motion."""
    now = [datetime.now(UTC)]
    config = configuration(tmp_path, more=f'calibration.due_days = 30\ncalibration.overdue = "{overdue}"\n')
    references = References(config, wall_clock=lambda: now[0])
    references.begin()
    until(lambda: references.on_disk)
    ok = Verdict(7, VerdictKind.OK, (), verified_ns=7)
    assert references.judged((ok,)) == (ok,)
    assert references.overdue == ""
    for days, passed in ((29, False), (31, True), (5, False), (-40, True)):
        lapsed = bool(references.overdue)
        now[0] = datetime.now(UTC) + timedelta(days=days)
        assert references.lapse_ended() is (lapsed and not passed and overdue == "expires")
        (told,) = references.judged((ok,))
        assert bool(references.overdue) is passed
        withheld = passed and overdue == "expires"
        assert (told.kind, told.verified_ns) == ((VerdictKind.NOT_VERIFIED, None) if withheld else (VerdictKind.OK, 7))
        assert (references.waits is not None) is withheld
        fault = Verdict(7, VerdictKind.FAULT, (), fault=Fault.SCALE)
        assert references.judged((fault,))[0].kind is VerdictKind.FAULT, "a fault is told whatever the date"
    settled(references)


def test_what_had_expired_is_withheld_until_the_tick_has_asked_for_new_motion(tmp_path) -> None:
    """The clock may be put right between the tick's question and its verdicts."""
    now = [datetime.now(UTC) + timedelta(days=31)]
    config = configuration(tmp_path, more='calibration.due_days = 30\ncalibration.overdue = "expires"\n')
    references = References(config, wall_clock=lambda: now[0])
    references.begin()
    until(lambda: references.on_disk)
    assert not references.lapse_ended()
    now[0] = datetime.now(UTC)
    (told,) = references.judged((Verdict(7, VerdictKind.OK, (), verified_ns=7),))
    assert (told.kind, told.verified_ns) == (VerdictKind.NOT_VERIFIED, None)
    assert "it is due since" in told.reason
    assert references.lapse_ended()
    assert not references.lapse_ended()
    (told,) = references.judged((Verdict(8, VerdictKind.OK, (), verified_ns=8),))
    assert told.verified_ns == 8
    settled(references)
