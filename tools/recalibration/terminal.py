"""The live recalibration in a terminal: the session of the page, with lines instead of buttons."""

import select
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from math import inf
from typing import Any

import click
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from appliance.service.control.server import ControlRefused
from drivers.errors import ProbewatchError
from tools.recalibration.held_service import Asked
from tools.recalibration.paperwork import Begin, Signature
from tools.recalibration.session import Phase, ScanSession
from tools.shared.crosswire_review import comparison_table

_EVERY_S = 0.25
"""Between two pictures, as of `probewatch status --watch`; how late a line is heard."""
_MOST_REFUSALS = 4
"""Shown at once: what to mend first stands in front."""

_LINE_EVERY_S = 10.0
"""Between two lines into a pipe or a file, where nothing is redrawn: seen to go on; more often fills a log."""

_COMPLETE = "The scan is complete: press Enter, or scan on for smaller sigmas."
_BEFORE = (Phase.LATENCY, Phase.SCANNING, Phase.REVIEW, Phase.CHECKING)
"""Phases before something is taken."""

Fields = Mapping[str, Any]


class _Lines:
    """How far it is, for a pipe or a file, in which nothing is redrawn; silent on a terminal."""

    def __init__(self, console: Console) -> None:
        self._silent, self._said, self._at_s = console.is_terminal, "", -inf

    def tell(self, text: str) -> None:
        now_s = time.monotonic()
        if self._silent or text == self._said or now_s - self._at_s < _LINE_EVERY_S:
            return
        self._said, self._at_s = text, now_s
        click.echo(text)


def progress_text(fields: Fields) -> str:
    """How far a scan is, in one line."""
    scan = fields["scan"]
    if fields["trouble"] or scan is None:
        return str(fields["trouble"] or "waiting for the first picture")
    missing = [f"{one['reason']}: {one['what']}" for one in scan["refusals"][:1]] or ["the scan is complete"]
    return f"{len(scan['views'])} views in {scan['pictures']} pictures · {missing[0]}"


def run(session: ScanSession, begin: Begin, signature: Signature | None) -> None:
    """The whole procedure. signature: of the second person, where he need not be asked; then nobody is asked anything,
    the scan ends as soon as nothing stands against it, and a difference is not accepted.

    Raises ProbewatchError where it ends without a new calibration, click.Abort for Ctrl-C; a scan is then rejected.
    """
    session.begin(begin)
    try:
        while session.phase in _BEFORE:
            _latency(session)
            _scan(session, alone=signature is not None)
            _check(session)
            _review(session, signature)
        _prove(session)
    except BaseException:
        if session.phase in (*_BEFORE, Phase.PROVING):
            session.reject("stopped in the terminal")
        raise


def words(question: str) -> str:
    """What a person types; asked for again where that is nothing but spaces: what is refused later was typed in vain.

    Raises click.Abort.
    """
    return str(click.prompt(question, value_proc=_not_blank))


def _not_blank(text: str) -> str:
    if not text.strip():
        raise click.UsageError("type something other than spaces")
    return text.strip()


def picture(fields: Fields) -> RenderableType:
    """What the page shows of a scan, in lines."""
    scan = fields["scan"]
    lines: list[RenderableType] = []
    if fields["trouble"]:
        lines.append(Text(f"! {fields['trouble']}", style="bold red"))
    if scan is None:
        return Group(*lines, Text("waiting for the first picture"))
    look, coverage = scan["look"], scan["coverage"]
    found = "…" if look is None else _found(look)
    lines.append(Text(f"{found}   ·   {len(scan['views'])} views in {scan['pictures']} pictures"))
    lines.append(Text(_zeta(scan["result"]), style="bold"))
    if scan["sound"]:
        lines.append(Text(scan["sound"]))
    if coverage is not None:
        lines += [Text(f"next: {coverage['next'] or 'all is covered'}", style="bold cyan"), _bins(coverage)]
    lines += [
        Text(f"{one['reason']}: {one['what']}. {one['remedy']}", style="yellow")
        for one in scan["refusals"][:_MOST_REFUSALS]
    ]
    return Group(*lines)


