"""What the technician's commands print has its German, whole; what is recognised is recognised as it is said."""

import ast
import json
import re
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from probewatch.appliance.storage.reference_dates import Dates
from probewatch.appliance.supervision.languages import GERMAN
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp
from probewatch.tools.german.questions import GERMAN_OF_QUESTIONS
from probewatch.tools.german.reports import GERMAN_OF_REPORTS
from probewatch.tools.german.setup import GERMAN_OF_SETUP
from probewatch.tools.german.texts import GERMAN_OF_TOOLS as GERMAN_OF_TEXTS
from probewatch.tools.german.translation import _of_page, confirmed, recognised, told
from probewatch.tools.selftest import items
from probewatch.tools.selftest.baseline import beside, chosen
from probewatch.tools.selftest.items import Item
from probewatch.tools.shared.interruption import Stopped, stopped_saying
from tests.support.answering import Answering, recorded
from tests.support.answers import answered
from tests.tools.selftest.test_items import poses

TABLES = (GERMAN_OF_TEXTS, GERMAN_OF_SETUP, GERMAN_OF_QUESTIONS, GERMAN_OF_REPORTS)
GERMAN_OF_TOOLS = {text: german for table in TABLES for text, german in table.items()}
ROOT = Path(__file__).parents[3]
SPEAKERS = ("tools/commands", "tools/recalibration", "tools/selftest", "tools/shared", "appliance/storage")
SPEAKERS += ("tools/report", "appliance/service/control", "drivers/trackers/ndi")
COMMANDS = re.compile(r"probewatch \w|docs/")
"""What is a command or a page and has no German of its own."""


def sources() -> Iterator[str]:
    for folder in SPEAKERS:
        for file in (ROOT / folder).glob("*.py"):
            yield file.read_text(encoding="utf-8")


def told_texts() -> set[str]:
    """The first argument of every call of `told`, by itself or by a name that stands for it."""
    speaking = [source for source in sources() if "from probewatch.tools.german.translation import" in source]
    return {text for source in speaking for text in told_in(ast.parse(source))}


def told_in(tree: ast.AST) -> Iterator[str]:
    named: dict[str, set[str]] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign):
            for target in node.targets:
                named.setdefault(getattr(target, "id", ""), set()).update(constants(node.value))
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Call)
            and getattr(node.func, "id", getattr(node.func, "attr", "")) in ("told", "tell")
            and node.args
        ):
            given = node.args[0]
            yield from named.get(given.id, ()) if isinstance(given, ast.Name) else constants(given)


def constants(node: ast.expr) -> set[str]:
    """A text, or both of a choice."""
    if isinstance(node, ast.IfExp):
        return constants(node.body) | constants(node.orelse)
    return {node.value} if isinstance(node, ast.Constant) and isinstance(node.value, str) else set()


def test_every_text_that_is_told_has_its_german_with_the_same_fields() -> None:
    assert told_texts() - set(GERMAN_OF_TOOLS) - set(GERMAN) == set()
    for english, german in GERMAN_OF_TOOLS.items():
        assert sorted(re.findall(r"{[^}]*}", english)) == sorted(re.findall(r"{[^}]*}", german)), english
    assert set(GERMAN) & set(GERMAN_OF_TOOLS) == set(), "one translation each"
    assert len(GERMAN_OF_TOOLS) == sum(map(len, TABLES)), "one translation each"


def test_the_page_has_the_same_german_for_the_same_text() -> None:
    ours = {text: german for text, german in GERMAN_OF_TOOLS.items() if german != _of_page(text) != text}
    assert ours == {}


def test_nothing_is_translated_that_nobody_says() -> None:
    """Each piece between the figures of a text stands in some source as it is."""
    said = " ".join(re.sub(r'"\s*\n?\s*f?"', "", source) for source in sources())
    for english in GERMAN_OF_TOOLS:
        pieces = [
            piece
            for piece in re.split(r"{\w+}(?:\.json)?|[,():;]|^(?:video|tracker) ", english)
            if re.search("[a-z]{3}", piece)
        ]
        assert all(piece.strip(" /%°±.?") in said for piece in pieces), english


def healthy() -> list[Item]:
    frames = [Frame(Stamp(index * 33_333_333, 1_000_000), index, np.zeros((48, 64), np.uint8)) for index in range(90)]
    status = recorded()
    found = [*items.service(status), *items.devices(status), *items.disk(status)]
    found += items.timing("tracker", poses(120), [pose.stamp.t_ns for pose in poses(120)], 500.0)
    found += items.timing("video", frames, [frame.stamp.t_ns for frame in frames], 500.0)
    return [*found, items.noise(poses()), items.outputs(status, True), *items.reference(status, datetime.now(UTC))]


def sick() -> list[Item]:
    status = recorded(state="halt", latched="halt", acknowledged=False)
    for check in status["devices"]:
        check["verdict"], check["value"] = "FAULT", None if check["name"] == "video presence" else 1234.0
    status["log"]["free_bytes"] = 1_000
    status["counters"]["estimator_restarts"] = 2
    found = [*items.service(status), *items.devices(status), *items.disk(status)]
    status = recorded(state="device lost", latched="halt", acknowledged=True)
    for check in status["devices"]:
        check["verdict"], check["value"] = ("FAULT", 9.0) if "presence" in check["name"] else ("OK", 0.0)
    status["log"]["free_bytes"] = None
    found += [*items.service(status), *items.devices(status), *items.disk(status)]
    vague = [Pose(Stamp(n * 10**9 * 3, 50_000_000), 5 * n, None, 0.0, PoseStatus.MISSING) for n in range(20)]
    found += items.timing("tracker", vague, [0] * 20, 500.0)
    found += [items.noise(poses(drift_mm=20.0)), items.noise([]), items.noise(poses(noise_mm=2.0))]
    found += [
        items.outputs(recorded(outputs=[{"signal": "tone", "url": "", "energised": True}]), one)
        for one in (None, False)
    ]
    now = datetime(2026, 11, 23, tzinfo=UTC)
    found += [items.clock(now, now + timedelta(days=1), one) for one in (None, True, False)]
    due = recorded(reference_due_utc="2026-01-01T00:00:00+00:00")
    due["reference_overdue"] = Dates(now, None, since=now, first_use=now).overdue(now)
    due["reference"]["verified_utc"] = None
    return [*found, *items.reference(due, now), items.overlay([])]


