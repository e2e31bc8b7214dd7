"""`probewatch check FILE`: lists every mistake in a configuration, without starting anything."""

import grp
import sys
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from itertools import chain
from os.path import realpath
from pathlib import Path

import click

from probewatch.appliance.configuration.across import named_urls, shared_port
from probewatch.appliance.configuration.config import (
    CalibrationPlace,
    Config,
    config_of,
    configuration_text,
    is_configured,
)
from probewatch.appliance.configuration.mistakes import Mistakes
from probewatch.appliance.configuration.toml_lines import key_lines, line_of
from probewatch.appliance.service.host.unix_socket import NO_GROUP, make_group
from probewatch.appliance.storage.calibration_file import calibration_bytes, is_device_set
from probewatch.appliance.storage.device_set import remarks
from probewatch.appliance.storage.reference import candidate_from_content, refuse_simulated, size_for
from probewatch.appliance.storage.reference_dates import stated_dates
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.registry import check_options
from probewatch.tools.german.translation import mistake_text, recognised, tell_refused, told
from probewatch.tools.shared.kept_reference import KEPT, kept_number
from probewatch.tools.shared.limits_in_force import remarks as remarks_on_limits
from probewatch.tools.shared.limits_in_force import remarks_on_ages, remarks_on_depth
from probewatch.tools.shared.limits_in_force import rows as limit_rows
from probewatch.tools.shared.named_cart import cart_language, file_argument
from probewatch.tools.shared.unit_sight import unseen_mistakes

_ANY_SIZE_PX = (640, 480)
"""(width, height), stands for the size of pictures that are not there; no other finding depends on it."""

_UNDATED = 'it has no date, so [calibration] overdue = "expires" opens nothing. Give due_days there too'


@click.command()
@file_argument
def command(file: Path) -> None:
    """Check the configuration FILE and the calibration it names. No device is opened, no service is asked.

    Every mistake is one line: file, line, key, value, and the bound or what may have been meant. FILE is
    /etc/probewatch/probewatch.toml unless another one is named. Of a good one it tells which limits are in force and
    why, and what of them keeps the contact open or lets an OK say less than its profile's name.

    \b
    Examples:
      probewatch check
      probewatch check cart.toml

    \b
    Exit code 0: the service would start with it. 78: it would not.
    """
    text = configuration_text(file)
    mistakes = mistakes_in(text, file, cart_language())
    for mistake in mistakes:
        click.echo(mistake, err=True)
    if mistakes:
        if not _is_adapted(file):
            unadapted = "{file} is not configured yet: probewatch configure {file}"
            click.echo(told(unadapted, cart_language(), file=file), err=True)
        sys.exit(ConfigurationError.exit_code)
    config = config_of(text, file)
    named, language = config.calibration.file, config.alarm.language
    dated = _on_dates(config)
    for remark in (*calibration_remarks(text, file), *dated, *_on_limits(config)):
        click.secho(remark, err=True, fg="yellow")
    usable = "{file} can be used; it names no calibration" if named is None else "{file} and {named} can be used"
    click.echo(told(usable, language, file=file, named=named))
    if (number := kept_number(config)) is not None:
        click.echo(told(KEPT, language, number=number))
    click.echo("\n".join(limit_rows(config.limits, text, language)))
    if not is_configured(file):
        click.echo(told("but the service waits until it says configured = true", language))


def _on_limits(config: Config) -> Iterator[str]:
    language = config.alarm.language
    return chain(remarks_on_limits(config.limits, language), remarks_on_ages(config, language), _on_depth(config))


def _on_depth(config: Config) -> Iterator[str]:
    """Yields the warning about a depth below the picture, where the size of the pictures is known before they come."""
    place = config.calibration
    if place.file is None:
        return
    content = calibration_bytes(place.file)
    if (size_px := size_for(content, place, None)) is not None or not is_device_set(content):
        calibration = candidate_from_content(content, str(place.file), size_px, place.probe).calibration
        yield from remarks_on_depth(config.limits, calibration, config.alarm.language)