def _scan(session: ScanSession, alone: bool) -> None:
    if session.phase is not Phase.SCANNING:
        return
    console = Console(file=sys.stdout, highlight=False)
    if not alone:
        console.print("Scan the crossing; Enter when it is complete, Ctrl-C to give up.")
    lines = _Lines(console)
    with Live(console=console, refresh_per_second=1 / _EVERY_S, transient=True) as live:
        while session.phase is Phase.SCANNING:
            session.touch()
            fields = session.fields()
            scan = fields["scan"]
            complete = scan is not None and scan["result"] is not None and not scan["refusals"]
            lines.tell(progress_text(fields))
            live.update(Group(picture(fields), Text(_COMPLETE, style="bold green")) if complete else picture(fields))
            if (alone and complete) or (not alone and _line_within(_EVERY_S) is not None):
                _refused_aloud(live.console, session.finish)
            elif alone:
                select.select([], [], [], _EVERY_S)


def _latency(session: ScanSession) -> None:
    """Over the bottom of the tank, until the person takes what was measured, or leaves it to the scan."""
    if session.phase is not Phase.LATENCY:
        return
    console = Console(file=sys.stdout, highlight=False)
    console.print(
        "Point the probe at the tank's bottom; move it straight up and down, 2 s to and fro, turning sharply."
    )
    console.print("Enter takes what was measured; 'skip' leaves it to the scan; Ctrl-C gives up.")
    with Live(console=console, refresh_per_second=1 / _EVERY_S, transient=True) as live:
        while session.phase is Phase.LATENCY:
            session.touch()
            fields = session.fields()
            live.update(Text(fields["trouble"] or latency_text(fields["latency"])))
            said = _line_within(_EVERY_S)
            if said is not None:
                _refused_aloud(live.console, partial(session.take_latency, said != "skip"))


def latency_text(latency: Fields | None) -> str:
    """How far the measurement of the latency is."""
    if latency is None:
        return "waiting for the first picture"
    seen = f"bottom seen in {latency['seen']} of {latency['pictures']} pictures"
    if latency["latency_ms"] is None:
        again = " · a minute did not show it, started again" if latency["begun_anew"] else ""
        return f"{seen} · not known yet{again}"
    enough = " · enough is collected: take it" if latency["full"] else ""
    return f"{seen} · tracker late by {latency['latency_ms']:.1f} ± {latency['sigma_ms']:.1f} ms{enough}"


def check_text(check: Fields | None) -> str:
    """How the other point lies."""
    if check is None:
        return "no check at another point yet"
    if check["error_mm"] is None:
        return str(check["why"])
    how = "from where it is" if check["known"] else "about one place"
    told = f"{check['views']} views put it within {check['error_mm']:.2f} mm RMS {how}"
    return f"{told} · {check['why'] or 'passed'}"


def _check(session: ScanSession) -> None:
    """Check at a crossing elsewhere, until the person ends it."""
    if session.phase is not Phase.CHECKING:
        return
    console = Console(file=sys.stdout, highlight=False)
    console.print("Move the tank by 2 cm and more; pass through the crossing again, tilted otherwise each time; Enter.")
    with Live(console=console, refresh_per_second=1 / _EVERY_S, transient=True) as live:
        while session.phase is Phase.CHECKING:
            session.touch()
            fields = session.fields()
            live.update(Text(fields["trouble"] or check_text(fields["scan"] and fields["scan"]["check"])))
            if _line_within(_EVERY_S) is not None:
                _refused_aloud(live.console, session.end_check)


def _refused_aloud(console: Console, request: Callable[[], None]) -> None:
    """What is refused, of whatever kind, costs nobody his scan."""
    try:
        request()
    except ProbewatchError as error:
        console.print(str(error))


