"""`probewatch configure`: writes the configuration of a cart, without an editor."""

import difflib
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import click

from probewatch.appliance.configuration.config import CalibrationPlace, Config, config_of, configuration_text
from probewatch.appliance.configuration.toml_lines import Place
from probewatch.appliance.limits import PROFILES, Profile
from probewatch.appliance.service.control.starting import how_to_restart
from probewatch.appliance.supervision.annunciator import Role
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.device_api import TrackerSource, VideoSource
from probewatch.drivers.errors import ConfigurationError, DeviceLost
from probewatch.drivers.files.atomic_file import check_kind, check_writable, writing
from probewatch.drivers.io.inventory import CONNECTED, ROOT, Found
from probewatch.drivers.registry import check_options, is_simulated, open_tracker, open_video
from probewatch.tools.commands.check import calibration_mistakes, calibration_remarks, mistakes_in, rows
from probewatch.tools.commands.probe import complaints, findings, measure
from probewatch.tools.german.devices import device_text
from probewatch.tools.german.translation import recognised, told
from probewatch.tools.shared.configuration_text import Answers, Value, changed, template
from probewatch.tools.shared.device_question import DeviceQuestion, Respondent, whole_path
from probewatch.tools.shared.driver_text import real_drivers
from probewatch.tools.shared.interruption import stopped_saying
from probewatch.tools.shared.kept_reference import KEPT, kept_number
from probewatch.tools.shared.limits_in_force import remarks as remarks_on_limits
from probewatch.tools.shared.named_cart import cart_language, file_argument, speak
from probewatch.tools.shared.unit_sight import is_of_the_unit

_TRIAL_S = 2.0
"""Time, s, for which a device is tried: forty pictures of a slow scanner, and not long for a person to wait. Not
varied."""
_PROFILES: dict[Profile, str] = {
    "coarse": "3 deg, 5 %, 4 mm, 60 ms: finds a wrong or bent marker body, cable, depth; the one to begin with",
    "clinical": "1.5 deg, 3 %, 2.5 mm, 30 ms, a point within 4 mm: optical tracker, phantom; open more often",
    "fine": "1 deg, 2 %, 1.5 mm, 20 ms, a point within 2.5 mm: over rigid tissue alone, gesture of 10 s",
}
_LAMPS = [role.value for role in Role if role is not Role.CONTACT]
_HELP = """Write the configuration of this cart, without an editor.

FILE is /etc/probewatch/probewatch.toml unless another one is named. What is not given is asked for: the scanner's
picture, the tracker, the contact, a calibration if there is one, the limits, the language. What is connected to this
computer is listed to choose from by number; each answer has a default in brackets. Scanner and tracker are tried for
two seconds; the contact is not moved.

FILE keeps all its other lines and comments; where there is none, or with --fresh, it begins as the commented template.
It is checked as `probewatch check` does, the difference is shown, and nothing is written before it is accepted; then
the file is the old one or the new one, never a part. A service that waits to be configured starts by itself.

\b
In a script, give video, tracker, contact and --yes, and nothing is asked:
  probewatch configure --video v4l2:/dev/video0 --tracker "ndi:/dev/ttyUSB0?probe=/etc/probewatch/probe.rom"
    --contact relay:/dev/ttyUSB1 --no-calibration --yes

Exit code 0: written, or nothing to change. 69: a device that was tried does not work. 78: the configuration would be
refused, or cannot be written. 130: declined.
"""


