"""`probewatch configure`: writes the configuration of a cart, without an editor."""

import difflib
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import click

from appliance.configuration.config import CalibrationPlace, Config, config_of, configuration_text
from appliance.configuration.toml_lines import Place
from appliance.limits import PROFILES, Profile
from appliance.service.control.starting import how_to_restart
from appliance.supervision.annunciator import Role
from drivers.clock.host_clock import HostClock
from drivers.descriptor import Option
from drivers.device_api import TrackerSource, VideoSource
from drivers.errors import ConfigurationError, DeviceLost, ProbewatchError
from drivers.files.atomic_file import check_kind, check_writable, writing
from drivers.io.inventory import CONNECTED, ROOT, Found
from drivers.registry import check_options, drivers, open_tracker, open_video, split_url
from tools.commands.check import calibration_mistakes, calibration_remarks, mistakes_in, rows
from tools.commands.probe import complaints, findings, measure
from tools.shared.configuration_text import Answers, Value, changed, template
from tools.shared.driver_text import examples, real_drivers
from tools.shared.interruption import stopped_saying
from tools.shared.limits_in_force import remarks as remarks_on_limits
from tools.shared.named_cart import file_argument
from tools.shared.unit_sight import is_of_the_unit, relative, unseen

_TRIAL_S = 2.0
"""For which a device is tried: forty pictures of a slow scanner, and a person does not wait long. Not varied."""
_WORDS = {
    "video": "the scanner's picture",
    "tracker": "the tracker",
    "output": "the output that drives the contact",
}
_PROFILES: dict[Profile, str] = {
    "coarse": "3 deg, 5 %, 4 mm, 60 ms: finds a wrong or bent marker body, cable, depth; the one to begin with",
    "clinical": "1.5 deg, 3 %, 2.5 mm, 30 ms, a point within 4 mm: optical tracker, phantom; open more often",
    "fine": "1 deg, 2 %, 1.5 mm, 20 ms, a point within 2.5 mm: this version never verifies it; for trials",
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


class _Person:
    """The person who answers. `is_there` is False without a terminal. `sees_less` is True where the service can read
    fewer files than the person.
    """

    def __init__(self, sees_less: bool = False) -> None:
        self.is_there = sys.stdin.isatty()
        self.sees_less = sees_less

    def ask(self, question: str, default: str, option: str) -> str:
        """Asks. Raises ConfigurationError without a terminal."""
        if not self.is_there:
            raise ConfigurationError("needs an answer, and there is no terminal", question, f"Give {option}")
        return str(click.prompt(question, default=default or None, show_default=bool(default))).strip()

    def misplaced(self, file: Path) -> str:
        """Returns why the service cannot read a file that the person names; empty where it can."""
        return unseen(file) if self.sees_less else ""

    def agrees(self, question: str, default: bool, option: str) -> bool:
        """Asks for confirmation. Raises ConfigurationError without a terminal."""
        if not self.is_there:
            raise ConfigurationError("needs an answer, and there is no terminal", question, f"Give {option}")
        return click.confirm(question, default=default)


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
    if without and calibration is not None:
        raise click.UsageError("--calibration names one; leave --no-calibration out")
    person = _Person(is_of_the_unit(file))
    _refuse_unwritable(file)
    before = configuration_text(file) if file.exists() else None
    base = template() if fresh or before is None else before
    known = _known(base, file)
    old = known if known.configured and base == before else None
    try_it = None if untried else _try
    place = _calibration_place(known, probe)
    if calibration is not None and calibration != "none":
        _refuse_calibration(place, _whole(calibration), person)
    at = _place(known, Role.CONTACT)
    seen = _Device("video", video, old.video.url if old else "", try_it)
    tracked = _Device("tracker", tracker, old.tracker.url if old else "", try_it)
    opened = _Device("output", contact, old.output[at].url if old else "", None)
    for device in (seen, tracked, opened):
        device.check_given()
    lit = _lamps(known, lamps)
    with stopped_saying("nothing was written"):
        answers: dict[Place, Value] = {("configured",): True}
        answers["video", "url"] = seen.url(person, lambda: _connected("video"))
        answers["tracker", "url"] = held = tracked.url(person, lambda: _connected("tracker"))
        answers["output", at, "url"] = told = opened.url(person, lambda: _connected("output", held))
        answers |= lit
        answers["calibration", "file"] = _calibration(calibration, without, old, place, person)
        if probe is not None:
            answers["calibration", "probe"] = probe
        limited = profile or _profile(known, person)
        if limited != known.limits.profile:
            answers["limits", "profile"] = limited
        spoken = language or _language(known, person)
        if spoken != known.alarm.language:
            answers["alarm", "language"] = spoken
        written = _write(file, before, _checked(base, answers, file), yes, person)
    if written:
        _tell_next(file, old is not None, told)


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
        for row in rows(error):
            click.echo(row, err=True)
        remedy = "Correct it in an editor (see: probewatch check), or start over with --fresh"
        raise ConfigurationError("is invalid and was not changed", str(file), remedy) from None


@dataclass(frozen=True, slots=True)
class _Device:
    """One of the devices. `given` is its URL from the option. `before` is the URL in the file; the service may hold
    that device, so it is not tested. `try_it` tests a (URL, kind) and raises ProbewatchError where it fails; None skips
    the test.
    """

    kind: str
    given: str | None
    before: str
    try_it: Callable[[str, str], None] | None

    @property
    def option(self) -> str:
        """The option that answers instead of the question."""
        return f"--{'contact' if self.kind == 'output' else self.kind} URL"

    def check_given(self) -> None:
        """Raises ConfigurationError for the URL of an option that is invalid: a slip is told before any device is
        tested.
        """
        if self.given is not None:
            self._check_words(self.given)

    def url(self, person: _Person, look: Callable[[], Iterator[tuple[str, str]]]) -> str:
        """Returns the URL, from the option or the answer. `look` lists (URL, title) of connected devices.

        Raises ProbewatchError for the URL of an option that is invalid or fails its test.
        """
        if self.given is not None:
            self._check(self.given)
            return self.given
        if self.before and not person.is_there:
            return self.before
        found = list(look()) if person.is_there else []
        if person.is_there:
            what = _WORDS[self.kind]
            click.echo(f"\n{what[0].upper()}{what[1:]}: a number, or a URL such as {examples(self.kind)}")
        for number, (url, title) in enumerate(found, 1):
            click.echo(f"  {number}  {url}  {title}")
        # The contact is not tried, so nobody comes to it by Enter alone.
        default = self.before or ("1" if found and self.kind != "output" else "")
        while True:
            said = person.ask(_WORDS[self.kind], default, self.option)
            if said.isdecimal() and not 0 < int(said) <= len(found):
                click.echo(f"! {said} is not in the list{_numbers(len(found))}; or give a URL")
                continue
            url = found[int(said) - 1][0] if said.isdecimal() else said
            if (taken := self._taken(url, person)) is not None:
                return taken

    def _taken(self, url: str, person: _Person) -> str | None:
        """Returns the URL; None where it must be asked for again, with the reason printed."""
        try:
            url = url if url == self.before else self.with_files(url, person)
            self._check(url)
        except ConfigurationError as error:
            click.echo(f"! {error}")
            return None
        except ProbewatchError as error:
            click.echo(f"! {error}")
            return url if person.agrees("Use it anyway?", False, "--untried") else None
        return url

    def with_files(self, url: str, person: _Person) -> str:
        """Adds the files that the driver needs and the URL does not name yet; an NDI tracker, for example, sees
        wireless markers only with the tool definition of their body. The second file is asked for only where there is a
        first. Raises ConfigurationError.
        """
        scheme, _, given = split_url(url, self.kind)
        for row in () if given else drivers()[scheme].options:
            if row.question:
                more = self._with_file(url, row, person)
                if more == url:
                    return url
                url = more
        return url

    def _with_file(self, url: str, row: Option, person: _Person) -> str:
        """Asks for the file until the driver can read it; the answer `without` returns the URL unchanged."""
        while (typed := person.ask(row.question, row.without, self.option)) != row.without:
            file = _whole(typed)
            if misplaced := person.misplaced(file):
                click.echo(f"! {file}: {misplaced}, or '{row.without}'")
                continue
            more = f"{url}{'&' if '?' in url else '?'}{row.name}={quote(str(file))}"
            try:
                check_options(more, self.kind)
            except ConfigurationError as error:
                click.echo(f"! {error}, or '{row.without}'")
            else:
                return more
        return url

    def _check(self, url: str) -> None:
        self._check_words(url)
        if self.try_it is not None and url != self.before:
            self.try_it(url, self.kind)

    def _check_words(self, url: str) -> None:
        check_options(url, self.kind)
        for why in relative(url):
            what, _, remedy = why.partition(". ")
            raise ConfigurationError(what, url, remedy)


def _numbers(most: int) -> str:
    return f", give 1 to {most}" if most else ", which is empty"


def _whole(typed: str) -> Path:
    """Returns the path as the configuration must name it; the shell does not expand what is typed here."""
    return Path(typed).expanduser().absolute()


def _try(url: str, kind: str) -> None:
    """Tests a device and prints the result. Raises ProbewatchError where it yields nothing."""
    clock = HostClock()
    open_source: Callable[[str, HostClock], TrackerSource | VideoSource]
    open_source = open_video if kind == "video" else open_tracker
    click.echo(f"  trying {url} for {_TRIAL_S:g} s …")
    with open_source(url, clock) as source:
        measured = measure(source, _TRIAL_S, clock)
    for name, text in findings(measured)[:3]:
        click.echo(f"  {name}: {text}")
    for complaint in complaints(measured):
        click.echo(f"  ! {complaint}")
    if measured.end is not None:
        raise measured.end
    if not measured.samples:
        raise DeviceLost(f"nothing came within {_TRIAL_S:g} s", url, "Check that the device is on and measuring")


def _connected(kind: str, taken: str = "") -> Iterator[tuple[str, str]]:
    """Returns (URL, title) of each connected device of that kind that no other URL uses. Options that the driver
    requires must be typed.
    """
    for driver in (one for one in real_drivers(kind) if one.is_listed):
        note = "".join(f"; type it with ?{name}=…" for name in driver.required)
        for found in (one for target in driver.targets for one in CONNECTED[target](ROOT)):
            if found.path not in taken and found.node not in taken:
                yield f"{driver.scheme}:{found.path}", f"{_title(found)}{note}"


def _title(found: Found) -> str:
    return f"{found.title} ({found.obstacle})" if found.obstacle else found.title


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


def _mistakes_of(file: Path, place: CalibrationPlace, person: _Person) -> list[str]:
    """Returns why the file cannot be the reference, one reason per line."""
    if misplaced := person.misplaced(file):
        return [f"{file}: {misplaced}"]
    return calibration_mistakes(place.model_copy(update={"file": file}))


def _refuse_calibration(place: CalibrationPlace, file: Path, person: _Person) -> None:
    """Raises ConfigurationError for a file that cannot be the reference, before any question or test."""
    mistakes = _mistakes_of(file, place, person)
    for mistake in mistakes:
        click.echo(mistake, err=True)
    if mistakes:
        raise ConfigurationError(
            "nothing was written", f"--calibration {file}", "Name another file, or give --no-calibration"
        )


def _calibration(
    given: str | None, without: bool, old: Config | None, place: CalibrationPlace, person: _Person
) -> str | None:
    """Returns the path as the configuration names it, None for a cart without one. Raises ConfigurationError."""
    before = None if old is None else old.calibration.file
    if without:
        return None
    if given is None and old is not None and not person.is_there:
        given = str(before or "none")
    if given is not None:
        return None if given == "none" else str(_whole(given))
    if person.is_there:
        click.echo("\nCalibration file (probewatch TOML or PLUS device set, XML), or none: scan it on this cart")
    option = "--calibration FILE, or --no-calibration"
    while (said := person.ask("calibration", str(before or "none"), option)) != "none":
        file = _whole(said)
        mistakes = _mistakes_of(file, place, person)
        if not mistakes:
            return str(file)
        for mistake in mistakes:
            click.echo(f"! {mistake}")
        click.echo("Name another file, or none")
    return None


def _profile(known: Config, person: _Person) -> str:
    if not person.is_there:
        return known.limits.profile
    click.echo("\nHow far the calibration may be off while the contact is closed")
    for name, meaning in _PROFILES.items():
        click.echo(f"  {name:<10}{meaning}")
    return str(click.prompt("limits", default=known.limits.profile, type=click.Choice(list(PROFILES))))


def _language(known: Config, person: _Person) -> str:
    if not person.is_there:
        return known.alarm.language
    choice = click.Choice(["en", "de"])
    return str(click.prompt("\nlanguage of the operator's texts", default=known.alarm.language, type=choice))


def _checked(base: str, answers: Answers, file: Path) -> str:
    """Returns the new text. Raises ConfigurationError where it is not valid."""
    new = changed(base, answers, file)
    mistakes = mistakes_in(new, file)
    for mistake in mistakes:
        click.echo(mistake, err=True)
    if mistakes:
        raise ConfigurationError("nothing was written", str(file), "Change your answers, or start over with --fresh")
    for remark in (*calibration_remarks(new, file), *remarks_on_limits(config_of(new, file).limits)):
        click.secho(remark, err=True, fg="yellow")
    return new


def _write(file: Path, before: str | None, new: str, yes: bool, person: _Person) -> bool:
    """Writes the file; returns whether anything had changed.

    Raises ConfigurationError where it cannot be written, click.Abort where the person declines.
    """
    if new == before:
        click.echo(f"{file} is already up to date; nothing was written")
        return False
    click.echo(f"\n{file}, what changes:" if before is not None else f"\n{file} is new:")
    for line in _difference((before or "").splitlines(), new.splitlines()):
        click.echo(f"  {line}")
    if not yes and not person.agrees("Write it?", True, "--yes"):
        raise click.Abort
    if (configuration_text(file) if file.exists() else None) != before:
        raise ConfigurationError("was changed by another program meanwhile", str(file), "Run the command again")
    target = file.resolve()
    with writing(target) as stream:
        if target.exists():  # who may read it, and whose it is, stays: a URL may hold a password
            was = target.stat()
            os.fchmod(stream.fileno(), was.st_mode & 0o777)
            os.fchown(stream.fileno(), was.st_uid, was.st_gid)
        stream.write(new.encode())
    click.echo(f"written: {file}")
    return True


def _difference(before: list[str], new: list[str]) -> list[str]:
    """Returns the difference; for a new file its contents without comments."""
    if not before:
        return [line for line in new if line[:1] not in ("#", "")]
    lines = difflib.unified_diff(before, new, lineterm="", n=0)
    return [line for line in lines if not line.startswith(("--- ", "+++ ", "@@ "))]


def _tell_next(file: Path, was_configured: bool, contact: str) -> None:
    if was_configured:
        sudo = "sudo " if is_of_the_unit(file) else ""
        click.echo(f"to apply it: {sudo}{how_to_restart(file, is_running=True)}")
    else:
        click.echo("a service that was waiting for it starts by itself; see: probewatch status")
    click.echo(
        f"to test the contact, when it is not in use and no service is running: probewatch probe '{contact}' --click"
    )
    config = config_of(configuration_text(file), file)
    if config.calibration.file is None:
        click.echo(f"no calibration yet? scan it: probewatch recalibrate --live --solve all --config {file}")
