"""Leads the live recalibration in a terminal: drives the session of the page, with lines instead of buttons."""

import select
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import inf
from typing import Any

import click
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from probewatch.appliance.service.control.server import ControlRefused
from probewatch.drivers.errors import ProbewatchError
from probewatch.tools.german.translation import confirmed, recognised, told
from probewatch.tools.recalibration.held_service import Asked
from probewatch.tools.recalibration.paperwork import Begin, Signature
from probewatch.tools.recalibration.phase import Phase
from probewatch.tools.recalibration.session import ScanSession
from probewatch.tools.shared.crosswire_review import comparison_table
from probewatch.tools.shared.lateness import lateness
from probewatch.tools.shared.verification import with_motions

_EVERY_S = 0.25
"""Seconds between two pictures, as of `probewatch status --watch`, and the longest delay of a typed line."""
_MOST_REFUSALS = 4
"""Refusals shown at once; what to mend first comes first."""

_LINE_EVERY_S = 10.0
"""Seconds between two lines into a pipe or a file, where nothing is redrawn: progress shows; more often fills a log."""

_COMPLETE = "The scan is complete: press Enter, or scan on for smaller sigmas."
_GERMAN_ANSWERS = {"annehmen": "accept", "prüfen": "check", "weiter": "scan on", "ablehnen": "reject"}
_SKIP = ("skip", "auslassen")
_BEFORE = (Phase.LATENCY, Phase.SCANNING, Phase.REVIEW, Phase.CHECKING)
"""Phases before a calibration is taken."""

Fields = Mapping[str, Any]


class _Lines:
    """Prints the progress into a pipe or a file, in which nothing is redrawn; silent on a terminal."""

    def __init__(self, console: Console) -> None:
        self._silent, self._said, self._at_s = console.is_terminal, "", -inf

    def tell(self, text: str) -> None:
        now_s = time.monotonic()
        if self._silent or text == self._said or now_s - self._at_s < _LINE_EVERY_S:
            return
        self._said, self._at_s = text, now_s
        click.echo(text)


def progress_text(fields: Fields, language: str = "en") -> str:
    """Returns how far a scan is, in one line."""
    scan = fields["scan"]
    if fields["trouble"] or scan is None:
        return recognised(str(fields["trouble"] or "waiting for the first picture"), language)
    first = [f"{one['reason']}: {one['what']}" for one in _said(scan["refusals"][:1], language)]
    return f"{_counted(scan, language)} · {(first or [told('the scan is complete', language)])[0]}"


def _counted(scan: Fields, language: str) -> str:
    counted = "{views} views in {pictures} pictures"
    return told(counted, language, views=len(scan["views"]), pictures=scan["pictures"])


def _said(refusals: Sequence[Fields], language: str) -> list[Fields]:
    """Returns what stands against a calibration, in the language."""
    return [{name: recognised(str(text), language) for name, text in one.items()} for one in refusals]


def run(session: ScanSession, begin: Begin, signature: Signature | None, language: str = "en") -> None:
    """Leads the whole procedure. signature: that of the second person, where that person need not be asked; then nobody
    is asked anything, the scan ends as soon as nothing stands against it, and a difference is not accepted.

    Raises ProbewatchError where it ends without a new calibration, click.Abort for Ctrl-C; a scan is then rejected.
    """
    session.begin(begin)
    try:
        while session.phase in _BEFORE:
            _latency(session, language)
            _scan(session, signature is not None, language)
            _check(session, language)
            _review(session, signature, language)
        _prove(session, language)
    except BaseException:
        if session.phase in (*_BEFORE, Phase.PROVING):
            session.reject("stopped in the terminal")
        raise


def words(question: str, language: str = "en") -> str:
    """Returns what a person types; asks again where that is nothing but spaces, which would be refused only later.

    Raises click.Abort.
    """
    return str(click.prompt(question, value_proc=partial(_not_blank, language)))


def _not_blank(language: str, text: str) -> str:
    if not text.strip():
        raise click.UsageError(told("type something other than spaces", language))
    return text.strip()


def picture(fields: Fields, language: str = "en") -> RenderableType:
    """Returns what the page shows of a scan, in lines."""
    scan = fields["scan"]
    lines: list[RenderableType] = []
    if fields["trouble"]:
        lines.append(Text(f"! {recognised(str(fields['trouble']), language)}", style="bold red"))
    if scan is None:
        return Group(*lines, Text(told("waiting for the first picture", language)))
    look, coverage = scan["look"], scan["coverage"]
    found = "…" if look is None else _found(look, language)
    lines.append(Text(f"{found}   ·   {_counted(scan, language)}"))
    lines.append(Text(_zeta(scan["result"], language), style="bold"))
    if scan["sound"]:
        lines.append(Text(recognised(scan["sound"], language)))
    if coverage is not None:
        motion = recognised(coverage["next"] or "all is covered", language)
        lines += [Text(told("next: {motion}", language, motion=motion), style="bold cyan"), _bins(coverage, language)]
    lines += [
        Text(f"{one['reason']}: {one['what']}. {one['remedy']}", style="yellow")
        for one in _said(scan["refusals"][:_MOST_REFUSALS], language)
    ]
    return Group(*lines)


