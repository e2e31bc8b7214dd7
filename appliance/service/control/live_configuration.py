"""Holds the configuration in force, and decides what a running service takes from a changed one."""

from pathlib import Path

from probewatch.appliance.configuration.config import Config, load_config
from probewatch.appliance.core.quality.check_fields import limits_fields
from probewatch.appliance.service.control.deadline_worker import DeadlineWorker
from probewatch.appliance.service.control.event_log import EventLog
from probewatch.appliance.service.control.references import References
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.service.control.starting import how_to_restart
from probewatch.appliance.service.control.status import configuration_fields, noise_fields
from probewatch.appliance.service.estimator.process_host import EstimatorHost
from probewatch.appliance.service.host.log import get_log
from probewatch.appliance.storage.alarm_chain import Event
from probewatch.appliance.supervision.supervisor import Supervisor
from probewatch.drivers.errors import ConfigurationError

_TAKEN = {"limits", "noise", "supervisor", "alarm", "recorder"}
"""Sections that a running service takes. The recorder's belongs to another process, which reads it when it starts."""


class LiveConfiguration:
    """Holds the configuration. config: the one in force. timeouts: those that it sets for the device watchers. file:
    the file from which it is read again. asked: set by a signal; the next tick reloads.
    """

    def __init__(
        self,
        config: Config,
        file: Path,
        worker: DeadlineWorker,
        estimator: EstimatorHost,
        references: References,
        supervisor: Supervisor,
        events: EventLog,
    ) -> None:
        self.config, self.file, self.timeouts = config, file, config.supervisor.timeouts()
        self.asked = False
        self._worker, self._estimator, self._references = worker, estimator, references
        self._supervisor, self._events = supervisor, events
        self._log = get_log()

    def reload_if_asked(self) -> None:
        """Reloads if a signal requested it. A signal cannot be answered: a refusal is logged."""
        if self.asked:
            self.asked = False
            try:
                self.reload()
            except (ControlRefused, ConfigurationError) as error:
                self._log.warning("configuration refused, the old one stays", what=str(error))

    def reload(self) -> None:
        """Applies the configuration file anew. Raises ControlRefused, ConfigurationError; then nothing has changed."""
        written = self._worker.run(str(self.file), lambda: load_config(self.file))
        before, self.config = self.config, _taken(self.config, written, self.file)
        self._references.look_again()
        self._supervisor.retime(self.config.durations)
        timeouts, self.timeouts = self.timeouts, self.config.supervisor.timeouts()
        if (self.config.limits, self.timeouts.stale_ns) != (before.limits, timeouts.stale_ns):
            self.verify_anew()
        elif self.config.supervisor.max_verification_age_s > before.supervisor.max_verification_age_s:
            self._supervisor.invalidate_verification()  # a verification that has expired does not count again
        if self.config != before:
            fields = configuration_fields(self.config, self.file)
            rest = {"noise": noise_fields(self.config), "limits": limits_fields(self.config.limits)}
            self._events.note(Event.RELOADED, **fields, **rest)
        self._log.info("configuration reloaded", file=str(self.file))

    def verify_anew(self) -> None:
        """Discards the present verification: the limits changed, the computer slept, or the reference had expired."""
        self._estimator.set_limits(self.config.limits, self.timeouts.stale_ns)
        self._supervisor.invalidate_verification()


def _taken(running: Config, written: Config, file: Path) -> Config:
    """Returns the written configuration. Raises ControlRefused when it changes what only a restart can change."""
    changed = [name for name in Config.model_fields if getattr(running, name) != getattr(written, name)]
    fixed = [f"[{name}]" for name in changed if name not in _TAKEN]
    if running.alarm.folder != written.alarm.folder:
        fixed.append("[alarm] folder")
    if fixed:
        restart = how_to_restart(file, is_running=True)
        raise ControlRefused(f"{', '.join(fixed)} cannot change while it runs: {restart}")
    return written