@click.command("configure", help=_HELP)
@file_argument
@click.option("--video", help="URL of the scanner's picture")
@click.option("--tracker", help="URL of the tracker")
@click.option("--contact", help="URL of the output that drives the contact")
@click.option("--lamp", "lamps", nargs=2, multiple=True, metavar="SIGNAL URL", help=f"{', '.join(_LAMPS)}; repeatable")
@click.option("--calibration", help="the first reference: a probewatch TOML file or a PLUS device set")
@click.option("--calibration-probe", "probe", help="its marker body in a device set, or LeftImageToProbe [Probe]")
@click.option("--no-calibration", "without", is_flag=True, help="no calibration yet: it is scanned on this cart")
@click.option("--profile", type=click.Choice(list(PROFILES)), help="how much the calibration may be off at an OK")
@click.option("--language", type=click.Choice(["en", "de"]), help="of the operator's texts")
@click.option("--untried", is_flag=True, help="skip the test of scanner and tracker")
@click.option("--fresh", is_flag=True, help="start from the template, not from FILE")
@click.option("--yes", is_flag=True, help="write FILE without confirmation")
def command(
    file: Path,
    video: str | None,
    tracker: str | None,
    contact: str | None,
    lamps: tuple[tuple[str, str], ...],
    calibration: str | None,
    probe: str | None,
    without: bool,
    profile: str | None,
    language: str | None,
    untried: bool,
    fresh: bool,
    yes: bool,
) -> None:
    if language is not None:
        speak(language)
    if without and calibration is not None:
        raise click.UsageError("--calibration names one; leave --no-calibration out")
    _refuse_unwritable(file)
    before = configuration_text(file) if file.exists() else None
    base = template() if fresh or before is None else before
    known = _known(base, file)
    person = Respondent(is_of_the_unit(file), language or known.alarm.language)
    old = known if known.configured and base == before else None
    try_it = None if untried else _trying(person.language)
    place = _calibration_place(known, probe)
    if calibration is not None and calibration != "none":
        _refuse_calibration(place, whole_path(calibration), _simulated(video, tracker), person)
    at = _place(known, Role.CONTACT)
    seen = DeviceQuestion("video", video, old.video.url if old else "", try_it)
    tracked = DeviceQuestion("tracker", tracker, old.tracker.url if old else "", try_it)
    opened = DeviceQuestion("output", contact, old.output[at].url if old else "", None)
    for device in (seen, tracked, opened):
        device.check_given()
    lit = _lamps(known, lamps)
    with stopped_saying(person.tell("nothing was written"), person.tell("stopped")):
        answers: dict[Place, Value] = {("configured",): True}
        answers["video", "url"] = seen.url(person, lambda: _connected("video", language=person.language))
        answers["tracker", "url"] = held = tracked.url(person, lambda: _connected("tracker", language=person.language))
        answers["output", at, "url"] = driven = opened.url(person, lambda: _connected("output", held, person.language))
        answers |= lit
        simulated = _simulated(answers["video", "url"], held)
        answers["calibration", "file"] = _calibration(calibration, without, old, place, simulated, person)
        if probe is not None:
            answers["calibration", "probe"] = probe
        limited = profile or _profile(known, person)
        if limited != known.limits.profile:
            answers["limits", "profile"] = limited
        spoken = language or _language(known, person)
        if spoken != known.alarm.language:
            answers["alarm", "language"] = spoken
        written = _write(file, before, _checked(base, answers, file, person.language), yes, person)
    if written:
        _tell_next(file, old is not None, driven, person)


def _refuse_unwritable(file: Path) -> None:
    check_kind(file, "a configuration, TOML", ".toml")
    try:
        check_writable(file.resolve())
        if file.exists() and not os.access(file, os.R_OK):
            raise ConfigurationError("may not be read", str(file), "")
    except ConfigurationError as error:
        remedy = error.remedy if os.geteuid() == 0 else "Put sudo before the command, or name another file"
        raise ConfigurationError(error.what, str(file), remedy or "Check the path and its permissions") from None


def _known(text: str, file: Path) -> Config:
    """Returns the configuration in the file. Raises ConfigurationError where it is invalid."""
    try:
        return config_of(text, file)
    except ConfigurationError as error:
        for row in rows(error, cart_language()):
            click.echo(row, err=True)
        remedy = "Correct it in an editor (see: probewatch check), or start over with --fresh"
        raise ConfigurationError("is invalid and was not changed", str(file), remedy) from None


def _trying(language: str) -> Callable[[str, str], None]:
    """Returns a function that tests the device of a (URL, kind) and reports in the language."""

    def try_it(url: str, kind: str) -> None:
        click.echo(told("  trying {url} for {seconds} s …", language, url=url, seconds=f"{_TRIAL_S:g}"))
        _try(url, kind, language)

    return try_it


