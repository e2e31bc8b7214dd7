"""Finds the reference that a service goes on with where its configuration names no calibration."""

from probewatch.appliance.configuration.config import Config
from probewatch.appliance.storage.reference_store import read_history
from probewatch.drivers.errors import ConfigurationError

KEPT = "reference {number} of its history stays in force; another: probewatch calibration use FILE"


def kept_number(config: Config) -> int | None:
    """Returns the number of the reference in force beside a configuration that names none; None where there is none, or
    this user may not read it.
    """
    if config.calibration.file is not None:
        return None
    try:
        history = read_history(config.alarm.folder)
    except ConfigurationError:  # the service itself refuses a damaged one, by name
        return None
    return None if history is None or history.in_force is None else history.in_force.number
