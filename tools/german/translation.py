"""Translates what commands print to the language of the cart. German comes from `texts`, `setup`, `questions` and
`reports` for commands, from `appliance.supervision.languages` for what the service states, and from
tools/page/files/german.js for what a scan reports.

JSON, records, options and the names of faults stay English: programs rely on them. So does an error that is not wholly
in `errors` or `calibrations`.
"""

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import click

from probewatch.appliance.configuration.mistakes import Mistakes
from probewatch.appliance.supervision.languages import GERMAN, Texts
from probewatch.drivers.errors import ProbewatchError
from probewatch.tools.german.calibrations import GERMAN_OF_CALIBRATIONS
from probewatch.tools.german.configuration import refusal_text
from probewatch.tools.german.devices import GERMAN_OF_MENDING
from probewatch.tools.german.errors import GERMAN_OF_ERRORS
from probewatch.tools.german.questions import GERMAN_OF_QUESTIONS
from probewatch.tools.german.reports import GERMAN_OF_REPORTS
from probewatch.tools.german.setup import GERMAN_OF_SETUP
from probewatch.tools.german.texts import GERMAN_OF_TOOLS

_ALL = {**GERMAN, **GERMAN_OF_TOOLS, **GERMAN_OF_SETUP, **GERMAN_OF_QUESTIONS, **GERMAN_OF_REPORTS}
_PAGE = Path(__file__).parents[1] / "page" / "files" / "german.js"
_YES, _NO = ("j", "ja", "y", "yes"), ("n", "nein", "no")


def told(text: str, language: str, /, **fields: object) -> str:
    """Returns a text of the tables, filled in: German unless the language is `en`. Raises KeyError for any other."""
    german = _ALL[text]
    return (text if language == "en" else german).format(**fields)


def recognised(text: str, language: str) -> str:
    """Returns a text that a part of the program made, in the language; all of it in English where it cannot be
    translated as a whole.
    """
    if language == "en":
        return text
    said = _texts().translated(text)
    return said if said != text else _of_page(text)


@dataclass(frozen=True, slots=True)
class Speech:
    """Represents one language, for code that words many texts in it."""

    language: str

    def tell(self, text: str, /, **fields: object) -> str:
        """Returns the text as `told` does."""
        return told(text, self.language, **fields)

    def recognise(self, text: str) -> str:
        """Returns the text as `recognised` does."""
        return recognised(text, self.language)


@contextmanager
def refusing_in(language: str) -> Iterator[None]:
    """Translates the errors that the block raises to the language, as far as they are known in it."""
    try:
        yield
    except ProbewatchError as error:
        error.what, error.where, error.remedy = (
            recognised(text, language) for text in (error.what, error.where, error.remedy)
        )
        raise


def tell_refused(error: ProbewatchError, language: str) -> None:
    """Translates the error to the language, whole or not at all."""
    what = _mistakes_text(error, language) if isinstance(error, Mistakes) else _error_text(error.what, language)
    said = [what, _error_text(error.remedy, language)]
    if language != "en" and None not in said:
        error.what, error.remedy = (text or "" for text in said)
        if error.where.startswith("reference "):  # any other place is a name
            error.where = recognised(error.where, language)


def lost_text(text: str, language: str) -> str:
    """Returns why a device is lost, "where: what. what to do", in the language; the whole in English where it cannot be
    translated whole.
    """
    for colon in re.finditer(": ", text):
        parts = [_error_text(part, language) for part in text[colon.end() :].split(". ", 1)]
        if language != "en" and None not in parts:
            return text[: colon.end()] + ". ".join(filter(None, parts))
    return text


def damage_text(text: str, language: str) -> str:
    """Returns what is wrong with the alarm log, "file line 3: what", in the language; the whole in English where it
    cannot be translated whole.
    """
    where, _, what = text.partition(": ")
    said = recognised(what, language)
    if language == "en" or said == what:
        return text
    file, line, number = where.rpartition(" line ")
    return f"{file} {told('line {number}', language, number=number)}: {said}" if line else f"{where}: {said}"


def _error_text(text: str, language: str) -> str | None:
    """Returns one of the two texts of an error in the language; None where it has no translation."""
    if not text or language == "en":
        return None if text else text
    said = _errors().translated(text)
    return refusal_text(text) if said == text else said


def _mistakes_text(error: Mistakes, language: str) -> str | None:
    """Returns all mistakes in one line in the language; None where one of them has no translation."""
    if language == "en" or any(refusal_text(what) is None for _, what in error.each):
        return None
    of_line, of_rest = (_ALL[text] for text in ("line {number}", "and {more} more"))
    return error.in_one_line(of_line, of_rest, lambda what: mistake_text(what, language))


def mistake_text(what: str, language: str) -> str:
    """Returns a mistake of a configuration in the language; the whole in English where it has no translation."""
    return what if language == "en" else refusal_text(what) or what


@cache
def _errors() -> Texts:
    return Texts({**_ALL, **GERMAN_OF_ERRORS, **GERMAN_OF_CALIBRATIONS, **GERMAN_OF_MENDING})


def _of_page(text: str) -> str:
    """Returns the German that the page has for the text; the text itself where it has none."""
    table, patterns = _page()
    if text in table:
        return table[text]
    found = ((pattern.fullmatch(text), german) for pattern, german in patterns)
    return next((match.expand(german) for match, german in found if match is not None), text)


@cache
def _texts() -> Texts:
    """Returns the tables, compiled when the first text is recognised: a cart whose language is English needs none."""
    return Texts(_ALL)


@cache
def _page() -> tuple[dict[str, str], list[tuple[re.Pattern[str], str]]]:
    """Returns the page's table, and the regular expressions that it recognises, with the words to expand."""
    source = _PAGE.read_text(encoding="utf-8")
    whole = re.search(r"const GERMAN = (\{.*?\});", source, re.DOTALL)
    assert whole is not None
    rows = re.findall(r'^  \[/\^(.*)\$/, (".*")\],$', source, re.MULTILINE)
    return json.loads(whole[1]), [
        (re.compile(pattern), re.sub(r"\$(\d)", r"\\g<\1>", json.loads(german))) for pattern, german in rows
    ]


def confirmed(question: str, language: str, default: bool = False) -> bool:
    """Asks a person, who answers y or n, or j and n as in German. default: the answer of Enter alone. Raises
    click.Abort at Ctrl-C and at the end of the input.
    """
    yes, complaint = ("y", "Answer y or n") if language == "en" else ("j", "Bitte j oder n eingeben")
    choice = f"{yes.upper()}/n" if default else f"{yes}/N"
    while True:
        answer = str(click.prompt(f"{question} [{choice}]", default="", show_default=False))
        said = answer.strip().lower()
        if not said:
            return default
        if said in (*_YES, *_NO):
            return said in _YES
        click.echo(complaint)
