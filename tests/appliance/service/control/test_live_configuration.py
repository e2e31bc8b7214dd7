"""A changed configuration on its way to what works by it."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from probewatch.appliance.limits import Limits
from probewatch.appliance.service.control.deadline_worker import DeadlineWorker
from probewatch.appliance.service.control.event_log import EventLog
from probewatch.appliance.service.control.live_configuration import LiveConfiguration
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.service.estimator.process_host import EstimatorHost
from probewatch.appliance.service.host.recorder import Recorder
from probewatch.appliance.storage.alarm_chain import read_log
from probewatch.appliance.supervision.supervisor import TICK_NS, Inputs, Supervisor
from probewatch.appliance.types import State, Verdict, VerdictKind
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.samples import Frame, Stamp
from tests.support import stand_in_estimator as stand_in
from tests.support import stores
from tests.support.polling import until

pytestmark = pytest.mark.usefixtures("log")
log = stores.log
COMMAND = (sys.executable, "-m", "tests.support.stand_in_estimator")


@dataclass
class Verified:
    """A supervisor that every tick is told OK, shown by motion of verified_ns."""

    supervisor: Supervisor
    now_ns: int = 0
    verified_ns: int = 1

    def state_after(self, seconds: float) -> State:
        for _ in range(round(seconds * 1e9 / TICK_NS)):
            self.now_ns += TICK_NS
            ok = Verdict(self.now_ns, VerdictKind.OK, (), verified_ns=self.verified_ns)
            self.supervisor.step(self.now_ns, Inputs((ok,)))
        return self.supervisor.state


@dataclass
class Running:
    """The parts of a service that follow its configuration, and no devices."""

    folder: Path

    def __post_init__(self) -> None:
        config = stores.configuration(self.folder)
        self.references = stores.started(config)
        self.recorder = Recorder(config.alarm.folder, HostClock())
        timeouts = config.supervisor.timeouts()
        self.estimator = EstimatorHost(stores.calibration(), config.limits, timeouts.stale_ns, COMMAND)
        self.live = LiveConfiguration(
            config,
            self.folder / "probewatch.toml",
            DeadlineWorker(),
            self.estimator,
            self.references,
            Supervisor(config.supervisor.durations()),
            EventLog(self.recorder, ()),
        )

    def write(self, more: str) -> None:
        self.live.file.write_text(f"{self.live.file.read_text()}{more}")

    def stale_ns(self) -> float:
        """As the line of the estimator's process has it; the first call starts that."""
        until(lambda: self.estimator.poll()[0])
        self.estimator.put(Frame(Stamp(1, 0), 1, np.full((48, 64), stand_in.OK, np.uint8)))
        return until(lambda: self.estimator.poll()[1])[-1].checks[0].limit

    def limits(self) -> Limits:
        """Within which the estimator's process judges; stale_ns() starts it."""
        self.estimator.put(Frame(Stamp(2, 0), 2, np.full((48, 64), stand_in.LIMITS, np.uint8)))
        return Limits.model_validate_json(until(lambda: self.estimator.poll()[1])[-1].reason)

    def close(self) -> None:
        self.estimator.close()
        self.recorder.close()
        self.references.close()


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    running = Running(tmp_path)
    yield running
    running.close()


def test_other_timeouts_of_a_tracker_reach_watchers_and_line(running: Running) -> None:
    assert running.stale_ns() == 500_000_000
    running.write("supervisor.tracker_stale_ms = 250\n")
    running.live.reload()
    assert running.live.timeouts.stale_ns == 250_000_000
    until(lambda: running.stale_ns() == 250_000_000)
    running.recorder.close()
    assert [entry.event for entry in read_log(running.live.config.alarm.folder).entries][-1] == "reloaded"


def test_other_limits_reach_the_line(running: Running) -> None:
    running.stale_ns()
    running.write("limits.scale_percent = 3\n")
    running.live.reload()
    until(lambda: running.limits().scale_percent == 3)
    assert running.limits() == running.live.config.limits


@pytest.mark.parametrize("more", ['"fine"', '"fine"\nlimits.offset_mm = 50.0', '"clinical"\nlimits.offset_mm = 4.0'])
def test_what_one_profile_verified_is_not_verified_by_another(running: Running, more: str) -> None:
    """Neither by a tighter one nor by one with a looser limit: the line begins again, and so does the room."""
    room = Verified(running.live._supervisor)
    running.stale_ns()
    assert room.state_after(2.0) is State.MONITORING
    running.write(f"limits.profile = {more}\n")
    running.live.reload()
    assert room.state_after(0.1) is State.NOT_VERIFIED, "what was shown before counts no more"
    assert room.state_after(5.0) is State.NOT_VERIFIED
    until(lambda: running.limits() == running.live.config.limits)
    room.verified_ns = room.now_ns
    assert room.state_after(2.0) is State.MONITORING, "motion since then does"


def test_what_has_expired_does_not_count_again_by_a_longer_age(running: Running) -> None:
    before = running.live.file.read_text()
    running.write("supervisor.max_verification_age_s = 10\n")
    running.live.reload()
    room = Verified(running.live._supervisor)
    assert room.state_after(5.0) is State.MONITORING
    assert room.state_after(6.0) is State.NOT_VERIFIED
    running.live.file.write_text(f"{before}supervisor.max_verification_age_s = 60\n")
    running.live.reload()
    assert room.state_after(1.0) is State.NOT_VERIFIED
    room.verified_ns = room.now_ns
    assert room.state_after(1.0) is State.MONITORING


def test_what_only_a_restart_can_change_is_refused_and_changes_nothing(running: Running) -> None:
    running.write('control.socket = "/run/other"\nsupervisor.tracker_stale_ms = 250\n')
    with pytest.raises(ControlRefused, match=r"\[control\] cannot change while it runs"):
        running.live.reload()
    assert running.live.timeouts.stale_ns == 500_000_000


def test_a_signal_reloads_at_the_next_tick_and_a_refusal_is_logged(running: Running, log) -> None:
    running.write("supervisor.tracker_stale_ms = 250\n")
    running.live.reload_if_asked()
    assert running.live.timeouts.stale_ns == 500_000_000, "nobody has asked"
    running.live.asked = True
    running.live.reload_if_asked()
    assert running.live.timeouts.stale_ns == 250_000_000
    running.write("supervisor.unseen_s = 0\n")
    running.live.asked = True
    running.live.reload_if_asked()
    until(lambda: "configuration refused, the old one stays" in log.getvalue())
    assert not running.live.asked
    assert running.live.timeouts.stale_ns == 250_000_000
