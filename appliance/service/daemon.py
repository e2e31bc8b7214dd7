"""Assembles the parts of the service, starts them, ticks until it is stopped, and closes them: the composition root."""

import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread
from types import FrameType
from typing import Self

from probewatch.appliance.configuration.config import Config
from probewatch.appliance.service.control.deadline_worker import DeadlineWorker
from probewatch.appliance.service.control.estimate_notes import EstimateNotes
from probewatch.appliance.service.control.event_log import EventLog
from probewatch.appliance.service.control.hold import Hold
from probewatch.appliance.service.control.live_configuration import LiveConfiguration
from probewatch.appliance.service.control.proposals import Proposals
from probewatch.appliance.service.control.recalibration import Recalibration
from probewatch.appliance.service.control.references import References
from probewatch.appliance.service.control.requests import Requests, ServiceActions
from probewatch.appliance.service.control.rights import Onlookers
from probewatch.appliance.service.control.server import ControlServer
from probewatch.appliance.service.control.service_status import ServiceStatus
from probewatch.appliance.service.control.status import origin_fields
from probewatch.appliance.service.control.supervision import Supervision, supervisor_after
from probewatch.appliance.service.devices.cart_devices import CartDevices, Openers
from probewatch.appliance.service.estimator.process_host import EstimatorHost
from probewatch.appliance.service.feed.process_host import FeedHost
from probewatch.appliance.service.host.host_watch import HostWatch
from probewatch.appliance.service.host.log import get_log
from probewatch.appliance.service.host.pressure import Pressure
from probewatch.appliance.service.host.recorder import Recorder
from probewatch.appliance.service.host.sleep_watch import Bounds, slept_ns
from probewatch.appliance.service.host.systemd_notify import Notifier
from probewatch.appliance.service.tick import Tick
from probewatch.appliance.storage.alarm_chain import Event
from probewatch.appliance.supervision.annunciator import Annunciator
from probewatch.appliance.supervision.supervisor import TICK_NS
from probewatch.drivers.clock.host_clock import HostClock

