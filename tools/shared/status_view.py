"""Draws the status of a service as a picture for the terminal, in the language of the service.

Colours mean the same everywhere: green verified, cyan not verified, yellow warning, red alarm or fault. A line is whole
in one language: what cannot be translated whole stays English.
"""

from collections import defaultdict, deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.panel import Panel
from rich.style import Style
from rich.table import Table
from rich.text import Text

from probewatch.appliance.service.control.status_fields import STATUS, Field
from probewatch.appliance.supervision.languages import translated, translated_text
from probewatch.appliance.types import Fault, State
from probewatch.drivers.device_api import BUMPED
from probewatch.tools.german.devices import device_text
from probewatch.tools.german.translation import lost_text, recognised, told
from probewatch.tools.shared.gesture_drawings import drawn
from probewatch.tools.shared.plain_text import shown
from probewatch.tools.shared.point_text import WORDS as POINT_WORDS
from probewatch.tools.shared.point_text import point_text
from probewatch.tools.shared.profile_text import WORDS as PROFILE_WORDS
from probewatch.tools.shared.profile_text import is_usual, profile_text

Status = Mapping[str, Any]
_Check = Mapping[str, Any]

WORDS = {
    "since": "verified {age:.1f} s ago",
    "never": "not verified now",
    "closed": "contact closed (safe)",
    "open": "contact OPEN",
    "acknowledged": "acknowledged",
    "unacknowledged": "not acknowledged",
    "rates": "video {video:.1f}/s · tracker {tracker:.1f}/s · dropped: {frames} frames, {poses} poses",
    "paused": "sound paused",
    "silenced": "sound acknowledged",
    "off": "sound off",
    "carried": "present motion does not show it; within its age, as no detector saw a change: {names}",
    "reference": "reference {number} · {origin} · {name} · {sha} · since {since} UTC",
    "configuration": "configuration",
    "recalibration": "recalibration",
    "went back": "went back to {number}",
    "file": "file",
    "file of": "file of reference {number}",
    "simulated": "SIMULATED",
    "recovering": "within its limit again; good once it has stayed so for some seconds: {names}",
    **POINT_WORDS,
    **PROFILE_WORDS,
}
"""Every word of the picture that the service does not send itself."""

_CLEARS_BUMP = "probewatch ack --bump"
_LOOKED_AT = "once the position sensor was looked at: probewatch ack --bump"

_BAR_CELLS = 9
"""Columns of a bar, and of a trend. More requires a wider terminal before there are two columns of checks."""
_NUMBER_CELLS = 7
"""Columns of a ratio and its mark, such as 12.34 ✓."""
_TREND_EVERY_S = 1.0
"""Seconds of the service for each cell of a trend: nine cells show what led to an alarm. Shorter shows noise."""
_STEPS = "▁▂▃▄▅▆▇█"
_COLOURS = {"OK": "green", "FAULT": "red", "NOT_VERIFIED": "cyan"}
_MARKS = {"OK": "✓", "FAULT": "✗", "NOT_VERIFIED": "?"}
_CARRIED = "~"
"""Mark of what earlier motion showed, is not too old yet, and is not shown by the present motion."""
_SOUNDS = {"paused": "paused", "acknowledged": "silenced", "off": "off"}


class StatusView:
    """Draws one status after the other, and keeps the ratios of the last seconds as trends."""

    def __init__(self) -> None:
        self._trends: defaultdict[str, deque[float]] = defaultdict(lambda: deque(maxlen=_BAR_CELLS))
        self._noted_s = -_TREND_EVERY_S

    def picture(self, status: Status) -> Group:
        """Returns state, rates and every check: name, share of its limit as a bar or its trend, ratio, verdict."""
        checks = [*status["checks"], *status["devices"]]
        self._note(status["counters"].get("uptime_s", 0.0), checks)
        table = _Checks(checks, {name: tuple(trend) for name, trend in self._trends.items()}, _language(status))
        lines: list[RenderableType] = [_state(status), _rates(status), table, *_limits(status), *_point(status)]
        return Group(*lines, *_carried(status), *_proposal(status), *_remarks(status), *_origin(status))

    def _note(self, uptime_s: float, checks: list[_Check]) -> None:
        if uptime_s - self._noted_s < _TREND_EVERY_S:
            return
        self._noted_s = uptime_s
        for check in checks:
            if check["ratio"] is not None:
                self._trends[check["name"]].append(check["ratio"])


