"""Performs one tick of the service, 20 times a second and at each report of the estimator. A tick never blocks."""

from probewatch.appliance.service.control.estimate_notes import EstimateNotes
from probewatch.appliance.service.control.event_log import EventLog
from probewatch.appliance.service.control.hold import Hold
from probewatch.appliance.service.control.live_configuration import LiveConfiguration
from probewatch.appliance.service.control.proposals import Proposals
from probewatch.appliance.service.control.references import References
from probewatch.appliance.service.control.requests import Requests
from probewatch.appliance.service.control.server import ControlServer
from probewatch.appliance.service.control.supervision import Supervision
from probewatch.appliance.service.devices.cart_devices import CartDevices
from probewatch.appliance.service.estimator.process_host import EstimatorHost
from probewatch.appliance.service.feed.process_host import FeedHost
from probewatch.appliance.service.host.host_watch import HostWatch
from probewatch.appliance.service.host.recorder import Recorder
from probewatch.appliance.service.host.systemd_notify import Notifier
from probewatch.appliance.supervision.annunciator import Annunciator
from probewatch.appliance.supervision.device_health import DeviceHealth
from probewatch.appliance.supervision.device_watchers import watch_devices
from probewatch.appliance.types import AlarmState, Check, Verdict
from probewatch.drivers.clock.host_clock import HostClock


class Tick:
    """Performs one tick. A fault is commanded in the tick that receives it; the watchdog is fed after that."""

    def __init__(
        self,
        clock: HostClock,
        host: HostWatch,
        estimator: EstimatorHost,
        references: References,
        devices: CartDevices,
        supervision: Supervision,
        recorder: Recorder,
        control: ControlServer,
        requests: Requests,
        hold: Hold,
        configuration: LiveConfiguration,
        annunciator: Annunciator,
        notifier: Notifier,
        estimates: EstimateNotes,
        proposals: Proposals,
        feed: FeedHost,
        events: EventLog,
    ) -> None:
        self._clock, self._host, self._estimator, self._references = clock, host, estimator, references
        self._devices, self._supervision, self._recorder, self._control = devices, supervision, recorder, control
        self._requests, self._hold, self._configuration = requests, hold, configuration
        self._annunciator, self._notifier, self._estimates = annunciator, notifier, estimates
        self._feed, self._events, self._proposals = feed, events, proposals
        self._fed_writes = 0

    def step(self) -> None:
        """Polls the estimator and the devices, steps the supervision, serves the socket, commands the outputs, feeds
        the watchdog.

        Raises the failures that a thread could not recover from, such as ConfigurationError.
        """
        self._raise_failures()
        now_ns = self._clock.now_ns()
        self._host.begin_tick(now_ns)
        if self._references.lapse_ended() or self._host.woke:
            self._configuration.verify_anew()
        verdicts = self._hear(now_ns)
        alarm = self._supervision.step(now_ns, verdicts, self._watch(now_ns))
        self._hold.look(now_ns, self._supervision.recalibrating)
        self._control.poll(self._requests.answer, self._hold.link)
        self._configuration.reload_if_asked()
        self._command(now_ns, self._supervision.alarm or alarm, bool(verdicts))
        self._references.note_relative_pose(self._estimator.reference, self._estimator.relative_pose)
        self._references.see(self._devices.video.size_px)
        self._devices.note_rates(now_ns)
        self._estimates.step(now_ns, alarm, self._supervision.verdict, self._references.current)
        latency_ms = self._configuration.config.tracker_latency_ms
        self._proposals.step(alarm, self._supervision.verdict, self._references.current, latency_ms)
        self._events.overdue(self._references.overdue)
        self._feed_watchdog(alarm)
        self._feed.look_after()

    def _raise_failures(self) -> None:
        failures = (self._recorder.failure, self._references.failure, *self._devices.failures)
        for failure in failures:
            if failure is not None:
                raise failure

    def _hear(self, now_ns: int) -> tuple[Verdict, ...]:
        heard, verdicts = self._estimator.poll()
        verdicts = self._references.judged(verdicts)
        self._supervision.hear(now_ns, heard, self._estimator.reporting, verdicts)
        return verdicts

    def _watch(self, now_ns: int) -> tuple[Check, ...]:
        """Returns the checks of the device watchers and the check of this computer's own load."""
        configuration, overload = self._configuration, self._host.overload
        checks = watch_devices(now_ns, self._health(now_ns), configuration.timeouts, configuration.config.limits)
        load = overload.step(now_ns, self._estimator.waiting_frames, self._devices.losses)
        self._devices.note_overload(overload.since_ns)
        return (*checks, load)

    def _health(self, now_ns: int) -> DeviceHealth:
        return DeviceHealth(
            started_ns=self._supervision.started_ns,
            frame_ns=self._devices.video.frame_ns,
            replies=self._devices.tracker.replies,
            heartbeat_ns=self._supervision.heard_ns,
            output_ns=self._devices.output_ns,
            damage=self._recorder.damage,
            log_waits_ns=self._recorder.waited_ns(now_ns),
            calibration_file_changed=self._references.changed is not None,
            calibration_overdue=bool(self._references.overdue),
            body=self._devices.tracker.body,
        )

    def _command(self, now_ns: int, alarm: AlarmState, judged: bool) -> None:
        """Commands the outputs.

        judged: a verdict came with this tick; then the delay of the contact counts from when the verdict was sent.
        """
        since_ns = self._clock.at(self._estimator.sent_ns) if judged else now_ns
        self._devices.command(self._annunciator.step(now_ns, alarm), since_ns)

    def _feed_watchdog(self, alarm: AlarmState) -> None:
        """Feeds the watchdog if a write on some output was completed: only that shows that the alarm path is alive."""
        writes = self._devices.writes
        if writes > self._fed_writes:
            self._fed_writes = writes
            mark = " · SIMULATED" if self._configuration.config.simulated else ""
            self._notifier.alive(f"{alarm.state.value}: {alarm.reason}{self._why_silent()}{mark}")

    def _why_silent(self) -> str:
        ended = None if self._estimator.reporting else self._estimator.ended
        return "" if ended is None else f" (estimator {ended})"
