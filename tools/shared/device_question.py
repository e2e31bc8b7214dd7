"""Asks which device is to be used: its URL, chosen from a list of connected devices or typed, and the files that it
needs.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import click

from probewatch.drivers.descriptor import Option
from probewatch.drivers.errors import ConfigurationError, ProbewatchError
from probewatch.drivers.registry import check_options, drivers, split_url
from probewatch.tools.german.translation import confirmed, mistake_text, recognised, tell_refused, told
from probewatch.tools.shared.driver_text import examples
from probewatch.tools.shared.unit_sight import relative, unseen

_WORDS = {
    "video": "the scanner's picture",
    "tracker": "the tracker",
    "output": "the output that drives the contact",
}


class Respondent:
    """Represents the person who answers. `is_there` is False without a terminal. `sees_less` is True where the service
    can read fewer files than the person. `language`: that of the questions.
    """

    def __init__(self, sees_less: bool = False, language: str = "en") -> None:
        self.is_there = sys.stdin.isatty()
        self.sees_less, self.language = sees_less, language

    def tell(self, text: str, **fields: object) -> str:
        """Returns the text in the language of the person."""
        return told(text, self.language, **fields)

    def ask(self, question: str, default: str, option: str) -> str:
        """Asks the question and returns the answer. Raises ConfigurationError without a terminal."""
        if not self.is_there:
            raise self._nobody(question, option)
        return str(click.prompt(question, default=default or None, show_default=bool(default))).strip()

    def misplaced(self, file: Path) -> str:
        """Returns why the service cannot read a file that the person names; empty where it can."""
        return mistake_text(unseen(file), self.language) if self.sees_less else ""

    def agrees(self, question: str, default: bool, option: str) -> bool:
        """Asks for confirmation, and returns whether it was given. Raises ConfigurationError without a terminal."""
        if not self.is_there:
            raise self._nobody(question, option)
        return confirmed(question, self.language, default)

    def _nobody(self, question: str, option: str) -> ConfigurationError:
        missing = self.tell("needs an answer, and there is no terminal")
        return ConfigurationError(missing, question, self.tell("Give {option}", option=option))


@dataclass(frozen=True, slots=True)
class DeviceQuestion:
    """Represents the question for one device. `given` is its URL from the option. `before` is the URL in the file; the
    service may hold that device, so it is not tested. `try_it` tests a (URL, kind) and raises ProbewatchError where it
    fails; None skips the test.
    """

    kind: str
    given: str | None
    before: str
    try_it: Callable[[str, str], None] | None

    @property
    def option(self) -> str:
        """Returns the option that makes the question unnecessary."""
        return f"--{'contact' if self.kind == 'output' else self.kind} URL"

    def check_given(self) -> None:
        """Raises ConfigurationError for an option whose URL is invalid, so that a slip is reported before any device is
        tested.
        """
        if self.given is not None:
            self._check_words(self.given)

    def url(self, person: Respondent, look: Callable[[], Iterator[tuple[str, str]]]) -> str:
        """Returns the URL, from the option or the answer. `look` lists (URL, title) of connected devices.

        Raises ProbewatchError for an option whose URL is invalid or fails its test.
        """
        if self.given is not None:
            self._check(self.given)
            return self.given
        if self.before and not person.is_there:
            return self.before
        found = list(look()) if person.is_there else []
        if person.is_there:
            which, such = person.tell(_WORDS[self.kind]), examples(self.kind)
            which = f"{which[0].upper()}{which[1:]}"
            click.echo(f"\n{person.tell('{which}: a number, or a URL such as {examples}', which=which, examples=such)}")
        for number, (url, title) in enumerate(found, 1):
            click.echo(f"  {number}  {url}  {title}")
        # The contact is not tested, so Enter alone must not choose it.
        default = self.before or ("1" if found and self.kind != "output" else "")
        while True:
            said = person.ask(person.tell(_WORDS[self.kind]), default, self.option)
            if said.isdecimal() and not 0 < int(said) <= len(found):
                unlisted = "! {said} is not in the list, give 1 to {most}; or give a URL"
                unlisted = unlisted if found else "! {said} is not in the list, which is empty; or give a URL"
                click.echo(person.tell(unlisted, said=said, most=len(found)))
                continue
            url = found[int(said) - 1][0] if said.isdecimal() else said
            if (taken := self._taken(url, person)) is not None:
                return taken

    def _taken(self, url: str, person: Respondent) -> str | None:
        """Returns the URL; None where it must be asked for again, with the reason printed."""
        try:
            url = url if url == self.before else self.with_files(url, person)
            self._check(url)
        except ProbewatchError as error:
            tell_refused(error, person.language)
            click.echo(f"! {error}")
            if isinstance(error, ConfigurationError):
                return None
            return url if person.agrees(person.tell("Use it anyway?"), False, "--untried") else None
        return url

    def with_files(self, url: str, person: Respondent) -> str:
        """Returns the URL with the files that the driver needs and the URL does not name yet; an NDI tracker, for
        example, sees wireless markers only with the tool definition of their body. The second file is asked for only
        where there is a first. Raises ConfigurationError.
        """
        scheme, _, given = split_url(url, self.kind)
        for row in () if given else drivers()[scheme].options:
            if row.question:
                more = self._with_file(url, row, person)
                if more == url:
                    return url
                url = more
        return url

    def _with_file(self, url: str, row: Option, person: Respondent) -> str:
        """Returns the URL with a file, which is asked for until the driver can read it; the answer `row.without`
        returns the URL unchanged.
        """
        question, or_without = recognised(row.question, person.language), "! {error}, or '{without}'"
        while (typed := person.ask(question, row.without, self.option)) != row.without:
            file = whole_path(typed)
            if misplaced := person.misplaced(file):
                click.echo(person.tell(or_without, error=f"{file}: {misplaced}", without=row.without))
                continue
            more = f"{url}{'&' if '?' in url else '?'}{row.name}={quote(str(file))}"
            try:
                check_options(more, self.kind)
            except ConfigurationError as error:
                tell_refused(error, person.language)
                click.echo(person.tell(or_without, error=error, without=row.without))
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


def whole_path(typed: str) -> Path:
    """Returns the path as the configuration must name it; the shell does not expand what is typed here."""
    return Path(typed).expanduser().absolute()
