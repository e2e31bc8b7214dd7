"""`probewatch log`: reads, filters, verifies and exports the alarm log."""

import csv
import io
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click

from probewatch.appliance.core.parameters import MEASURED, QUANTITIES, class_of
from probewatch.appliance.storage.alarm_chain import Entry, Event, Reading
from probewatch.appliance.supervision.languages import translated_text
from probewatch.appliance.types import Fault, State
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.atomic_file import check_kind, check_new, writing
from probewatch.drivers.printable import LONGEST_TEXT, printable
from probewatch.drivers.suggestion import did_you_mean, suggested
from probewatch.tools.german.translation import damage_text, recognised, told
from probewatch.tools.shared.alarm_history import settled_log
from probewatch.tools.shared.calendar_option import MOMENT
from probewatch.tools.shared.named_cart import cart_language, folder_argument, is_own_log
from probewatch.tools.shared.profile_text import logged_limits_text
from probewatch.tools.shared.spoken import say, say_change

_COLOURS = {"warning": "yellow", "halt": "red", "recalibration requested": "red", "device lost": "red"}
_COLOURS |= {"internal fault": "red", "monitoring": "green", "not verified": "cyan", "recalibrating": "cyan"}
_COLUMNS = ("number", "utc", "event", "state", "fault", "reason", "do", "who", "latched", "text", "digest")
_FORMULA = ("=", "+", "-", "@")
_SAID = ("state", "reason", "text")
"""Fields of an entry that hold texts of the service, in English."""
_SAID_IN: Mapping[str, str] = {Event.STATE: "reason", Event.PROPOSAL: "text", Event.UNDECIDED: "text"}
"""Field of such an entry that holds more than a word, and may have no translation."""
_LISTS = (Event.OVERLOADED, Event.OVERLOAD_ENDED, Event.OVERDUE, Event.WALL_CLOCK, Event.SLEPT)
"""Entries whose texts are translated part by part, but only where every part has a translation."""
_STATES = tuple(str(state.value) for state in State)


def _one_of(words: Iterable[str]) -> Callable[[click.Context, click.Parameter, str | None], str | None]:
    """Returns a callback that refuses every other word and suggests the most similar one."""
    known = [str(word) for word in words]

    def checked(_: click.Context, __: click.Parameter, value: str | None) -> str | None:
        if value is None or value in known:
            return value
        meant = did_you_mean(suggested(value, known)) or f"Use one of {', '.join(known)}."
        raise click.BadParameter(f"'{value}' is not known. {meant}")

    return checked


@click.command()
@folder_argument
@click.option("--since", type=MOMENT, help="entries from this time on, UTC")
@click.option("--until", type=MOMENT, help="entries before this time, UTC")
@click.option("--state", callback=_one_of(_STATES), help=f"changes to this state only: {', '.join(_STATES)}")
@click.option("--fault", callback=_one_of(Fault), help="entries that name this fault only, such as polarity")
@click.option("--event", callback=_one_of(Event), help=f"one kind only: {', '.join(Event)}")
@click.option("--last", type=click.IntRange(1), metavar="N", help="the last N that match")
@click.option("--verify", is_flag=True, help="only check that the hash chain is intact")
@click.option("--csv", "csv_path", type=click.Path(path_type=Path), help="write the entries to this new file")
def command(
    folder: Path,
    since: datetime | None,
    until: datetime | None,
    state: str | None,
    fault: str | None,
    event: str | None,
    last: int | None,
    verify: bool,
    csv_path: Path | None,
) -> None:
    """Read the alarm log in FOLDER, [alarm] folder of the configuration, and verify its hash chain.

    \b
    Examples:
      probewatch log --last 20
      probewatch log --state halt --since 2026-01-01 --csv halts.csv
      probewatch log --verify

    Exit code 0: the chain is whole. 65: it is not; what is wrong is said on stderr. 78: the folder cannot be read.
    """
    _refuse_contradictions(verify, (since, until), (last, state, fault, event, csv_path))
    check_kind(csv_path, "a table, CSV", ".csv", ".txt")
    check_new(csv_path)
    if csv_path is not None and csv_path.absolute().parent.resolve() == folder.resolve():
        raise ConfigurationError("lies in the folder of the log itself", str(csv_path), "Write it to another folder")
    reading, language = settled_log(folder), cart_language()
    if not verify:
        wanted = [
            entry for entry in reading.entries if _within(entry, since, until) and _named(entry, state, fault, event)
        ]
        shown = wanted if last is None else wanted[-last:]
        if not shown:
            click.echo(say("no match", language, number=len(reading.entries)), err=True)
        if csv_path is None:
            for entry in shown:
                click.echo(_line(entry, language))
        else:
            _export(csv_path, shown)
            click.echo(say("written", language, number=len(shown), file=csv_path))
    sys.exit(_verified(reading, language, is_own_log(folder)))