def one_line(status: Status) -> str:
    """Returns the status for a file or a pipe."""
    say = _words(status)
    said = _advice(status), _prompt(status)
    facts = _age(status, say), _contact(status, say), *(line.plain for line in (*_limits(status), *_point(status)))
    parts = [f"{_title(status)}: {status['text']}", *said, *facts]
    return " · ".join(filter(None, parts))


class _Checks:
    """Draws the table, in two columns where the terminal is wide enough; the end of each bar is the limit."""

    def __init__(self, checks: list[_Check], trends: Mapping[str, tuple[float, ...]], language: str) -> None:
        self._checks, self._trends = checks, trends
        self._names = [shown(translated_text(check["name"], language)) for check in checks]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        widest = max(map(len, self._names), default=0)
        columns = 2 if options.max_width >= 2 * (widest + _BAR_CELLS + _NUMBER_CELLS + 4) - 2 else 1
        cells = min(_BAR_CELLS, options.max_width - widest - _NUMBER_CELLS - 3)
        table = Table.grid(padding=(0, 1))
        rows = -(-len(self._checks) // columns)
        for first in range(rows):
            table.add_row(*(cell for at in range(first, len(self._checks), rows) for cell in self._cells(at, cells)))
        yield table

    def _cells(self, at: int, cells: int) -> tuple[Text, Text, Text]:
        check = self._checks[at]
        verdict, ratio = _now(check), check["ratio"]
        colour = _COLOURS[verdict]
        trend = self._trends.get(check["name"], ())[-max(1, cells) :]
        bar = _trend(trend, colour, cells) if len(trend) > 1 else _bar(0.0 if ratio is None else ratio, colour, cells)
        number = "  –  " if ratio is None else f"{min(ratio, 99.99):5.2f}"
        told_by = _CARRIED if check.get("carried") else _MARKS[verdict]
        mark = Text(f"{number} {told_by}", style=colour, no_wrap=True)
        return Text(self._names[at], no_wrap=True, overflow="ellipsis"), bar, mark


def _now(check: _Check) -> str:
    """Returns the verdict as of now: what was shown too long ago, or before a disturbance, is not verified any more."""
    earlier = check["verdict"] == "OK" and check.get("shown") in ("carried", "missing")
    return "NOT_VERIFIED" if earlier else str(check["verdict"])


def is_recovering(check: Mapping[str, Any]) -> bool:
    """Returns whether the processor was overloaded too recently to be good yet; other parts are good at once."""
    return bool(check["fault"] == Fault.OVERLOADED and check["verdict"] == "FAULT" and check["ratio"] < 1.0)


def _bar(ratio: float, colour: str, cells: int) -> Text:
    """Returns a bar; an empty text where there is no room for it."""
    if cells < 1:
        return Text()
    filled = round(cells * min(ratio, 1.0))
    return Text.assemble(("━" * filled, colour), ("─" * (cells - filled), "dim"), "┃", no_wrap=True)


def _trend(ratios: tuple[float, ...], colour: str, cells: int) -> Text:
    """Returns the last seconds, oldest first; a full cell is the limit."""
    if cells < 1:
        return Text()
    steps = "".join(_STEPS[min(int(ratio * len(_STEPS)), len(_STEPS) - 1)] for ratio in ratios)
    return Text.assemble((steps.rjust(cells), colour), "┃", no_wrap=True)


def _language(status: Status) -> str:
    return str(status.get("language", "en"))


def _words(status: Status) -> dict[str, str]:
    return {name: shown(translated(text, _language(status))) for name, text in WORDS.items()}


def _title(status: Status) -> str:
    return shown(translated_text(status["state"], _language(status))).upper()


def _state(status: Status) -> Panel:
    lamp, say = status["lamp"], _words(status)
    facts = " · ".join([_age(status, say), _contact(status, say), *_latch(status, say)])
    said = Text(_advice(status)), _drawn(status)
    lines = [Text(shown(status["text"]), style=f"bold {lamp}"), *said, Text(shown(facts), style=lamp)]
    return Panel(
        Text("\n").join(line for line in lines if line), title=_title(status), title_align="left", border_style=lamp
    )


def _advice(status: Status) -> str:
    """Returns what to do; in the calm states, and where it is not clear what is wrong, the reason of the state instead,
    if that adds to the text.
    """
    recalibrates = status["state"] == State.RECALIBRATING.value and not _prompt(status)
    if status["fault"] not in (None, Fault.UNDECIDED) or recalibrates:
        return shown(status["remedy"])
    reason = recognised(status["reason"], _language(status))
    return "" if reason in status["text"] or reason == status["remedy"] else shown(reason)


def _prompt(status: Status) -> str:
    """Returns the motion that shows what is missing, or what must be done before motion can show anything."""
    gesture = status.get("gesture", ())
    if status["state"] == State.RECALIBRATING.value and not all(one in status["remedy"] for one in gesture):
        return ""  # During the scan `_advice` returns the remedy.
    asked = gesture or (status["state"] == State.NOT_VERIFIED.value and status.get("reference_waits"))
    return shown(status["remedy"]) if status["fault"] in (None, Fault.UNDECIDED) and asked else ""


def _drawn(status: Status) -> Text:
    """Returns the prompt; each motion is a link to its moving drawing, where the terminal has links."""
    files = {shown(text): drawn(text, _language(status)) for text in status.get("gesture", ())}
    clauses = []
    for clause in _prompt(status).split("; "):
        file = files.get(clause)
        clauses.append(Text(clause, Style(bold=True, link=None if file is None else file.as_uri())))
    return Text("; ").join(clauses)


def _age(status: Status, say: Mapping[str, str]) -> str:
    age_s = status["verification_age_s"]
    return say["never"] if age_s is None else say["since"].format(age=age_s)


def _contact(status: Status, say: Mapping[str, str]) -> str:
    return say["closed" if status["energised"] else "open"]


def _latch(status: Status, say: Mapping[str, str]) -> list[str]:
    if status["latched"] is None:
        return []
    return [say["acknowledged" if status["acknowledged"] else "unacknowledged"]]


def _rates(status: Status) -> Text:
    fps, counters, audio, say = status["fps"], status["counters"], status["audio"], _words(status)
    line = say["rates"].format(**fps, frames=counters["dropped_frames"], poses=counters["dropped_poses"])
    left = "" if audio["left_s"] is None else f" {audio['left_s']:.0f} s"
    sound = "" if audio["mode"] == "on" else f" · {say[_SOUNDS[audio['mode']]]}{left}"
    return Text(shown(f"{line}{sound}"))


def _carried(status: Status) -> list[Text]:
    """Returns what is not shown by the present motion, with its age and the age that it may have."""
    own = [check for check in status["checks"] if check.get("carried")]
    ages = (
        f"{translated_text(one['name'], _language(status))} {one['shown_age_s']:.0f}/{one['max_age_s']:.0f} s"
        for one in own
    )
    line = _words(status)["carried"].format(names=", ".join(ages))
    return [Text(shown(f"{_CARRIED} {line}"), style="cyan")] if own else []


def _limits(status: Status) -> list[Text]:
    """Returns the profile of the limits, where they are not the shipped ones."""
    limits = status.get("limits")
    return [] if is_usual(limits) else [Text(shown(profile_text(limits, _language(status))))]


def _point(status: Status) -> list[Text]:
    """Returns the error of a point in the colour of what it allows; nothing where it is neither known nor asked for."""
    point, limit_mm = status.get("point"), status.get("point_limit_mm")
    if point is None and limit_mm is None:
        return []
    said = point_text(point, limit_mm, _language(status))
    beyond = limit_mm is not None and (point is None or point["worst_mm"][1] > limit_mm)
    return [Text(shown(said), style="cyan" if beyond else "")]


def _proposal(status: Status) -> list[Text]:
    """Returns what the calibration has become, and what follows from that; a clause on each line."""
    proposal = status.get("proposal")
    return [] if proposal is None else [Text(shown(f"→ {clause}")) for clause in proposal["text"].split("; ")]


def _remarks(status: Status) -> list[Text]:
    """Returns what needs no alarm, what is lost, a recalibration that was given up, and how the estimator ended."""
    language = _language(status)
    lost = [f"{device}: {lost_text(what, language)}" for device, what in status["lost"].items()]
    ended = [] if status["estimator"] is None else [f"estimator: {status['estimator']}"]
    given_up = (status.get("recalibration") or {}).get("ended")
    back = ", ".join(translated_text(one["name"], _language(status)) for one in status["devices"] if is_recovering(one))
    said = [
        *([_words(status)["recovering"].format(names=back)] if back else []),
        *status["notices"],
        *([f"recalibration: {given_up}"] if given_up else []),
        *(device_text(recognised(remark, language), language) for remark in status["remarks"]),
        *([told(_LOOKED_AT, language)] if _waits_for_a_look(status) else []),
        *lost,
        *ended,
    ]
    return [Text(shown(f"! {line}"), style="yellow") for line in said]


def _waits_for_a_look(status: Status) -> bool:
    """Returns whether the tracker was bumped, and the remedy does not state what ends that, as while another device is
    lost.
    """
    bumped = any(BUMPED in remark for remark in status["remarks"])
    return bumped and _CLEARS_BUMP not in status["remedy"]


def _origin(status: Status) -> list[Text]:
    """Returns to which reference the verdicts refer, what keeps it from being verified, what is not in force, and what
    else the rows of the status have a line for.
    """
    reference = status.get("reference")
    said = [] if reference is None else [_reference(reference, _words(status))]
    said += _lines(STATUS, status, _language(status))
    return [Text(shown(line), style="yellow" if line.startswith("!") else "dim") for line in said]


def _lines(fields: Sequence[Field], holder: Status, language: str) -> Iterator[str]:
    """Yields the lines of the fields. holder: the status, or the object that has these fields as its parts."""
    for field in fields:
        value = holder.get(field.name)
        if value is not None:
            yield from _lines(field.parts, value, language) if field.parts else ()
            if field.line is not None:
                said = recognised(value, language) if isinstance(value, str) else value
                known = language == "de" and not (isinstance(value, str) and said == value)
                yield ((known and field.line.de) or field.line.en).format(said)


def _reference(reference: Mapping[str, Any], say: Mapping[str, str]) -> str:
    origin = _origin_words(str(reference["origin"]), say)
    origin += f", {say['simulated']}" if reference["simulated"] else ""
    name, since = str(reference["file"]).rpartition("/")[2], str(reference["utc"])[:16].replace("T", " ")
    return say["reference"].format(
        number=reference["number"], origin=origin, name=name, sha=reference["sha256"][:12], since=since
    )


def _origin_words(origin: str, say: Mapping[str, str]) -> str:
    """Returns the origin in the language; some of them name another reference."""
    for named in ("went back", "file of"):
        before = WORDS[named].removesuffix("{number}")
        if origin.startswith(before):
            return say[named].format(number=origin.removeprefix(before))
    return say.get(origin, origin)