def _scan(session: ScanSession, alone: bool, language: str) -> None:
    if session.phase is not Phase.SCANNING:
        return
    console = Console(file=sys.stdout, highlight=False)
    if not alone:
        console.print(told("Scan the crossing; Enter when it is complete, Ctrl-C to give up.", language))
    lines, done = _Lines(console), Text(told(_COMPLETE, language), style="bold green")
    with Live(console=console, refresh_per_second=1 / _EVERY_S, transient=True) as live:
        while session.phase is Phase.SCANNING:
            session.attendance.touch()
            fields = session.fields()
            scan = fields["scan"]
            complete = scan is not None and scan["result"] is not None and not scan["refusals"]
            lines.tell(progress_text(fields, language))
            shown = picture(fields, language)
            live.update(Group(shown, done) if complete else shown)
            if (alone and complete) or (not alone and _line_within(_EVERY_S) is not None):
                _refused_aloud(live.console, session.finish, language)
            elif alone:
                select.select([], [], [], _EVERY_S)


def _latency(session: ScanSession, language: str) -> None:
    """Shows the measurement over the bottom of the tank, until the person takes the result or leaves it to the scan."""
    if session.phase is not Phase.LATENCY:
        return
    console = Console(file=sys.stdout, highlight=False)
    how = "Point the probe at the tank's bottom; move it straight up and down, 2 s to and fro, turning sharply."
    console.print(told(how, language))
    console.print(told("Enter takes what was measured; 'skip' leaves it to the scan; Ctrl-C gives up.", language))
    with Live(console=console, refresh_per_second=1 / _EVERY_S, transient=True) as live:
        while session.phase is Phase.LATENCY:
            session.attendance.touch()
            fields = session.fields()
            trouble = recognised(str(fields["trouble"]), language)
            live.update(Text(trouble or latency_text(fields["latency"], language)))
            said = _line_within(_EVERY_S)
            if said is not None:
                _refused_aloud(live.console, partial(session.take_latency, said not in _SKIP), language)


def latency_text(latency: Fields | None, language: str = "en") -> str:
    """Returns how far the measurement of the latency is."""
    if latency is None:
        return told("waiting for the first picture", language)
    counted = "bottom seen in {seen} of {pictures} pictures"
    seen = told(counted, language, seen=latency["seen"], pictures=latency["pictures"])
    if latency["latency_ms"] is None:
        again = [recognised("a minute did not show it, started again", language)] if latency["begun_anew"] else []
        return " · ".join([seen, told("not known yet", language), *again])
    late = lateness(latency["latency_ms"], latency["sigma_ms"], language)
    enough = [recognised("enough is collected: take it", language)] if latency["full"] else []
    return " · ".join([seen, late, *enough])


def check_text(check: Fields | None, language: str = "en") -> str:
    """Returns the result of the check at the other point."""
    if check is None:
        return told("no check at another point yet", language)
    why = recognised(str(check["why"]), language)
    if check["error_mm"] is None:
        return why
    known = "{views} views put it within {error} mm RMS from where it is"
    about = "{views} views put it within {error} mm RMS about one place"
    how = known if check["known"] else about
    put = told(how, language, views=check["views"], error=f"{check['error_mm']:.2f}")
    return f"{put} · {why or told('passed', language)}"


def _check(session: ScanSession, language: str) -> None:
    """Shows the check at a crossing elsewhere, until the person ends it."""
    if session.phase is not Phase.CHECKING:
        return
    console = Console(file=sys.stdout, highlight=False)
    how = "Move the tank by 2 cm and more; pass through the crossing again, tilted otherwise each time; Enter."
    console.print(told(how, language))
    with Live(console=console, refresh_per_second=1 / _EVERY_S, transient=True) as live:
        while session.phase is Phase.CHECKING:
            session.attendance.touch()
            fields = session.fields()
            trouble = recognised(str(fields["trouble"]), language)
            live.update(Text(trouble or check_text(fields["scan"] and fields["scan"]["check"], language)))
            if _line_within(_EVERY_S) is not None:
                _refused_aloud(live.console, session.end_check, language)


def _refused_aloud(console: Console, request: Callable[[], None], language: str) -> None:
    """Makes a request and prints its refusal, of whatever kind, so that none costs the scan."""
    try:
        request()
    except ProbewatchError as error:
        console.print(str(_recognised_error(error, language)))


def _recognised_error(error: ProbewatchError, language: str) -> ProbewatchError:
    return ProbewatchError(*(recognised(text, language) for text in (error.what, error.where, error.remedy)))


def _review(session: ScanSession, signature: Signature | None, language: str) -> None:
    """Shows the review until the scan is accepted, rejected or resumed."""
    console = Console(file=sys.stdout, highlight=False)
    while session.phase is Phase.REVIEW:
        session.attendance.touch()
        fields = session.fields()
        console.print(picture(fields, language), _views(fields["scan"]))
        if fields["scan"]["compared"]:
            console.print(comparison_table(fields["scan"]["compared"], language), crop=False)
        console.print(
            f"{recognised('check at another point', language)}: {check_text(fields['scan']['check'], language)}"
        )
        if signature is not None:
            session.accept(signature)
            continue
        question = "accept, check (at another point), scan on, reject, or numbers of views to strike out or take back"
        said = click.prompt(told(question, language)).strip()
        _refused_aloud(console, partial(_answer, session, said, fields, language), language)