def _refuse_contradictions(
    verify: bool, span: tuple[datetime | None, datetime | None], chosen: tuple[object, ...]
) -> None:
    since, until = span
    if verify and any(one is not None for one in (*span, *chosen)):
        raise click.UsageError("--verify looks at the whole log and writes nothing: leave the other options out")
    if since is not None and until is not None and until < since:
        raise click.UsageError("--until is before --since")


def _within(entry: Entry, since: datetime | None, until: datetime | None) -> bool:
    at = datetime.fromisoformat(entry.utc)
    return (since is None or at >= since.replace(tzinfo=UTC)) and (until is None or at < until.replace(tzinfo=UTC))


def _named(entry: Entry, state: str | None, fault: str | None, event: str | None) -> bool:
    if state is not None and entry.event != Event.STATE:
        return False  # in other entries, such as the end of an overload, it is the state in which they were written
    wanted = ((state, entry.data.get("state")), (fault, entry.data.get("fault")), (event, entry.event))
    return all(asked is None or asked == has for asked, has in wanted)


def _line(entry: Entry, language: str) -> str:
    """Returns the entry in the language where all of it can be translated, else in English."""
    spoken = language if _is_whole(entry, language) else "en"
    said = _sentence(entry, spoken)
    if spoken != language and entry.event in _TOLD_WHOLE:
        with suppress(KeyError):
            spoken, said = language, _TOLD_WHOLE[entry.event](entry.data, language)
    elif spoken != language and (parts := _in_parts(entry.event, said, language)):
        spoken, said = language, parts
    text = f"{recognised(entry.event, spoken)}: {said}".removesuffix(": ")
    colour = _COLOURS.get(str(entry.data.get("state")))
    latched = "" if entry.latch is None else translated_text(entry.latch.state, spoken)
    latch = f" [{say('latched', spoken)}: {latched}]" if latched else ""
    return f"{entry.number:6}  {entry.utc}  {click.style(text, fg=colour)}{latch}"


def _sentence(entry: Entry, language: str) -> str:
    """Returns the text of the entry, with those of its words in the language that have a translation."""
    return _TEXTS.get(entry.event, _all_of_it)(_in(language, entry))


def _is_whole(entry: Entry, language: str) -> bool:
    if entry.event in (Event.REQUEST, Event.STOPPED):
        return True
    said = entry.data.get(_SAID_IN.get(entry.event, ""))
    return isinstance(said, str) and translated_text(said, language) != said


def _in_parts(event: str, text: str, language: str) -> str:
    """Returns the text of an entry that is a list, in the language; empty where a part has no translation."""
    if event == Event.ESTIMATE:
        reference, _, listed = text.partition(": ")
        parts = [part.split(" ", 1) for part in listed.split(", ")]
        names = [translated_text(part[0], language) for part in parts]
        if not reference.startswith("reference ") or any(len(part) < 2 for part in parts):
            return ""
        figures = ", ".join(
            " ".join([name, *(recognised(word, language) for word in part[1].split(" "))])
            for name, part in zip(names, parts, strict=True)
        )
        return f"{told('reference', language)} {reference.removeprefix('reference ')}: {figures}"
    if event not in _LISTS:
        return ""
    parts_said = [(part, recognised(part, language)) for part in text.split(", ")]
    return "" if any(part == said for part, said in parts_said) else ", ".join(said for _, said in parts_said)


def _in(language: str, entry: Entry) -> Mapping[str, Any]:
    """Returns the fields of the entry, with the service's texts in that language; a request has words of a person."""
    if entry.event == Event.REQUEST:
        seen = entry.data.get("acknowledged")
        said = {"acknowledged": say_change(seen, language)} if isinstance(seen, str) else {}
        number = entry.data.get("number")
        named = {"named": told("reference {number}", language, number=number)} if number else {}
        return {**entry.data, **said, **named, "by": say("by", language), "who": _who(entry.data, language)}
    said = {name: entry.data[name] for name in _SAID if isinstance(entry.data.get(name), str)}
    return {**entry.data, **{name: translated_text(text, language) for name, text in said.items()}}


def _who(data: Mapping[str, Any], language: str) -> str:
    """Returns who made the request, as the service recorded it: user and process."""
    user, comma, number = str(data.get("who")).rpartition(", process ")
    return told("{user}, process {number}", language, user=user, number=number) if comma else number


