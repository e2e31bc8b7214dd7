"""Reads the alarm log, and the references beside it, while the service may be writing to them."""

import errno
import os
from pathlib import Path

import click

from probewatch.appliance.service.control.rights import join_group
from probewatch.appliance.storage.alarm_chain import MEMORY, Reading, segments
from probewatch.appliance.storage.reference_store import History, read_history
from probewatch.appliance.storage.witnessed_log import read_witnessed_log
from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.german.translation import damage_text, told
from probewatch.tools.shared.named_cart import cart_language

_LOOKS = 3
"""Readings after the first: a write of the service is soon over, so what a fourth reading still finds is damage."""


def settled_log(folder: Path) -> Reading:
    """Reads [alarm] folder of the configuration, also while the service runs. Raises ConfigurationError, also where no
    service has ever written there: an empty folder is not an intact chain.
    """
    try:
        if folder.is_dir():
            refuse_unreadable(*segments(folder), folder / MEMORY)
            reading = _settled(folder)
            if reading.entries or reading.damages:
                return reading
            remedy = "Name [alarm] folder of the configuration; a service that was started once has written there"
            raise ConfigurationError("holds no alarm log", str(folder), remedy)
    except OSError as error:
        remedy = join_group(Path(error.filename or folder)) if isinstance(error, PermissionError) else "Check its disk"
        where = str(error.filename or folder)
        raise ConfigurationError(f"cannot be read ({error.strerror})", where, remedy) from None
    what = "is not a folder" if folder.exists() else "there is no such folder, so no service has run here"
    raise ConfigurationError(what, str(folder), "Name [alarm] folder of the service's configuration")


def refuse_unreadable(*files: Path) -> None:
    """Raises PermissionError for a file that this user may not read. That is not damage, nor is a missing file."""
    for file in files:
        if file.exists() and not os.access(file, os.R_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(file))


def _settled(folder: Path) -> Reading:
    """Reads again after damage: damage that a second reading does not find was an entry still being written."""
    reading = read_witnessed_log(folder)
    for _ in range(_LOOKS):
        if not reading.damages:
            break
        reading = read_witnessed_log(folder)
    return reading


def references_in(folder: Path) -> History:
    """Reads the references that were ever in force. folder: that of the alarm log. Raises ConfigurationError, also
    where there is none.
    """
    history = read_history(folder)
    if history is None or not history.entries:
        what = "holds no reference yet"
        remedy = "A new cart has none before its first scan: probewatch recalibrate --live --solve all; of another cart"
        raise ConfigurationError(what, str(folder), f"{remedy} name --config, or --folder")
    return history


def tell_damage(reading: Reading) -> None:
    """Prints on standard error that a log is damaged, if it is, and that what it still holds was printed."""
    if reading.broken:
        language = cart_language()
        damaged = "the alarm log is damaged: {damage}; what it still holds is told. See: probewatch log --verify"
        what = told(damaged, language, damage=damage_text(str(reading.broken[0]), language))
        click.secho(what, err=True, fg="red")
