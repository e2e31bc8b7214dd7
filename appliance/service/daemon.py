"""The composition root: opens the devices, starts the estimator, and ticks 20 times a second, waiting for nobody."""

import signal
import time
from pathlib import Path
from types import FrameType
from typing import Any, Self

from appliance.configuration.config import Config, load_config
from appliance.service.control.deadline_worker import DeadlineWorker
from appliance.service.control.recalibration import Recalibration
from appliance.service.control.references import References
from appliance.service.control.reload import reloaded
from appliance.service.control.requests import Hands, Requests
from appliance.service.control.server import ControlRefused, ControlServer
from appliance.service.control.status import (
    alarm_fields,
    audio_fields,
    check_lists,
    configuration_fields,
    log_fields,
    origin_fields,
    output_fields,
    reference_fields,
)
from appliance.service.devices.device_thread import DeviceThread
from appliance.service.devices.output_thread import OutputThread
from appliance.service.devices.rate_meter import RateMeter
from appliance.service.devices.source_thread import CaptureThread, TrackerThread
from appliance.service.estimator.process_host import EstimatorHost
from appliance.service.host.log import get_log
from appliance.service.host.overload_watch import OverloadWatch
from appliance.service.host.recorder import Recorder
from appliance.service.host.systemd_notify import Notifier
from appliance.service.host.tick_meter import TickMeter
from appliance.service.host.wall_clock import WallClock
from appliance.storage.alarm_chain import Latch
from appliance.storage.reference import Reference
from appliance.supervision.alarms import HAZARDS
from appliance.supervision.annunciator import Annunciator
from appliance.supervision.supervisor import LATCHED, TICK_NS, Inputs, Request, Supervisor
from appliance.supervision.watchers.devices import watch_devices
from appliance.supervision.watchers.facts import Facts
from appliance.types import AlarmState, Check, State, Verdict
from drivers.clock.host_clock import HostClock
from drivers.errors import ConfigurationError
from drivers.registry import open_output, open_tracker, open_video

_SOONEST_NS = 10_000_000
"""Between two ticks, however often the estimator speaks. Longer keeps a verdict waiting, which is part of the delay of
the contact; shorter lets a fast camera take the processor: 100 ticks a second are the most.
"""
_JOIN_S = 1.0
"""For which the end waits for the thread of a device that hangs: a good one ends within its read of .1 s."""


