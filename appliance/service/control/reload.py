"""Which part of a changed configuration a running service takes."""

from appliance.configuration.config import Config
from appliance.service.control.server import ControlRefused

_TAKEN = {"limits", "supervisor", "alarm"}


def reloaded(running: Config, written: Config) -> Config:
    """The written configuration. Raises ControlRefused when it changes what only a restart can change."""
    changed = [name for name in Config.model_fields if getattr(running, name) != getattr(written, name)]
    fixed = [f"[{name}]" for name in changed if name not in _TAKEN]
    if running.alarm.folder != written.alarm.folder:
        fixed.append("[alarm] folder")
    if fixed:
        raise ControlRefused(f"{', '.join(fixed)} cannot change while it runs: systemctl restart probewatch")
    return written
