"""Stands in for the service until it is configured: alive, not verified, every contact open, its status says why."""

import threading
from pathlib import Path

from probewatch.appliance.configuration.config import is_configured
from probewatch.appliance.service.control.refusal import leave
from probewatch.appliance.service.host.log import get_log
from probewatch.appliance.service.host.systemd_notify import Notifier
from probewatch.drivers.errors import ConfigurationError

_LOOK_AGAIN_S = 1.0
"""s, the time between two looks at the file and between two signs of life to the watchdog."""
_WHAT = "not configured yet"


def await_configuration(path: Path, stop: threading.Event) -> None:
    """Returns once the file says that it is configured, so that the service manager starts the service again, or on
    stop.

    Opens no output, so that none is energised, and feeds the watchdog for that state. Raises ConfigurationError when
    the file becomes unreadable.
    """
    remedy = f"Run: probewatch configure {path}. The service starts again by itself"
    status = f"not verified, alarm on: {_WHAT}. {remedy}"
    notifier = Notifier()
    get_log().warning("not configured", file=str(path), remedy=remedy)
    leave(path, ConfigurationError(_WHAT, str(path), remedy))
    while not is_configured(path):
        notifier.alive(status)
        if stop.wait(_LOOK_AGAIN_S):
            break
    else:
        get_log().info("configured", file=str(path))
    notifier.close()
