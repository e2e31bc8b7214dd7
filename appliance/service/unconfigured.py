"""The service before anyone has configured it: alive, not verified, every contact open, and its status says why."""

import threading
from pathlib import Path

from probewatch.appliance.configuration.config import is_configured
from probewatch.appliance.service.control.refusal import leave
from probewatch.appliance.service.host.log import get_log
from probewatch.appliance.service.host.systemd_notify import Notifier
from probewatch.drivers.errors import ConfigurationError

_LOOK_AGAIN_S = 1.0
_WHAT = "not configured yet"


def await_configuration(path: Path, stop: threading.Event) -> None:
    """Return once the file says that it is configured, so that the service manager starts it again, or on stop.

    No output is opened, so none is energised; that is what the watchdog is fed for. Raises ConfigurationError when the
    file becomes unreadable.
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