def _wanted(data: Mapping[str, Any]) -> str:
    seconds = data.get("seconds")
    named = data.get("file") or data.get("acknowledged") or data.get("named")
    named = named or (seconds and f"{str(seconds).removesuffix('.0')} s")
    return f": {named}" if named else ""


def _state(data: Mapping[str, Any]) -> str:
    return f"{data.get('state')}{_fault(data.get('fault'))} · {data.get('reason')}"


def _request(data: Mapping[str, Any]) -> str:
    return f"{data.get('do')} {data.get('by')} {data.get('who')}{_fault(data.get('reason'))}{_wanted(data)}"


def _estimate(data: Mapping[str, Any]) -> str:
    """Returns value ± sigma of each parameter; all fields where another version wrote the entry in another format."""
    checks = data.get("checks")
    if not isinstance(checks, Mapping) or not all(isinstance(row, list) and len(row) == 3 for row in checks.values()):
        return _all_of_it(data)
    units = {name: f" {QUANTITIES[class_of(name)].unit}" for name in MEASURED}
    rows = (f"{name} {value} ± {sigma}{units.get(name, '')}" for name, (value, sigma, _) in checks.items())
    return f"reference {data.get('reference')}: {', '.join(rows)}"


def _all_of_it(data: Mapping[str, Any]) -> str:
    """Returns name and value of each field that is not empty."""
    return ", ".join(f"{name.replace('_', ' ')} {_words(value)}" for name, value in data.items() if _says(value))


def _says(value: object) -> bool:
    return value is not None and value not in ("", [], {})


def _words(value: object) -> str:
    if isinstance(value, Mapping):
        return f"({_all_of_it(value)})"
    if isinstance(value, list):
        return ", ".join(map(_words, value))
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)


def _begun(data: Mapping[str, Any], language: str = "en") -> str:
    if not (found := data.get("found")):
        return told("of a new log", language)
    return f"because of {'; '.join(map(str, found))}" if language == "en" else _only_english(found)


def _reloaded(data: Mapping[str, Any], language: str = "en") -> str:
    if "file" not in data:
        return _all_of_it(data) if language == "en" else _only_english(data)
    noise = data.get("noise")
    by = noise.get("file") if isinstance(noise, Mapping) else None
    parts = [
        f"{data['file']}, SHA-256 {str(data.get('sha256'))[:12]}",
        told("threshold of a name by {file}", language, file=by) if by else "",
        logged_limits_text(data, language),
    ]
    return " · ".join(part for part in parts if part)


def _overdue(data: Mapping[str, Any]) -> str:
    return f"overdue: {data['overdue']}" if data.get("overdue") else "not overdue any more"


def _overloaded(data: Mapping[str, Any]) -> str:
    parts = [
        f"{100 * data['pressure']:.0f} % of the last second waiting for a processor" if data.get("pressure") else "",
        f"{100 * data['late']:.0f} % of its ticks late" if data.get("late") else "",
        f"{data['waiting_frames']} pictures waiting" if data.get("waiting_frames") else "",
    ]
    return ", ".join(part for part in parts if part) or _all_of_it(data)


def _overload_ended(data: Mapping[str, Any]) -> str:
    repeated = data.get("repeated")
    changes = [f"{change} {times} times" for change, times in repeated.items()] if isinstance(repeated, Mapping) else []
    if "for_s" not in data:
        return _all_of_it(data)
    parts = [
        f"after {data['for_s']} s",
        f"{data['device_losses']} losses of devices meanwhile" if data.get("device_losses") else "",
        f"without an entry each: {', '.join(changes)}" if changes else "",
    ]
    return ", ".join(part for part in parts if part)


def _stepped(data: Mapping[str, Any]) -> str:
    by_s = data.get("by_s")
    return f"stepped by {by_s:+g} s" if isinstance(by_s, int | float) else _all_of_it(data)


def _started(data: Mapping[str, Any], language: str = "en") -> str:
    """Returns a start entry as text; entries of earlier versions have fewer fields."""
    configuration = data.get("configuration") or {}
    sha = str(configuration["sha256"])[:12] if "sha256" in configuration else ""
    simulated, found = (", ".join(data.get(name) or ()) for name in ("simulated", "found"))
    parts = [
        f"probewatch {data['software']}" if "software" in data else "",
        told("configuration {sha}", language, sha=sha) if sha else "",
        logged_limits_text(data, language),
        _reference(data.get("reference"), language),
        told("SIMULATED: {urls}", language, urls=simulated) if simulated else "",
        (f"found {found}" if language == "en" else _only_english(found)) if found else "",
    ]
    return " · ".join(part for part in parts if part)