class Daemon:
    """Everything that runs, in one place. Leaving the context de-energises the outputs and closes all.

    config_file: where the configuration came from, for reloading it. estimator: without a reference.
    """

    def __init__(
        self,
        config: Config,
        config_file: Path,
        references: References,
        estimator: EstimatorHost,
        clock: HostClock,
        control: ControlServer,
    ) -> None:
        self._config, self._config_file = config, config_file
        self._patience = config.supervisor.patience()
        self._clock, self._control = clock, control
        self._recorder = Recorder(config.alarm.folder, clock)
        self._supervisor = _supervisor(config, self._recorder.latch)
        self._annunciator = Annunciator()
        self._estimator, self._references = estimator, references
        self._worker = DeadlineWorker()
        self._recalibration = Recalibration(
            self._supervisor,
            estimator,
            references,
            self._ask,
            self._worker,
            limits=lambda: self._config.limits,
            took=self._note_reference,
        )
        deliver = self._estimator.put
        self._video = CaptureThread("video", config.video.url, open_video, deliver, clock)
        self._tracker = TrackerThread("tracker", config.tracker.url, open_tracker, deliver, clock)
        self._outputs = [OutputThread(output.signal, output.url, open_output, clock) for output in config.output]
        self._requests = Requests(self._hands())
        self._fps = {"video": RateMeter(), "tracker": RateMeter()}
        self._notifier = Notifier()
        self._ticks = TickMeter(TICK_NS)
        self._overload = OverloadWatch(TICK_NS, self._note)
        self._wall_clock = WallClock()
        self._log = get_log()
        self._started_ns = self._now_ns = clock.now_ns()
        self._heard_ns: int | None = None
        self._verdict: Verdict | None = None
        self._devices: tuple[Check, ...] = ()
        self._alarm: AlarmState | None = None
        self._fed_writes = 0
        self._stopping = self._reloading = False
        self._told_reference: int | None = None

    def __enter__(self) -> Self:
        self._references.begin()
        current = self._references.current
        self._told_reference = None if current is None else current.entry.number
        said = origin_fields(self._config, self._config_file, self._references)
        self._recorder.note("started", self._recorder.latch, found=[*self._recorder.damage], **said)
        self._log.info("started", **said)
        for thread in self._threads():
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Outputs first; a device that hangs is left behind after a second."""
        for thread in self._threads():
            thread.stop()
        for thread in self._threads():
            thread.join(_JOIN_S)
        self._estimator.close()
        self._notifier.close()
        self._overload.close(self._now_ns, self._device_losses)
        self._recorder.note("stopped", self._latch())
        self._references.close()
        self._recorder.close()
        self._log.info("stopped")

    def run(self) -> None:
        """Tick until SIGTERM or SIGINT, at once when the estimator speaks. SIGHUP reloads the configuration.

        Raises what a device thread could not mend, such as ConfigurationError.
        """
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._stop)
        signal.signal(signal.SIGHUP, self._reload_soon)
        while not self._stopping:
            self.tick()
            self._clock.sleep_until(self._now_ns + _SOONEST_NS)
            self._estimator.wait(max(0.0, self._clock.real_s((self._now_ns + TICK_NS - self._clock.now_ns()) / 1e9)))

    def tick(self) -> None:
        """Hear the estimator and the devices, step, serve the socket, command the outputs, feed the watchdog."""
        self._raise_failures()
        self._now_ns = self._clock.now_ns()
        self._ticks.note(self._now_ns)
        self._watch_wall_clock()
        self._recorder.watch(self._overload.since_ns is not None)
        heard, verdicts = self._estimator.poll()
        if heard or not self._estimator.speaking:
            self._heard_ns = self._now_ns if heard else None
            self._verdict = self._verdict if heard else None
        verdicts = self._references.judged(verdicts)
        self._verdict = verdicts[-1] if verdicts else self._verdict
        devices = watch_devices(self._now_ns, self._facts(), self._patience, self._config.limits)
        self._devices = (*devices, self._watch_overload())
        alarm = self._step(Inputs(verdicts, self._devices))
        self._control.poll(self._requests.answer)
        self._reload_if_asked()
        self._show(self._alarm or alarm, self._clock.at(self._estimator.said_ns) if verdicts else self._now_ns)
        self._references.see(self._video.size_px)
        for name, thread in (("video", self._video), ("tracker", self._tracker)):
            self._fps[name].note(self._now_ns, thread.samples)
        self._feed_watchdog(alarm)

    def _show(self, alarm: AlarmState, since_ns: int) -> None:
        """since_ns: when what may have changed the alarm was said."""
        energised = self._annunciator.step(self._now_ns, alarm)
        for output in self._outputs:
            output.command(energised[output.signal], since_ns)

    def _hands(self) -> Hands:
        return Hands(
            ask=self._ask,
            status=self._status,
            clear_bump=self._tracker.clear_bump,
            reload=self._reload,
            recalibration=self._recalibration,
            annunciator=self._annunciator,
            worker=self._worker,
            now_ns=lambda: self._now_ns,
            note=self._note,
        )

    def _threads(self) -> list[DeviceThread]:
        return [*self._outputs, self._video, self._tracker]

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self._stopping = True

    def _reload_soon(self, number: int, frame: FrameType | None) -> None:
        self._reloading = True

    def _reload_if_asked(self) -> None:
        if self._reloading:
            self._reloading = False
            try:
                self._reload()
            except (ControlRefused, ConfigurationError) as error:
                self._log.warning("configuration refused, the old one stays", what=str(error))

    def _reload(self) -> None:
        """Raises ControlRefused, ConfigurationError; then nothing has changed."""
        written = self._worker.run(str(self._config_file), lambda: load_config(self._config_file))
        before, self._config = self._config, reloaded(self._config, written)
        self._references.look_again()
        self._supervisor.retime(self._config.supervisor.durations())
        patience, self._patience = self._patience, self._config.supervisor.patience()
        if (self._config.limits, self._patience.stale_ns) != (before.limits, patience.stale_ns):
            self._estimator.limit(self._config.limits, self._patience.stale_ns)
            self._supervisor.doubt()
        if self._config != before:
            self._recorder.note("reloaded", self._latch(), **configuration_fields(self._config, self._config_file))
        self._log.info("configuration reloaded", file=str(self._config_file))

    def _raise_failures(self) -> None:
        failures = [self._recorder.failure, self._references.failure, *(thread.failure for thread in self._threads())]
        for failure in failures:
            if failure is not None:
                raise failure

    def _watch_overload(self) -> Check:
        check = self._overload.step(self._now_ns, self._estimator.waiting_frames, self._device_losses)
        for thread in self._threads():
            thread.overload_ns = self._overload.since_ns
        return check

    @property
    def _device_losses(self) -> int:
        return sum(thread.losses for thread in self._threads())

    def _facts(self) -> Facts:
        written = [output.written_ns for output in self._outputs]
        known = [written_ns for written_ns in written if written_ns is not None]
        return Facts(
            started_ns=self._started_ns,
            frame_ns=self._video.frame_ns,
            replies=self._tracker.replies,
            heartbeat_ns=self._heard_ns,
            output_ns=min(known) if len(known) == len(written) else None,
            damage=self._recorder.damage,
            log_waits_ns=self._recorder.waited_ns(self._now_ns),
            calibration_file_changed=self._references.changed is not None,
            body=self._tracker.body,
        )

    def _step(self, inputs: Inputs) -> AlarmState:
        before = self._alarm
        alarm = self._supervisor.step(self._now_ns, inputs)
        self._alarm = alarm
        if before is None or (before.state, before.fault) != (alarm.state, alarm.fault):
            self._note_change(before, alarm)
        if before is not None:
            self._recalibration.follow(before.state, alarm.state)
        return alarm

    def _note_change(self, before: AlarmState | None, alarm: AlarmState) -> None:
        if not self._overload.worth_an_entry(before, alarm):
            return
        said = {"state": alarm.state.value, "fault": alarm.fault, "reason": alarm.reason, **self._simulated()}
        if before is None or before.state is not alarm.state:
            self._log.info("state", **said)
        self._recorder.note("state", self._latch(), **said)

    def _note(self, event: str, **data: Any) -> None:
        self._recorder.note(event, self._latch(), **data)

    def _note_reference(self, reference: Reference) -> None:
        """It has just come in force; the one that the start entry named is known."""
        if reference.entry.number == self._told_reference:
            return
        self._told_reference = reference.entry.number
        said = {"reference": reference_fields(reference), **self._simulated()}
        self._log.info("reference", **said)
        self._recorder.note("reference", self._latch(), **said)

    def _simulated(self) -> dict[str, list[str]]:
        """What every state says of its sources; nothing on a real cart."""
        return {"simulated": [*self._config.simulated]} if self._config.simulated else {}

    def _latch(self) -> Latch | None:
        if self._alarm is None:
            return self._recorder.latch
        latched = self._alarm.latched
        return None if latched is None else Latch(latched.value, self._alarm.latched_fault)

    def _watch_wall_clock(self) -> None:
        by_s = self._wall_clock.look(time.monotonic_ns(), time.time_ns())
        if by_s is not None:
            self._log.warning("wall clock stepped", by_s=round(by_s, 3))
            self._recorder.note("wall-clock", self._latch(), by_s=round(by_s, 3))

    def _feed_watchdog(self, alarm: AlarmState) -> None:
        """Only a completed write on some output shows that the alarm path is alive."""
        writes = sum(output.writes for output in self._outputs)
        if writes > self._fed_writes:
            self._fed_writes = writes
            mark = " · SIMULATED" if self._config.simulated else ""
            self._notifier.alive(f"{alarm.state.value}: {alarm.reason}{self._why_silent()}{mark}")

    def _why_silent(self) -> str:
        ended = None if self._estimator.speaking else self._estimator.ended
        return "" if ended is None else f" (estimator {ended})"

    def _ask(self, request: Request) -> None:
        seen = None if self._alarm is None else self._alarm.fault
        self._step(Inputs(devices=self._devices, request=request))
        if self._supervisor.refused:
            raise ControlRefused(self._supervisor.refused)
        if request is Request.ACKNOWLEDGE:
            self._recorder.accept_damage(seen)
        else:
            self._verdict = None
        self._log.info("request granted", request=request.value)

    def _status(self) -> dict[str, Any]:
        assert self._alarm is not None
        testing = self._annunciator.testing(self._now_ns)
        return {
            **alarm_fields(self._now_ns, self._alarm, self._config.alarm.language, self._config.simulated),
            **origin_fields(self._config, self._config_file, self._references),
            "language": self._config.alarm.language,
            **check_lists(self._now_ns, self._verdict, self._devices),
            "audio": audio_fields(self._now_ns, self._annunciator.sound, testing),
            "outputs": output_fields(self._outputs),
            "log": log_fields(self._recorder),
            "lost": {f"{one.role} {one.url}": one.lost for one in self._threads() if one.lost is not None},
            "estimator": self._estimator.ended,
            "remarks": list(self._tracker.remarks),
            "fps": {name: round(meter.per_s, 2) for name, meter in self._fps.items()},
            "tick": self._ticks.fields(),
            "load": self._overload.fields(self._now_ns),
            "counters": self._counters(),
        }

    def _counters(self) -> dict[str, int]:
        word = self._estimator.last
        return {
            "uptime_s": (self._now_ns - self._started_ns) // 1_000_000_000,
            "frames": self._video.samples,
            "poses": self._tracker.samples,
            "frame_gaps": self._video.gaps,
            "early_stamps": self._video.early_stamps + self._tracker.early_stamps,
            "dropped_frames": 0 if word is None else word.dropped_frames,
            "dropped_poses": 0 if word is None else word.dropped_poses,
            "output_writes": sum(output.writes for output in self._outputs),
            "device_losses": self._device_losses,
            "estimator_restarts": max(0, self._estimator.restarts),
            "dropped_clients": self._control.dropped_clients,
            "late_ticks": self._ticks.late,
        }


def _supervisor(config: Config, latch: Latch | None) -> Supervisor:
    """In the state that was latched when the last run ended; one that only another version knows counts as a HALT."""
    if latch is None:
        return Supervisor(config.supervisor.durations())
    state = next((state for state in LATCHED if state.value == latch.state), State.HALT)
    fault = latch.fault if latch.fault in HAZARDS else None
    return Supervisor(config.supervisor.durations(), state, fault)