def compared() -> list[Item]:
    first = {"utc": "2026-01-01T00:00:00+00:00", "software": "0.2.0"}
    before = [{"name": "tracker rate", "figure": 30.0}, {"name": "noise at rest", "figure": 0.01}]
    return [*beside(healthy(), {**first, "items": before}), chosen(healthy()), chosen(sick())]


@pytest.mark.parametrize("found", [healthy(), sick(), compared()], ids=["healthy", "sick", "compared"])
def test_every_item_of_a_self_test_is_told_in_german(found: list[Item]) -> None:
    """On a German cart the list was English, what to do among it."""
    texts = {text for item in found for text in (item.name, item.what, item.remedy) if re.search("[a-zA-Z]{3}", text)}
    english = {text for text in texts if recognised(text, "de") == text}
    assert sorted(text for text in english if text not in GERMAN_OF_TOOLS.values() and text != items_remedy()) == []
    for text in texts:
        assert re.findall(r"\d[\d.:+T-]*", recognised(text, "de")) == re.findall(r"\d[\d.:+T-]*", text)
        assert recognised(text, "en") == text


def items_remedy() -> str:
    """What the service says to do, which is in its language already."""
    return str(recorded()["remedy"])


def test_a_german_cart_is_tested_in_german_and_its_record_stays_as_it_is(tmp_path: Path) -> None:
    with Answering(tmp_path / "control") as service:
        service.changes = {"language": "de"}
        given = ("self-test", "--socket", service.path, "--folder", tmp_path / "kept", "--yes", "--lamps", "skip")
        shown = answered(*given)
    assert "✓\tUhr\t" in shown.stdout
    assert "nicht grün." in shown.stdout
    assert "aufbewahrt: " in shown.stdout
    (record,) = (json.loads(file.read_text()) for file in (tmp_path / "kept").iterdir())
    assert {"clock", "service", "disk"} <= {item["name"] for item in record["items"]}


def test_what_is_told_is_filled_in_and_what_is_unknown_stays_english() -> None:
    assert told("kept: {file}", "de", file="a.json") == "aufbewahrt: a.json"
    assert told("kept: {file}", "en", file="a.json") == "kept: a.json"
    assert recognised("something new, at most 3 mm", "de") == "something new, at most 3 mm"


def test_a_template_whose_fields_have_a_format_is_recognised_as_it_was_told_or_as_it_stands() -> None:
    assert recognised("verified 1.2 s ago", "de") == "bestätigt vor 1.2 s"
    rates = "video 30.0/s · tracker 60.0/s · dropped: 1 frames, 2 poses"
    assert recognised(rates, "de") == "Video 30.0/s · Tracker 60.0/s · verworfen: 1 Bilder, 2 Posen"
    assert recognised("verified {age:.1f} s ago", "de") == "verified {age:.1f} s ago"


def test_what_the_page_says_of_a_scan_is_known_as_well() -> None:
    assert recognised("3 usable views of the crossing, 8 are needed", "de") == (
        "3 brauchbare Ansichten der Kreuzung, 8 sind nötig"
    )
    assert recognised("Pass slowly through the crossing", "de") == "Langsam durch die Kreuzung fahren"


def test_the_status_of_a_german_cart_says_in_german_what_keeps_its_reference_from_being_verified(
    tmp_path: Path,
) -> None:
    """Both lines were English below a German state."""
    remarks = ["damaged replies refused: 4; where they go on, see cable and plugs"]
    waits = "it is far from the one before, and of it is not shown yet: polarity, scale-axial"
    with Answering(tmp_path / "control") as service:
        service.changes = {"language": "de", "remarks": remarks, "reference_waits": waits}
        shown = " ".join(answered("status", "--socket", service.path).stdout.split())
    assert "! beschädigte Antworten abgelehnt: 4; halten sie an, Kabel und Stecker ansehen" in shown
    assert "! Referenz: sie ist weit von der vorigen, und von ihr ist noch nicht gezeigt: Spiegelung, Maßstab" in shown


def test_what_was_stopped_is_told_in_one_language() -> None:
    with pytest.raises(Stopped) as stopped, stopped_saying(told("nothing was changed", "de"), told("stopped", "de")):
        raise KeyboardInterrupt
    assert (stopped.value.word, *stopped.value.args) == ("beendet", "nichts wurde geändert")


@pytest.mark.parametrize(("typed", "yes"), [("j", True), ("Ja", True), ("y", True), ("n", False), ("", False)])
def test_a_german_question_takes_a_german_answer(typed: str, yes: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A j was "invalid input"."""
    said = iter(["vielleicht", typed])
    monkeypatch.setattr("click.termui.visible_prompt_func", lambda _: next(said))
    assert confirmed("Stimmt das?", "de") is yes