SOONEST_NS = 10_000_000
"""ns, the shortest time between the beginnings of two ticks, however often the estimator reports. More keeps a verdict
waiting, which adds to the delay of the contact; less lets a fast camera take the processor: 100 ticks a second are the
most.
"""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Holds what the service takes from the computer that it runs on, apart from the clock and the files.

    pressure, worker: are called once each. wall_ns: calendar time, ns. slept: bounds of the time that the computer has
    slept.
    """

    openers: Openers = field(default_factory=Openers)
    pressure: Callable[[], Pressure] = Pressure
    worker: Callable[[], DeadlineWorker] = DeadlineWorker
    wall_ns: Callable[[], int] = time.time_ns
    slept: Callable[[], Bounds] = slept_ns


class Daemon:
    """Owns everything that runs. Leaving the context de-energises the outputs and closes everything.

    config_file: the file that the configuration came from, for reloading it. estimator: one that has no reference yet.
    """

    def __init__(
        self,
        config: Config,
        config_file: Path,
        references: References,
        estimator: EstimatorHost,
        clock: HostClock,
        control: ControlServer,
        surroundings: Surroundings | None = None,
    ) -> None:
        around = Surroundings() if surroundings is None else surroundings
        self._clock, self._references, self._estimator, self._control = clock, references, estimator, control
        self._recorder = Recorder(config.alarm.folder, clock)
        self._events = EventLog(self._recorder, config.simulated)
        self._host = HostWatch(
            TICK_NS, self._recorder, self._events.note, clock, around.pressure(), around.wall_ns, around.slept
        )
        self._devices = CartDevices(config, estimator.put, clock, around.openers)
        onlookers = Onlookers.of(config)
        self._feed = FeedHost(config.feed_socket, config.control.group, onlookers.all, onlookers.without_pictures)
        estimator.tap = self._feed.tap
        self._notifier, self._worker, self._annunciator = Notifier(), around.worker(), Annunciator()
        self._supervisor = supervisor_after(self._recorder.latch, config.durations)
        self._supervision = Supervision(
            self._supervisor, self._events, self._host.overload, self._recorder, clock.now_ns()
        )
        self._configuration = LiveConfiguration(
            config, config_file, self._worker, estimator, references, self._supervisor, self._events
        )
        self._proposals = Proposals(self._events)
        recalibration = self._make_recalibration()
        self._hold = Hold(recalibration.abort, self._events.note, control.is_open)
        self._tick = self._make_tick(self._make_requests(recalibration, onlookers))
        self._stopping = False

    def _make_recalibration(self) -> Recalibration:
        recalibration = Recalibration(
            self._supervisor,
            self._estimator,
            self._references,
            self._supervision.ask,
            self._worker,
            limits=lambda: self._configuration.config.limits,
            took=self._events.reference,
        )
        self._supervision.follow = recalibration.follow
        return recalibration

    def _make_requests(self, recalibration: Recalibration, onlookers: Onlookers) -> Requests:
        return Requests(
            ServiceActions(
                ask=self._supervision.ask,
                status=self._make_status().fields,
                clear_bump=self._devices.tracker.clear_bump,
                reload=self._configuration.reload,
                recalibration=recalibration,
                hold=self._hold,
                annunciator=self._annunciator,
                worker=DeadlineWorker(),
                now_ns=lambda: self._supervision.now_ns,
                note=self._events.note,
                onlookers=onlookers.refused,
            )
        )

    def _make_status(self) -> ServiceStatus:
        return ServiceStatus(
            supervision=self._supervision,
            configuration=self._configuration,
            references=self._references,
            annunciator=self._annunciator,
            devices=self._devices,
            estimator=self._estimator,
            recorder=self._recorder,
            host=self._host,
            feed=self._feed,
            hold=self._hold,
            proposals=self._proposals,
            dropped_clients=lambda: self._control.dropped_clients,
        )

    def _make_tick(self, requests: Requests) -> Tick:
        return Tick(
            clock=self._clock,
            host=self._host,
            estimator=self._estimator,
            references=self._references,
            devices=self._devices,
            supervision=self._supervision,
            recorder=self._recorder,
            control=self._control,
            requests=requests,
            hold=self._hold,
            configuration=self._configuration,
            annunciator=self._annunciator,
            notifier=self._notifier,
            estimates=EstimateNotes(self._events),
            proposals=self._proposals,
            feed=self._feed,
            events=self._events,
        )

    def __enter__(self) -> Self:
        self._references.begin()
        current = self._references.current  # read first: a reference that comes meanwhile is logged twice, not never
        self._events.started(
            current, origin_fields(self._configuration.config, self._configuration.file, self._references)
        )
        self._devices.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Closes everything, the outputs first."""
        self._devices.close()
        self._estimator.close()
        self._feed.close()
        self._notifier.close()
        self._host.overload.close(self._supervision.now_ns, self._devices.losses)
        self._events.note(Event.STOPPED)
        self._references.close()
        self._recorder.close()
        get_log().info("stopped")

    def run(self) -> None:
        """Ticks until SIGTERM or SIGINT, and without delay when the estimator reports. SIGHUP reloads the
        configuration.

        Raises the failures that a device thread could not recover from, such as ConfigurationError.
        """
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._stop)
        signal.signal(signal.SIGHUP, lambda *_: self.reload_soon())
        while not self._stopping:
            ticked_ns = self.step()
            self._clock.sleep_until(ticked_ns + SOONEST_NS)
            self._estimator.wait(max(0.0, self._clock.real_s((ticked_ns + TICK_NS - self._clock.now_ns()) / 1e9)))

    def step(self) -> int:
        """Performs one tick; returns when it began, ns of the clock. Raises what a device thread could not recover
        from.
        """
        self._tick.step()
        return self._supervision.now_ns

    @property
    def threads(self) -> tuple[Thread, ...]:
        """Returns the threads that run beside the tick, except those that serve a single request."""
        return (self._recorder, self._references, *self._devices.threads)

    def reload_soon(self) -> None:
        """Requests that the next tick reads the configuration again."""
        self._configuration.asked = True

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self._stopping = True