def _try(url: str, kind: str, language: str) -> None:
    """Tests a device and prints the result in the language. Raises ProbewatchError where it yields nothing."""
    clock = HostClock()
    open_source: Callable[[str, HostClock], TrackerSource | VideoSource]
    open_source = open_video if kind == "video" else open_tracker
    with open_source(url, clock) as source:
        measured = measure(source, _TRIAL_S, clock)
    for name, text in findings(measured)[:3]:
        click.echo(f"  {device_text(name, language)}: {device_text(text, language)}")
    for complaint in complaints(measured):
        click.echo(f"  ! {device_text(complaint, language)}")
    if measured.end is not None:
        raise measured.end
    if not measured.samples:
        raise DeviceLost(f"nothing came within {_TRIAL_S:g} s", url, "Check that the device is on and measuring")


def _connected(kind: str, taken: str = "", language: str = "en") -> Iterator[tuple[str, str]]:
    """Yields (URL, title) of each connected device of that kind that no other URL uses. Options that the driver
    requires must be typed.
    """
    for driver in (one for one in real_drivers(kind) if one.is_listed):
        note = "".join(told("; type it with ?{name}=…", language, name=name) for name in driver.required)
        for found in (one for target in driver.targets for one in CONNECTED[target](ROOT)):
            if found.path not in taken and found.node not in taken:
                yield f"{driver.scheme}:{found.path}", f"{_title(found, language)}{note}"


def _title(found: Found, language: str) -> str:
    title = device_text(found.title, language)
    return f"{title} ({device_text(found.obstacle, language)})" if found.obstacle else title


def _place(known: Config, signal: Role) -> int:
    """Returns the index of the [[output]] with that signal, or the index of a new one."""
    signals = [output.signal for output in known.output]
    return signals.index(signal) if signal in signals else len(signals)


def _lamps(known: Config, lamps: tuple[tuple[str, str], ...]) -> dict[Place, Value]:
    """Returns the answers for the lamps. Raises ConfigurationError for an invalid one."""
    answers: dict[Place, Value] = {}
    new = len(known.output)
    for signal, url in lamps:
        if signal not in _LAMPS:
            raise ConfigurationError(f"'{signal}' is not a lamp", "--lamp", f"Use one of {', '.join(_LAMPS)}")
        check_options(url, "output")
        place = _place(known, Role(signal))
        if place == len(known.output):
            place, new = new, new + 1
        answers["output", place, "url"] = url
        answers["output", place, "signal"] = signal
    return answers


def _calibration_place(known: Config, probe: str | None) -> CalibrationPlace:
    """Returns what the new file states about a calibration besides its name."""
    return known.calibration if probe is None else known.calibration.model_copy(update={"probe": probe})


def _simulated(*urls: object) -> tuple[str, ...]:
    """Returns which of the sources are, or may be, no real devices. urls: None for one that is not known yet."""
    return tuple(str(url) for url in urls if url is None or is_simulated(str(url)))


def _mistakes_of(file: Path, place: CalibrationPlace, simulated: Sequence[str], person: Respondent) -> list[str]:
    """Returns why the file cannot be the reference, one reason per line."""
    if misplaced := person.misplaced(file):
        return [f"{file}: {misplaced}"]
    return calibration_mistakes(place.model_copy(update={"file": file}), person.language, simulated)


def _refuse_calibration(place: CalibrationPlace, file: Path, simulated: Sequence[str], person: Respondent) -> None:
    """Raises ConfigurationError for a file that cannot be the reference, before any question or test."""
    mistakes = _mistakes_of(file, place, simulated, person)
    for mistake in mistakes:
        click.echo(mistake, err=True)
    if mistakes:
        raise ConfigurationError(
            "nothing was written", f"--calibration {file}", "Name another file, or give --no-calibration"
        )


def _calibration(
    given: str | None,
    without: bool,
    old: Config | None,
    place: CalibrationPlace,
    simulated: Sequence[str],
    person: Respondent,
) -> str | None:
    """Returns the path as the configuration names it, None for a cart without one. Raises ConfigurationError."""
    before = None if old is None else old.calibration.file
    if without:
        return None
    if given is None and old is not None and not person.is_there:
        given = str(before or "none")
    if given is not None:
        return None if given == "none" else str(whole_path(given))
    if person.is_there:
        which = "Calibration file (probewatch TOML or PLUS device set, XML), or none: scan it on this cart"
        click.echo(f"\n{person.tell(which)}")
    option = "--calibration FILE, or --no-calibration"
    while (said := person.ask(person.tell("calibration"), str(before or "none"), option)) != "none":
        file = whole_path(said)
        mistakes = _mistakes_of(file, place, simulated, person)
        if not mistakes:
            return str(file)
        for mistake in mistakes:
            click.echo(f"! {mistake}")
        click.echo(person.tell("Name another file, or none"))
    return None