def _reference(reference: object, language: str) -> str:
    if not isinstance(reference, Mapping):
        return "" if reference is None else told("reference {number}", language, number=reference)
    number = told("reference {number}", language, number=reference.get("number"))
    named = f"{number}, {_recognised(reference.get('origin'), language)}, {reference.get('file')}"
    by = f" {told('by {who}', language, who=_who(reference, language))}" if reference.get("who") else ""
    change = f", {_recognised(reference['difference'], language)}" if reference.get("difference") else ""
    return f"{named}, SHA-256 {str(reference.get('sha256'))[:12]}{by}{change}"


def _recognised(text: object, language: str) -> str:
    """Returns a text of the service in the language. Raises KeyError where it has no translation."""
    said = recognised(str(text), language)
    return _only_english(text) if said == text and language != "en" else said


def _only_english(said: object) -> str:
    raise KeyError(said)


def _given_up(data: Mapping[str, Any], language: str) -> str:
    why = str(data.get("why"))
    if (said := recognised(why, language)) == why:
        raise KeyError(why)
    return said


_TOLD_WHOLE: Mapping[str, Callable[[Mapping[str, Any], str], str]] = {
    Event.STARTED: _started,
    Event.REFERENCE: lambda data, language: _reference(data.get("reference"), language),
    Event.CHAIN_BEGUN: _begun,
    Event.RELOADED: _reloaded,
    Event.GIVEN_UP: _given_up,
}
"""Functions that write entries of what was in force, and of a scan that was given up, in the language. Each raises
KeyError where a part of the entry has no translation.
"""
_TEXTS: Mapping[str, Callable[[Mapping[str, Any]], str]] = {
    Event.STATE: _state,
    Event.REQUEST: _request,
    Event.STARTED: _started,
    Event.REFERENCE: lambda data: _reference(data.get("reference"), "en"),
    Event.ESTIMATE: _estimate,
    Event.CHAIN_BEGUN: _begun,
    Event.RELOADED: _reloaded,
    Event.GIVEN_UP: lambda data: str(data.get("why")),
    Event.OVERDUE: _overdue,
    Event.OVERLOADED: _overloaded,
    Event.OVERLOAD_ENDED: _overload_ended,
    Event.WALL_CLOCK: _stepped,
    Event.SLEPT: lambda data: f"the computer slept for {data.get('for_s')} s",
    Event.PROPOSAL: lambda data: str(data.get("text")),
    Event.UNDECIDED: lambda data: str(data.get("text")),
}
"""Functions that write an entry as text; of an entry of any other kind, also of another version, all fields are shown.
"""


def _fault(fault: object) -> str:
    return "" if fault is None else f" ({fault})"


def _export(path: Path, entries: Iterable[Entry]) -> None:
    """Writes the entries to a new CSV file. Raises ConfigurationError."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, _COLUMNS)
    writer.writeheader()
    for entry in entries:
        data = {name: entry.data.get(name, "") for name in _COLUMNS}
        latched = "" if entry.latch is None else entry.latch.state
        own = {"number": entry.number, "utc": entry.utc, "event": entry.event, "digest": entry.digest}
        row = {**data, **own, "latched": latched, "text": _sentence(entry, "en")}
        writer.writerow({name: _cell(value) for name, value in row.items()})
    with writing(path) as stream:
        stream.write(text.getvalue().encode())


def _cell(value: object) -> str:
    """Returns the text of a CSV cell: empty for None, with a leading ' where a spreadsheet would read a formula."""
    text = "" if value is None else printable(str(value), LONGEST_TEXT)
    return f"'{text}" if text.startswith(_FORMULA) else text


def _verified(reading: Reading, language: str, own: bool) -> int:
    """Prints whether the chain is intact, defects on stderr; returns the exit code. own: it is this cart's log."""
    for damage in reading.damages:
        click.secho(damage_text(str(damage), language), err=True, fg="red" if damage.fault else "yellow")
    for entry in reading.entries[1:]:
        if entry.event == Event.CHAIN_BEGUN:
            found = "; ".join(damage_text(str(one), language) for one in entry.data.get("found", []))
            begins = told("entry {number} begins a new chain: {found}", language, number=entry.number, found=found)
            click.secho(begins, err=True, fg="yellow")
    if reading.broken:
        click.secho(say("broken" if own else "broken copy", language), err=True, fg="red")
        return 65
    click.echo(say("whole", language, number=len(reading.entries)), err=True)
    return 0
