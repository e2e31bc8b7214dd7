"""The pages of a German cart are German whole: no text on them is that of the English page, or half of it."""

import html
import json
import re
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from probewatch.appliance.storage.alarm_chain import CUT_OFF, Damage, read_log
from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.appliance.storage.reference_dates import Dates
from probewatch.appliance.storage.reference_store import History, read_history, sha256_of, write_history
from probewatch.appliance.supervision.languages import GERMAN
from probewatch.appliance.types import Fault
from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.german.translation import damage_text, lost_text, recognised
from probewatch.tools.report.period import PERIODS, Summary, period, summary
from probewatch.tools.report.period_page import write_period_page
from probewatch.tools.report.trend_page import write_trend_page
from probewatch.tools.shared.trend_table import HEADINGS, row_of, trends, unit_of
from tests.tools.german.test_translation import GERMAN_OF_TOOLS
from tests.tools.report.test_period import MONTH, NOW, logged, state
from tests.tools.report.test_period_page import body, cart, made, reference

__all__ = ["cart"]
OURS = {fault.value for fault in Fault} | {"Name", "SHA-256", "probewatch", "UTC", "min", "Version"}
"""Names, units and words that are the same in both languages."""
GIVEN = ("mycart", "anna", r"[\w-]+\.(?:toml|jsonl?)", "probewatch log --verify")
"""Names of a cart, a person, a file and a command, which are the same in both languages."""
ENGLISH = {word for text in (*GERMAN, *GERMAN_OF_TOOLS) for word in re.findall(r"\b[a-z]{3,}\b", text)}
ENGLISH -= {word for text in (*GERMAN.values(), *GERMAN_OF_TOOLS.values()) for word in re.findall(r"\w+", text)}
"""Words that only the English texts of the tables have."""