def _profile(known: Config, person: Respondent) -> str:
    if not person.is_there:
        return known.limits.profile
    click.echo(f"\n{person.tell('How far the calibration may be off while the contact is closed')}")
    for name, meaning in _PROFILES.items():
        click.echo(f"  {name:<10}{person.tell(meaning)}")
    return str(click.prompt(person.tell("limits"), default=known.limits.profile, type=click.Choice(list(PROFILES))))


def _language(known: Config, person: Respondent) -> str:
    if not person.is_there:
        return known.alarm.language
    choice = click.Choice(["en", "de"])
    question = person.tell("language of the operator's texts")
    return str(click.prompt(f"\n{question}", default=known.alarm.language, type=choice))


def _checked(base: str, answers: Answers, file: Path, language: str) -> str:
    """Returns the new text. Raises ConfigurationError where it is not valid."""
    new = changed(base, answers, file)
    mistakes = mistakes_in(new, file, language)
    for mistake in mistakes:
        click.echo(mistake, err=True)
    if mistakes:
        raise ConfigurationError("nothing was written", str(file), "Change your answers, or start over with --fresh")
    for remark in (*calibration_remarks(new, file), *remarks_on_limits(config_of(new, file).limits, language)):
        click.secho(remark, err=True, fg="yellow")
    return new


def _write(file: Path, before: str | None, new: str, yes: bool, person: Respondent) -> bool:
    """Writes the file; returns whether anything had changed.

    Raises ConfigurationError where it cannot be written, click.Abort where the person declines.
    """
    if new == before:
        click.echo(person.tell("{file} is already up to date; nothing was written", file=file))
        return False
    changes = "{file}, what changes:" if before is not None else "{file} is new:"
    click.echo(f"\n{person.tell(changes, file=file)}")
    for line in _difference((before or "").splitlines(), new.splitlines()):
        click.echo(f"  {line}")
    if not yes and not person.agrees(person.tell("Write it?"), True, "--yes"):
        raise click.Abort
    if (configuration_text(file) if file.exists() else None) != before:
        raise ConfigurationError("was changed by another program meanwhile", str(file), "Run the command again")
    target = file.resolve()
    with writing(target) as stream:
        if target.exists():  # mode and owner stay, as a URL may hold a password
            was = target.stat()
            os.fchmod(stream.fileno(), was.st_mode & 0o777)
            os.fchown(stream.fileno(), was.st_uid, was.st_gid)
        stream.write(new.encode())
    click.echo(person.tell("written: {file}", file=file))
    return True


def _difference(before: list[str], new: list[str]) -> list[str]:
    """Returns the difference; for a new file its contents without comments."""
    if not before:
        return [line for line in new if line[:1] not in ("#", "")]
    lines = difflib.unified_diff(before, new, lineterm="", n=0)
    return [line for line in lines if not line.startswith(("--- ", "+++ ", "@@ "))]


def _tell_next(file: Path, was_configured: bool, contact: str, person: Respondent) -> None:
    if was_configured:
        sudo = "sudo " if is_of_the_unit(file) else ""
        restart = recognised(how_to_restart(file, is_running=True), person.language)
        click.echo(person.tell("to apply it: {how}", how=f"{sudo}{restart}"))
    else:
        named = "" if is_of_the_unit(file) else f" --config {file}"
        click.echo(
            person.tell(
                "a service that was waiting for it starts by itself; see: {command}",
                command=f"probewatch status{named}",
            )
        )
    test = "to test the contact, when it is not in use and no service is running: probewatch probe '{url}' --click"
    click.echo(person.tell(test, url=contact))
    config = config_of(configuration_text(file), file)
    if (number := kept_number(config)) is not None:
        click.echo(person.tell(KEPT, number=number))
    elif config.calibration.file is None:
        scan = "no calibration yet? scan it: probewatch recalibrate --live --solve all --config {file}"
        click.echo(person.tell(scan, file=file))