def _review(session: ScanSession, signature: Signature | None) -> None:
    """Review it until it is accepted, rejected or scanned on."""
    console = Console(file=sys.stdout, highlight=False)
    while session.phase is Phase.REVIEW:
        session.touch()
        fields = session.fields()
        console.print(picture(fields), _views(fields["scan"]))
        if fields["scan"]["compared"]:
            console.print(comparison_table(fields["scan"]["compared"]), crop=False)
        console.print(f"check at another point: {check_text(fields['scan']['check'])}")
        if signature is not None:
            session.accept(signature)
            continue
        said = click.prompt(
            "accept, check (at another point), scan on, reject, or numbers of views to strike out or take back"
        ).strip()
        _refused_aloud(console, partial(_answer, session, said, fields))


def _answer(session: ScanSession, said: str, fields: Fields) -> None:
    if said == "accept":
        _accept(session, fields["scan"]["check"])
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
                raise ControlRefused(f"'{word}' is no answer", "review", _accepted(len(views)))
        for word in dict.fromkeys(words):
            session.strike(int(word) - 1, not views[int(word) - 1]["struck"])


def _accepted(views: int) -> str:
    """What can be answered in the review."""
    struck = f", or numbers of views from 1 to {views}, such as '2 5'" if views else ""
    return f"Type accept, check, scan on or reject{struck}"


def _accept(session: ScanSession, check: Fields | None) -> None:
    session.require_complete()
    name, role = _second_person(session), words("role")
    unchecked = ""
    if check is None or check["why"]:
        unchecked = words("why is there no check at another point")
    comment = click.prompt("comment", default="", show_default=False)
    try:
        session.accept(Signature(name, role, comment, unchecked=unchecked))
    except Asked as question:
        click.echo(f"against the calibration in force: {question.text}")
        if click.confirm("Accept that? Nothing of it is verified then."):
            session.accept(Signature(name, role, comment, question.text, unchecked))


def _second_person(session: ScanSession) -> str:
    """Asked for first, and again at once where it is the one who scanned: nothing is typed twice."""
    while True:
        name = words("name of the second person")
        try:
            session.require_second(name)
        except ProbewatchError as error:
            click.echo(error.what)
        else:
            return name


def _prove(session: ScanSession) -> None:
    console = Console(file=sys.stdout, highlight=False)
    if session.phase is Phase.PROVING:
        console.print("Now move the probe over tissue, to and fro, tilting and turning it: the service proves it.")
    lines = _Lines(console)
    with Live(console=console, refresh_per_second=1 / _EVERY_S, transient=True) as live:
        while session.phase is Phase.PROVING:
            fields = session.fields()
            lines.tell(str(fields["trouble"] or fields["message"]))
            live.update(Text(fields["trouble"] or fields["message"]))
            select.select([], [], [], _EVERY_S)
    fields = session.fields()
    if session.phase is not Phase.DONE:
        raise ControlRefused(fields["message"], "recalibration", "The calibration before is in force")
    click.echo(f"{fields['message']}\nwritten: {fields['file']}")


def _line_within(seconds: float) -> str | None:
    """What was typed, None where nothing was. Raises click.Abort at the end of the input."""
    ready, _, _ = select.select([sys.stdin], [], [], seconds)
    if not ready:
        return None
    line = sys.stdin.readline()
    if not line:
        raise click.Abort
    return line.strip()


def _found(look: Fields) -> str:
    return str(look["why"]) if look["centre_px"] is None else f"crossing found, {100 * look['confidence']:.0f} %"


def _zeta(result: Fields | None) -> str:
    if result is None:
        return "ζ …"
    before = result["zeta_before_mm"]
    return f"ζ {result['zeta_mm']:.2f} ± {result['zeta_sigma_mm']:.2f} mm" + (
        "" if before is None else f" (before: {before:.2f})"
    )


def _bins(coverage: Fields) -> Table:
    table = Table.grid(padding=(0, 1))
    for name, counts in zip(("lean to and fro", "twist", "lean sideways"), coverage["bins"], strict=True):
        table.add_row(name, *(Text(f"{count:3}", style="green" if count > 1 else "dim") for count in counts))
    return table


def _views(scan: Fields) -> Text:
    text = Text()
    for number, view in enumerate(scan["views"], 1):
        off = "–" if view["off_mm"] is None else f"{view['off_mm']:.2f} mm"
        text.append(f"{number}: {off}   ", style="" if view["used"] else "red strike")
    return text