def _on_dates(config: Config) -> Iterator[str]:
    """Yields which date of the calibration has passed, and the effect of that, or that there is none to pass."""
    place, language = config.calibration, config.alarm.language
    if place.file is None:
        return
    dates, now = stated_dates(calibration_bytes(place.file)), datetime.now(UTC)
    if why := dates.overdue(now):
        opens = place.overdue == "expires" and dates.expired(now)
        yield f"{place.file}: {recognised(f'{why}; the contact stays open' if opens else why, language)}"
    elif place.overdue == "expires" and {dates.due, dates.expires, place.due_days} == {None}:
        yield f"{place.file}: {told(_UNDATED, language)}"


def _is_adapted(file: Path) -> bool:
    """Returns whether a person has configured it; a file that is not TOML counts as configured, as it may have been."""
    try:
        return is_configured(file)
    except ConfigurationError:
        return True


def calibration_remarks(text: str, file: Path) -> tuple[str, ...]:
    """Returns what a person who uses the calibration of a valid configuration must know, one remark per line."""
    place = config_of(text, file).calibration
    return () if place.file is None else remarks(calibration_bytes(place.file), place.image_size_px)


def mistakes_in(text: str, file: Path, language: str = "en") -> list[str]:
    """Returns every mistake in a configuration and in the calibration it names, one per line, in the language.

    `file` is its present or future path.
    """
    try:
        config = config_of(text, file)
    except ConfigurationError as error:
        return rows(error, language)
    own = (*_options(config, file, language), *_group(config, file, language), *unseen_mistakes(config, file, language))
    return [
        *own,
        *_ports(config, text, file, language),
        *calibration_mistakes(config.calibration, language, config.simulated),
    ]


def rows(error: ConfigurationError, language: str) -> list[str]:
    """Returns every mistake, one per line, in the language."""
    if isinstance(error, Mistakes):
        return error.rows(lambda what: mistake_text(what, language))
    tell_refused(error, language)
    return [str(error)]


def _options(config: Config, file: Path, language: str) -> Iterator[str]:
    """Yields the mistakes in the options of the URLs."""
    named = [("[video]", config.video.url, "video"), ("[tracker]", config.tracker.url, "tracker")]
    named += [(f"[output] entry {number}", output.url, "output") for number, output in enumerate(config.output, 1)]
    for section, url, kind in named:
        try:
            check_options(url, kind)
        except ConfigurationError as error:
            tell_refused(error, language)
            yield f"{file}: {section} url = '{url}': {error.advice}"


def _ports(config: Config, text: str, file: Path, language: str) -> Iterator[str]:
    """Yields the mistake of two devices at one serial port that the configuration names in two ways."""
    found = shared_port(named_urls(config.tracker.url, [output.url for output in config.output]), realpath)
    if found is not None:
        line = line_of(found[0].place, key_lines(text))
        yield f"{file}:{line}: {mistake_text(found[1], language)}"


def _group(config: Config, file: Path, language: str) -> Iterator[str]:
    """Yields the mistake in the group that the sockets are to have on this computer."""
    group = config.control.group
    try:
        if group:
            grp.getgrnam(group)
    except KeyError:
        why = mistake_text(f"{NO_GROUP}. {make_group(group)}", language)
        yield f"{file}: [control] group = '{group}': {why}"


def calibration_mistakes(place: CalibrationPlace, language: str, simulated: Sequence[str]) -> list[str]:
    """Returns why the named file cannot be the reference, one reason per line, in the language; empty where it can, or
    where none is named. simulated: URLs of the sources that are not real devices.
    """
    if place.file is None:
        return []
    try:
        content = calibration_bytes(place.file)
        # For a device set the first picture may determine the size; any size stands for it while nothing is started.
        size_px = size_for(content, place, _ANY_SIZE_PX)
        refuse_simulated(candidate_from_content(content, str(place.file), size_px, place.probe), simulated)
    except ConfigurationError as error:
        return rows(error, language)
    return []
