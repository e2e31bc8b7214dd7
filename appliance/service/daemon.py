"""The composition root: opens the devices, starts the estimator, and ticks 20 times a second, waiting for nobody."""

import signal
from collections.abc import Mapping
from pathlib import Path
from types import FrameType
from typing import Any, Self

from appliance.config import Config
from appliance.service.control import ControlRefused, ControlServer, Reply
from appliance.service.device_thread import DeviceThread
from appliance.service.estimator_host import EstimatorHost
from appliance.service.log import get_log
from appliance.service.output_thread import OutputThread
from appliance.service.rate_meter import RateMeter
from appliance.service.recalibration import Recalibration
from appliance.service.source_thread import CaptureThread, TrackerThread
from appliance.service.status import status_fields
from appliance.service.systemd_notify import Notifier
from appliance.supervision.supervisor import Inputs, Request, Supervisor
from appliance.supervision.watchers.devices import watch_devices
from appliance.supervision.watchers.facts import Facts
from appliance.types import AlarmState, Check, Verdict
from drivers.hosttime import HostClock
from drivers.ports import open_output, open_tracker, open_video

TICK_NS = 50_000_000
_JOIN_S = 1.0


class Daemon:
    """Everything that runs, in one place. Leaving the context de-energises the outputs and closes all."""

    def __init__(self, config: Config, estimator: EstimatorHost, clock: HostClock, control: ControlServer) -> None:
        self._clock, self._control = clock, control
        self._patience, self._limits = config.supervisor.patience(), config.limits
        self._supervisor = Supervisor(config.supervisor.durations())
        self._estimator = estimator
        self._recalibration = Recalibration(self._supervisor, self._estimator, self._ask)
        deliver = self._estimator.put
        self._video = CaptureThread("video", config.video.url, open_video, deliver, clock)
        self._tracker = TrackerThread("tracker", config.tracker.url, open_tracker, deliver, clock)
        self._outputs = [OutputThread("output", output.url, open_output, clock) for output in config.output]
        self._fps = {"video": RateMeter(), "tracker": RateMeter()}
        self._notifier = Notifier()
        self._log = get_log()
        self._started_ns = self._now_ns = clock.now_ns()
        self._heard_ns: int | None = None
        self._verdict: Verdict | None = None
        self._devices: tuple[Check, ...] = ()
        self._alarm: AlarmState | None = None
        self._fed_writes = 0
        self._late_ticks = 0
        self._stopping = False

    def __enter__(self) -> Self:
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
        self._log.info("stopped")

    def run(self) -> None:
        """Tick until SIGTERM or SIGINT. Raises what a device thread could not mend, such as ConfigurationError."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._stop)
        due_ns = self._clock.now_ns()
        while not self._stopping:
            self.tick()
            due_ns += TICK_NS
            if due_ns < self._clock.now_ns():
                self._late_ticks += 1
                due_ns = self._clock.now_ns()
            self._clock.sleep_until(due_ns)

    def tick(self) -> None:
        """Hear the estimator and the devices, step, serve the socket, command the outputs, feed the watchdog."""
        self._raise_failures()
        self._now_ns = self._clock.now_ns()
        heard, verdicts = self._estimator.poll()
        if heard or not self._estimator.speaking:
            self._heard_ns = self._now_ns if heard else None
            self._verdict = self._verdict if heard else None
        self._verdict = verdicts[-1] if verdicts else self._verdict
        self._devices = watch_devices(self._now_ns, self._facts(), self._patience, self._limits)
        alarm = self._step(Inputs(verdicts, self._devices))
        self._control.poll(self._answer)
        alarm = self._alarm or alarm
        for output in self._outputs:
            output.command(alarm.energised, self._now_ns)
        for name, thread in (("video", self._video), ("tracker", self._tracker)):
            self._fps[name].note(self._now_ns, thread.samples)
        self._feed_watchdog(alarm)

    def _threads(self) -> list[DeviceThread]:
        return [*self._outputs, self._video, self._tracker]

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self._stopping = True

    def _raise_failures(self) -> None:
        for thread in self._threads():
            if thread.failure is not None:
                raise thread.failure

    def _facts(self) -> Facts:
        written = [output.written_ns for output in self._outputs]
        known = [written_ns for written_ns in written if written_ns is not None]
        return Facts(
            started_ns=self._started_ns,
            frame_ns=self._video.frame_ns,
            reply_ns=self._tracker.reply_ns,
            fresh_ns=self._tracker.fresh_ns,
            pose_ns=self._tracker.pose_ns,
            pose_status=self._tracker.pose_status,
            heartbeat_ns=self._heard_ns,
            output_ns=min(known) if len(known) == len(written) else None,
            body=self._tracker.body,
        )

    def _step(self, inputs: Inputs) -> AlarmState:
        before = self._alarm
        alarm = self._supervisor.step(self._now_ns, inputs)
        self._alarm = alarm
        if before is None or before.state is not alarm.state:
            self._log.info("state", state=alarm.state.value, fault=alarm.fault, reason=alarm.reason)
        if before is not None:
            self._recalibration.follow(before.state, alarm.state)
        return alarm

    def _feed_watchdog(self, alarm: AlarmState) -> None:
        """Only a completed write on some output shows that the alarm path is alive."""
        writes = sum(output.writes for output in self._outputs)
        if writes > self._fed_writes:
            self._fed_writes = writes
            self._notifier.alive(f"{alarm.state.value}: {alarm.reason}")

    def _ask(self, request: Request) -> None:
        self._step(Inputs(devices=self._devices, request=request))
        if self._supervisor.refused:
            raise ControlRefused(self._supervisor.refused)
        self._verdict = None
        self._log.info("request granted", request=request.value)

    def _answer(self, do: str, request: Mapping[str, Any]) -> Reply:
        if do == "status":
            return {"status": self._status()}
        if do == "acknowledge":
            self._ask(Request.ACKNOWLEDGE)
        elif do == "clear-bump":
            self._clear_bump()
        elif do == "begin-recalibration":
            self._recalibration.begin()
        elif do == "end-recalibration":
            self._recalibration.end(Path(str(request.get("file"))))
        elif do == "abort-recalibration":
            self._recalibration.abort()
        else:
            raise ControlRefused(f"'{do}' is no request of this service")
        return {}

    def _clear_bump(self) -> None:
        if not self._tracker.clear_bump():
            raise ControlRefused("the tracker has no bump detector, or is lost")
        self._log.info("request granted", request="clear-bump")

    def _status(self) -> dict[str, Any]:
        assert self._alarm is not None
        fields = status_fields(self._now_ns, self._alarm, self._verdict, self._devices, self._counters())
        fields["lost"] = {f"{one.role} {one.url}": one.lost for one in self._threads() if one.lost is not None}
        fields["remarks"] = list(self._tracker.remarks)
        fields["fps"] = {name: round(meter.per_s, 2) for name, meter in self._fps.items()}
        return fields

    def _counters(self) -> dict[str, int]:
        word = self._estimator.last
        return {
            "frames": self._video.samples,
            "poses": self._tracker.samples,
            "frame_gaps": self._video.gaps,
            "dropped_frames": 0 if word is None else word.dropped_frames,
            "dropped_poses": 0 if word is None else word.dropped_poses,
            "output_writes": sum(output.writes for output in self._outputs),
            "device_losses": sum(thread.losses for thread in self._threads()),
            "estimator_restarts": max(0, self._estimator.restarts),
            "dropped_clients": self._control.dropped_clients,
            "late_ticks": self._late_ticks,
        }