def texts_on(page: Path) -> list[str]:
    """Every text that a reader sees or hears, in the order of the page."""
    whole = re.sub(r"<style>.*?</style>", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    found = [one or other for one, other in re.findall(r'aria-label="([^"]*)"|>([^<]+)', whole)]
    return [html.unescape(text).strip() for text in found if text.strip()]


def english_on(english: Path, german: Path) -> Iterator[str]:
    """Returns the English left on the German page: texts that are the same on both, except names, and English words."""
    both = list(zip(texts_on(english), texts_on(german), strict=True))
    for said, told in both:
        named = re.sub("|".join(sorted({*OURS, *GIVEN}, key=len, reverse=True)), "", told)
        if said == told and re.search("[A-Za-z]{3,}", named):
            yield told
        yield from (f"{word}: {told}" for word in re.findall(r"\b[a-z]{3,}\b", named) if word in ENGLISH)


def written(folder: Path, found: Summary, dates: Dates | None, faults: list[str]) -> Iterator[Path]:
    for language, chosen in (("en", "Chosen so"), ("de", "So gewählt")):
        write_period_page(folder / f"{language}.html", "mycart", found, dates, faults, chosen, language)
        yield folder / f"{language}.html"


def full_of_it(folder: Path, kind: str, made: datetime) -> Summary:
    """A period in which all came that a page can tell."""
    entries = [
        *MONTH[:6],
        *((31.1, "request", {"do": do, "who": "anna"}) for do in ("lamp-test", "clear-bump", "reload", "acknowledge")),
        *((31.1 + n / 100, "state", state("warning", "scale", "calibration verified")) for n in range(2)),
        (31.3, "state", state("halt", "polarity", "not shown yet: polarity")),
        (31.5, "state", state("halt", None, "calibration verified")),
        (31.6, "state", state("not verified")),
        *MONTH[7:8],
        *((32.5 + n, "estimate", {"reference": 2, "checks": {"scale-axial": [n / 9, 0.1, 5.0]}}) for n in range(30)),
        (64.0, "overloaded", {"pressure": 0.6}),
        (64.1, "overload-ended", {"for_s": 360, "repeated": {"warning (scale)": 3}}),
        (65.0, "reloaded", {"file": "p", "limits": {"profile": "fine", "beside": {"point_mm": None}}}),
        (66.0, "state", state("device lost", "tracker-lost", "calibration verified")),
    ]
    tests: list[dict[str, object]] = [
        {"utc": "2026-01-02T07:00:00+00:00", "passed": passed, "operator": "anna", "items": [{"name": "disk"}]}
        for passed in (True, False)
    ]
    held = [reference(n, f"2026-01-0{n}T04:00:00+00:00") for n in (1, 2)]
    found = summary(
        period(kind, datetime(2026, 1, 2, tzinfo=UTC)), read_log(logged(folder, entries)), tests, made, held
    )
    found.torn = ["alarms-1.jsonl line 7: was cut off while it was written"]
    found.simulated, found.chains = True, 2
    return found


@pytest.mark.parametrize("kind", PERIODS)
@pytest.mark.parametrize("so_far", [True, False])
def test_no_english_is_left_on_a_german_report(tmp_path: Path, kind: str, so_far: bool) -> None:
    """Beside a German status the report was English but for its first line on the terminal."""
    until = datetime(2026, 1, 2, 23, tzinfo=UTC) if so_far else NOW
    found = full_of_it(tmp_path / "alarms", kind, until)
    found.alarms *= 1 if so_far else 80
    dates = Dates(until + timedelta(days=2), until + timedelta(days=3))
    english, german = written(tmp_path, found, dates, [])
    assert "<html lang=de>" in german.read_text()
    assert list(english_on(english, german)) == []


def test_no_english_is_left_of_what_stands_at_the_top(tmp_path: Path) -> None:
    found = full_of_it(tmp_path / "alarms", "month", NOW)
    found.damages = [f"alarms-1.jsonl line {n}: {CUT_OFF}" for n in range(7)]
    overdue = Dates(NOW - timedelta(days=2), NOW - timedelta(days=1))
    faults = ["a.json cannot be read", "b.json was changed after it was kept"]
    assert list(english_on(*written(tmp_path, found, overdue, faults))) == []
    found.store_fault, found.in_force, found.references = "/x: is too large. Restore the folder from a copy", [], []
    found.alarms, found.overloads = [], found.overloads * 2
    assert list(english_on(*written(tmp_path, found, None, []))) == []


def test_no_english_is_left_where_nothing_happened(tmp_path: Path) -> None:
    nothing = summary(period("month", NOW), read_log(tmp_path), [], NOW + timedelta(days=60))
    assert list(english_on(*written(tmp_path, nothing, None, []))) == []


def test_the_command_of_a_german_cart_writes_it_in_german(cart: Path) -> None:
    cart.write_text(cart.read_text().replace("[alarm]", '[alarm]\nlanguage = "de"'))
    said = made(cart)
    assert said.startswith("Bericht, Monat 2026-01, wie mit --of verlangt\ngeschrieben: ")
    told = " ".join(body(cart, "2026-01").split())
    for words in ("Bericht, Monat 2026-01, wie mit --of verlangt. Von 2026-01-01", "Bild ist gespiegelt (polarity)"):
        assert words in told
    assert "quittieren (einmal)" in told


def test_no_english_is_left_on_the_page_of_a_german_trend(tmp_path: Path) -> None:
    for hour in range(30):
        at, row = datetime(2026, 1, 1, tzinfo=UTC) + timedelta(hours=hour), [hour / 9, 0.1, 5.0]
        AlarmLog(tmp_path).append(at, hour, "estimate", {"reference": 1, "checks": {"rotation-axial": row}}, None)
    drifts = trends(read_log(tmp_path).entries, 1)
    for language in ("en", "de"):
        headings = [recognised(heading, language) for heading in HEADINGS]
        rows = [row_of(*one, language) for one in drifts.items()]
        units = {name: unit_of(name) for name in drifts}
        write_trend_page(tmp_path / f"{language}.html", 1, drifts, units, headings, rows, language)
    assert list(english_on(tmp_path / "en.html", tmp_path / "de.html")) == []


def test_english_that_is_left_is_seen(tmp_path: Path) -> None:
    for name, said in (("en", "None in force"), ("de", "None in force"), ("half", "Keine in force")):
        (tmp_path / name).write_text(f"<p>{said}</p><p>polarity</p>")
    assert list(english_on(tmp_path / "en", tmp_path / "de")) == ["None in force", "force: None in force"]
    assert list(english_on(tmp_path / "en", tmp_path / "half")) == ["force: Keine in force"]


def damages(folder: Path) -> Iterator[Damage]:
    """Returns the damages reported for a log that was edited, cut or deleted by hand."""
    entries: list[tuple[float, str, dict[str, object]]] = [(float(n), "started", {}) for n in range(6)]
    (segment,) = logged(folder, entries).glob("alarms-*.jsonl")
    lines = segment.read_bytes().splitlines(keepends=True)
    changed = lines[2].replace(b"started", b"startet")
    hurt = ([*lines[:2], changed, *lines[3:]], lines[:2] + lines[3:], lines[1:], lines[:-2], [*lines, b"\xff\n"])
    for left in (*hurt, [*lines, b"{\n"], [*lines, b'{"digest": 3}\n'], [*lines, b"7\n"], [*lines[:2], *lines[1:]]):
        segment.write_bytes(b"".join(left))
        yield from read_log(folder).damages
    segment.write_bytes(b"".join(lines))
    memory = folder / "memory.json"
    for content in (b"{}", b"7", None):
        memory.write_bytes(content) if content is not None else memory.unlink()
        yield from read_log(folder).damages


def test_what_is_wrong_with_the_log_is_told_in_german(tmp_path: Path) -> None:
    found = {str(damage) for damage in damages(tmp_path)}
    assert len(found) > 8
    assert {one for one in found if damage_text(one, "de") == one} == set()
    assert damage_text("x line 3: is odd", "de") == "x line 3: is odd"


@pytest.mark.parametrize("damage", ["history", "content", "missing", "none", "no JSON", "large"])
def test_what_is_wrong_with_the_store_is_told_in_german(tmp_path: Path, damage: str) -> None:
    kept = reference(1, "2025-12-24T08:00:00+00:00")
    write_history(tmp_path, History(entries=(kept,)), {kept.sha256: b"1"})
    history, content = tmp_path / "references" / "history.json", tmp_path / "references" / f"{sha256_of(b'1')}.toml"
    if damage in ("missing", "none"):
        (history if damage == "missing" else content).unlink()
    else:
        hurt = content if damage == "content" else history
        whole = json.dumps({**json.loads(history.read_text()), "more": 1})
        new = {"history": whole, "content": "2", "no JSON": "{", "large": " " * 20_000_000}[damage]
        hurt.write_text(new)
    with pytest.raises(ConfigurationError) as refused:
        read_history(tmp_path)
    said = lost_text(str(refused.value), "de")
    assert said.endswith("probewatch calibration reset")
    assert " Den Ordner aus einer Kopie wiederherstellen, oder " in said