def _answer(session: ScanSession, said: str, fields: Fields, language: str = "en") -> None:
    said = _GERMAN_ANSWERS.get(said, said)
    if said == "accept":
        _accept(session, fields["scan"]["check"], language)
    elif said == "check":
        session.check()
    elif said == "scan on":
        session.resume()
    elif said == "reject":
        session.reject("in the terminal")
    else:
        views = fields["scan"]["views"]
        words = said.replace(",", " ").split()
        for word in words:
            if not (word.isdecimal() and 0 < int(word) <= len(views)):
                what = told("'{word}' is no answer", language, word=word)
                raise ControlRefused(what, told("review", language), _accepted(len(views), language))
        for word in dict.fromkeys(words):
            session.strike(int(word) - 1, not views[int(word) - 1]["struck"])


def _accepted(views: int, language: str) -> str:
    """Returns what can be answered in the review."""
    choices = "Type accept, check, scan on or reject"
    struck = "Type accept, check, scan on or reject, or numbers of views from 1 to {views}, such as '2 5'"
    return told(struck, language, views=views) if views else told(choices, language)


def _accept(session: ScanSession, check: Fields | None, language: str) -> None:
    session.require_complete()
    name, role = _second_person(session, language), words(told("role", language), language)
    unchecked = ""
    if check is None or check["why"]:
        unchecked = words(told("why is there no check at another point", language), language)
    comment = click.prompt(told("comment", language), default="", show_default=False)
    try:
        session.accept(Signature(name, role, comment, unchecked=unchecked))
    except Asked as question:
        text = recognised(question.text, language)
        click.echo(told("against the calibration in force: {text}", language, text=text))
        if confirmed(told("Accept that? Nothing of it is verified then.", language), language):
            session.accept(Signature(name, role, comment, question.text, unchecked))


def _second_person(session: ScanSession, language: str) -> str:
    """Returns the name of the second person. It is asked for first, and again at once where it is the one who scanned,
    so that nothing is typed twice.
    """
    while True:
        name = words(told("name of the second person", language), language)
        try:
            session.require_second(name)
        except ProbewatchError as error:
            click.echo(recognised(error.what, language))
        else:
            return name


def _prove(session: ScanSession, language: str) -> None:
    console = Console(file=sys.stdout, highlight=False)
    if session.phase is Phase.PROVING:
        move = "Now move the probe over tissue, to and fro, tilting and turning it: the service proves it."
        console.print(told(move, language))
    lines = _Lines(console)
    with Live(console=console, refresh_per_second=1 / _EVERY_S, transient=True) as live:
        while session.phase is Phase.PROVING:
            fields = session.fields()
            said = with_motions(str(fields["trouble"] or fields["message"]), language)
            lines.tell(said)
            live.update(Text(said))
            select.select([], [], [], _EVERY_S)
    fields = session.fields()
    message = recognised(fields["message"], language)
    if session.phase is not Phase.DONE:
        where, remedy = recognised("recalibration", language), told("The calibration before is in force", language)
        raise ControlRefused(message, where, remedy)
    click.echo(f"{message}\n{told('written: {file}', language, file=fields['file'])}")


def _line_within(seconds: float) -> str | None:
    """Returns what was typed, None where nothing was. Raises click.Abort at the end of the input."""
    ready, _, _ = select.select([sys.stdin], [], [], seconds)
    if not ready:
        return None
    line = sys.stdin.readline()
    if not line:
        raise click.Abort
    return line.strip()


def _found(look: Fields, language: str) -> str:
    if look["centre_px"] is None:
        return recognised(str(look["why"]), language)
    return told("crossing found, {share} %", language, share=f"{100 * look['confidence']:.0f}")


def _zeta(result: Fields | None, language: str) -> str:
    if result is None:
        return "ζ …"
    now, before = f"ζ {result['zeta_mm']:.2f} ± {result['zeta_sigma_mm']:.2f} mm", result["zeta_before_mm"]
    return now if before is None else f"{now} ({told('before: {mm}', language, mm=f'{before:.2f}')})"


def _bins(coverage: Fields, language: str) -> Table:
    table = Table.grid(padding=(0, 1))
    names = (told("lean to and fro", language), told("twist", language), told("lean sideways", language))
    for name, counts in zip(names, coverage["bins"], strict=True):
        table.add_row(name, *(Text(f"{count:3}", style="green" if count > 1 else "dim") for count in counts))
    return table


def _views(scan: Fields) -> Text:
    text = Text()
    for number, view in enumerate(scan["views"], 1):
        off = "–" if view["off_mm"] is None else f"{view['off_mm']:.2f} mm"
        text.append(f"{number}: {off}   ", style="" if view["used"] else "red strike")
    return text
