"""Connects a live scan of `probewatch recalibrate` to the service on which it is made."""

from dataclasses import dataclass
from pathlib import Path

import click

from probewatch.appliance.configuration.config import Config, load_config
from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.supervision.alarms import NOT_NOW
from probewatch.appliance.types import State
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.atomic_file import check_writable, make_folder
from probewatch.tools.german.translation import recognised, refusing_in
from probewatch.tools.recalibration.paperwork import Begin, Signature
from probewatch.tools.recalibration.session import ScanSession
from probewatch.tools.recalibration.terminal import run
from probewatch.tools.shared.named_cart import SOCKET, named_or_own
from probewatch.tools.shared.spoken import language_of
from probewatch.tools.shared.status_watch import StatusWatch
from probewatch.tools.shared.unit_sight import unseen
from probewatch.tools.shared.verification import reporting_change

_LOOK_S = 0.2
"""Seconds between two questions to the service during a live scan: four of its ticks."""
_NOT_IN = (State.SELF_TEST.value, State.DEVICE_LOST.value, State.INTERNAL_FAULT.value)
"""States in which no service begins to recalibrate, by its table (`appliance.supervision.supervisor`)."""
_FOLDER = "calibrations"
"""Subfolder of the alarm log's folder, where the package lets members of the group write."""


@dataclass(frozen=True, slots=True)
class LiveService:
    """Represents the service on which a live scan is made. `control` and `pictures` are its sockets; `place` is the
    folder of the new file; `language` is that of the cart.
    """

    control: Path
    pictures: Path
    place: Path
    language: str = "en"


def live_service(config_file: Path | None, socket: Path | None, feed: Path | None, folder: Path | None) -> LiveService:
    """Returns the service. Raises ConfigurationError, DeviceLost or ControlRefused before any question is put, so that
    no answer is typed in vain, as with no service or during another recalibration.
    """
    named = named_or_own(config_file, socket)
    config = None if named is None else load_config(named)
    control = socket or (None if config is None else config.control.socket)
    if control is None:
        raise click.UsageError("name the service: --config FILE, or --socket")
    pictures = feed or (None if config is None else config.feed_socket) or control.with_name("feed")
    place = _live_folder(folder, config, control)
    with ControlClient(control) as client:
        status = client.status()
    begun = status.get("recalibration")
    if begun and begun["ended"] is None:
        what = f"{begun['who']} has recalibrated for {begun['since_s']:.0f} s"
        raise ControlRefused(what, str(control), "Wait, or end it there")
    language = language_of(status)
    if status["state"] in _NOT_IN:
        what = recognised(f"{NOT_NOW} {status['state']}", language)
        raise ControlRefused(f"{what}: {recognised(status['reason'], language)}", str(control), status["remedy"])
    return LiveService(control, pictures, place, language)


def scan_live(service: LiveService, begin: Begin, signature: Signature | None) -> None:
    """Leads a person at the terminal through the scan."""
    with (
        reporting_change(service.control, service.language),
        StatusWatch(service.control, _LOOK_S) as watch,
        ScanSession(service.control, service.pictures, service.place, watch) as session,
        refusing_in(service.language),
    ):
        run(session, begin, signature, service.language)


def _live_folder(folder: Path | None, config: Config | None, control: Path) -> Path:
    """Returns a folder for the new file that the service can read; its unit has no access to home folders. Raises
    ConfigurationError before the scan, not after it.
    """
    place = folder or (Path() if config is None else config.alarm.folder / _FOLDER)
    if control == SOCKET and (why := unseen(place)):
        raise ConfigurationError(why.partition(". ")[0], str(place), "Name another --folder, or leave it out")
    try:
        make_folder(place)
    except OSError as error:
        what = f"cannot be made ({error.strerror})"
        raise ConfigurationError(what, str(place), "Be a member of the group probewatch, or name a --folder") from None
    check_writable(place / "new.toml")
    return place.absolute()
