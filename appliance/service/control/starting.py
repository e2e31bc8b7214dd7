"""Names the commands that start, restart or end the service of a cart. Those of the unit apply to one cart only: that
of the configuration which the package installs.
"""

from pathlib import Path

from probewatch.drivers.errors import DeviceLost

UNIT_CONFIG = Path("/etc/probewatch/probewatch.toml")
"""The configuration of the service that systemd runs."""
UNIT_SOCKET = Path("/run/probewatch/control")
"""The control socket of that service, unless its configuration names another place (`Control`)."""


class NoService(DeviceLost):
    """Signals that no service answers at a control socket, and that none has left a reason."""


def how_to_start(socket: Path, config_file: Path | None = None) -> str:
    """Returns the command for a service that does not answer at this socket. config_file: None where it is not known;
    then the usual socket identifies the unit.
    """
    if config_file == UNIT_CONFIG or (config_file is None and socket == UNIT_SOCKET):
        return "Start it: systemctl start probewatch; if it ends again, journalctl -u probewatch says why"
    if config_file is None:
        return "Start it: probewatch run --config FILE, with the FILE whose [control] socket this is"
    return f"Start it: probewatch run --config {config_file}"


def how_to_restart(config_file: Path, is_running: bool = False) -> str:
    """Returns the command that restarts a service with this configuration. is_running: the service must end first."""
    if config_file.absolute() == UNIT_CONFIG:
        return "systemctl restart probewatch"
    return f"{'Ctrl-C where it runs, then ' if is_running else ''}probewatch run --config {config_file}"


def how_to_end(socket: Path) -> str:
    """Returns how to end the service that has this socket."""
    return "systemctl stop probewatch" if socket == UNIT_SOCKET else "Ctrl-C where it runs"
