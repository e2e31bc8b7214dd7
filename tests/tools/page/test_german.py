"""Whatever the pages say by themselves has its German, and what has figures in it is recognised as it is said."""

import ast
import json
import re
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from probewatch.appliance.core.acquisition.pairing import REASONS
from probewatch.appliance.core.quality.calibration_difference import Difference
from probewatch.appliance.crosswire import coverage, running
from probewatch.appliance.crosswire.crossing import NoCrossing
from probewatch.appliance.crosswire.running import Reason, RunningCalibration, WholeDemand
from probewatch.appliance.crosswire.scan import CrosswireScan
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.types import State
from probewatch.tools import page
from probewatch.tools.page.wording import worded
from probewatch.tools.recalibration.phase import Phase
from probewatch.tools.recalibration.steps import CheckStep, Sound
from tests.support.crossings import SIZE_PX, TRUE, guided_views

FILES = Path(page.__file__).parent / "files"
SOURCE = (FILES / "german.js").read_text(encoding="utf-8")
GERMAN = json.loads(re.search(r"const GERMAN = (\{.*?\});", SOURCE, re.DOTALL)[1])
PATTERNS = [re.compile(found) for found in re.findall(r"^  \[/(\^.*\$)/, ", SOURCE, re.MULTILINE)]
ALIKE = {"probewatch", "…", "ζ …", "probewatch page --token"}
"""What both languages say."""


class Texts(HTMLParser):
    """What is read, and what a screen reader says."""

    def __init__(self) -> None:
        super().__init__()
        self.found: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found |= {
            value for name, value in attrs if name in ("aria-label", "placeholder", "title", "alt") and value
        }

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.found.add(data.strip())


def says_german(text: str) -> bool:
    return text in GERMAN or any(pattern.search(text) for pattern in PATTERNS)


@pytest.mark.parametrize("page", ["status.html", "recalibrate.html"])
def test_every_text_of_the_pages_has_its_german(page: str) -> None:
    texts = Texts()
    texts.feed((FILES / page).read_text(encoding="utf-8"))
    assert [text for text in texts.found - ALIKE if text not in GERMAN and re.search("[a-z]{2}", text)] == []


@pytest.mark.parametrize("script", ["common.js", "status.js", "recalibrate.js"])
def test_every_text_that_a_script_says_has_its_german(script: str) -> None:
    """Choices and lists among them."""
    source = (FILES / script).read_text(encoding="utf-8")
    calls = " ".join(re.findall(r"\b(?:say|whole)\(([^`]*?)\)(?=[\s;,}:)])", source))
    said = [text for text in re.findall(r'"((?:[^"\\]|\\.)*)"', re.sub(r'=== "\w+"', "", calls)) if text]
    assert len(said) >= 3
    assert [text for text in said if text not in GERMAN] == []


def test_what_the_scan_says_of_motion_and_of_pictures_has_its_german() -> None:
    said = [*REASONS, *(one.value for one in (*Reason, *NoCrossing))]
    said += [text for pair in coverage._TOWARDS for text in pair]
    said += [coverage._place_words(row, column) for row in range(3) for column in range(3)]
    said += [f"To show it: {motion}" for motion in running._MOVEMENTS.values()]
    assert [text for text in said if text not in GERMAN] == []


def test_refusals_are_recognised_as_they_are_said() -> None:
    """Every reason, from scans that call it forth."""
    seen = {}
    flat = guided_views(1, 30, tilt_deg=(1.0, 1.0, 1.0), noise_mm=2.0, one_way=True)
    places = np.random.default_rng(1).uniform(10, 470, (40, 2))
    moved = [
        replace(view, centre_px=place) if index % 5 < 2 else view
        for index, (view, place) in enumerate(zip(guided_views(5, 40), places, strict=True))
    ]
    anywhere = [replace(view, centre_px=place) for view, place in zip(flat, places, strict=False)]
    cases = [(flat[:3], ()), (flat, (2.0,) * 40), (moved, ()), (anywhere, ()), (guided_views(2, 8, one_way=True), ())]
    for views, misses_mm in cases:
        calibration = RunningCalibration(SIZE_PX, None, WholeDemand())
        for view in views:
            calibration.add(view)
        for one in calibration.state(misses_mm).refusals:
            seen[one.reason] = one
            assert says_german(one.what), one.what
            assert says_german(one.remedy), one.remedy
    assert set(seen) == set(Reason)


def test_what_the_check_says_is_recognised() -> None:
    step = CheckStep(0.0, (0.08, 0.07), None)
    views = guided_views(3, 5, noise_mm=0.05)
    for known, crossing_mm in ((views[:1], np.zeros(3)), (views, np.array([64.0, -87.0, -1520.0]))):
        step.scan = CrosswireScan()
        step.scan.views += known
        assert says_german(step.judged(TRUE, crossing_mm)[1])
    step.scan.views += guided_views(4, 20, noise_mm=4.0)
    assert says_german(step.judged(TRUE, np.zeros(3))[1])


ROOT = Path(page.__file__).parents[2]
SPEAKERS = (
    "tools/recalibration/session.py",
    "tools/recalibration/phase.py",
    "tools/recalibration/held_service.py",
    "tools/recalibration/steps.py",
    "tools/recalibration/paperwork.py",
    "tools/recalibration/scanning.py",
    "tools/page/server.py",
    "tools/page/alarm_log_watch.py",
    "tools/shared/sign_off.py",
    "tools/shared/status_watch.py",
    "appliance/service/control/hold.py",
)
"""Whose refusals, troubles and messages reach the page."""
REFUSALS = {
    "ControlRefused",
    "ScanRefused",
    "ConfigurationError",
    "IndexError",
    "refused",
    "_nothing",
    "_give_up",
    "_abort",
}
SAID = {"_trouble", "_message", "pose_trouble", "_why", "what", "remedy", "trouble", "why"}
"""Names and attributes that hold such a text."""
NOT_SHOWN = {
    "tools/recalibration/session.py": {"not possible while 12"},  # of every state, below
    "tools/recalibration/steps.py": {"12; 12 % is the most", "it is 12 mm from where the scan was made"},  # below
    "tools/shared/sign_off.py": {
        "Give --expires a later day",
        "12 has passed",
        "Give 12 a later day",
    },  # the page asks for no dates
    "appliance/service/control/hold.py": {
        # parts of the sentence that hold.py puts together, and what no page can ask for
        "whose connection is gone",
        "who has been silent for 12 s",
        "hold_s must be 12 to 12 seconds",
    },
}
A_FEW = {"g": "12", "d": "12", ".0f": "12", ".1f": "1.2", ".2f": "1.23"}
"""What stands for a figure in a text that is put together."""


def texts(node: ast.AST) -> Iterator[str]:
    """Constants, what is put together with figures in place of its fields, and both sides of a choice."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.JoinedStr):
        yield "".join(field(part) for part in node.values)
    elif isinstance(node, ast.IfExp):
        yield from (*texts(node.body), *texts(node.orelse))
    elif isinstance(node, ast.Tuple):
        yield from (text for one in node.elts for text in texts(one))
    elif isinstance(node, ast.BoolOp):
        yield from (text for one in node.values for text in texts(one))


def field(part: ast.expr) -> str:
    if isinstance(part, ast.Constant):
        return str(part.value)
    assert isinstance(part, ast.FormattedValue)
    if part.format_spec is not None:
        return A_FEW["".join(texts(part.format_spec))]
    chosen = list(texts(part.value))
    return chosen[0] if chosen else "12"


def spoken(source: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call):
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            if name in REFUSALS:
                yield from (text for argument in node.args for text in texts(argument))
        elif isinstance(node, ast.Dict):
            named = [value for key, value in zip(node.keys, node.values, strict=True) if texts_of(key) & SAID]
            yield from (text for value in named for text in texts(value))
        elif isinstance(node, ast.Assign):
            names = [getattr(target, "attr", getattr(target, "id", "")) for target in flat(node.targets)]
            if set(names) & SAID:
                yield from texts(node.value)
        elif isinstance(node, ast.Return) and node.value is not None:
            yield from (text for text in texts(node.value) if text.startswith("abandoned"))


def texts_of(key: ast.expr | None) -> set[str]:
    return set() if key is None else set(texts(key))


def flat(targets: list[ast.expr]) -> Iterator[ast.expr]:
    for target in targets:
        yield from target.elts if isinstance(target, ast.Tuple) else [target]


@pytest.mark.parametrize("file", SPEAKERS)
def test_what_the_program_says_to_the_page_has_its_german(file: str) -> None:
    said = {text for text in spoken((ROOT / file).read_text(encoding="utf-8")) if re.search("[a-z]{2}", text)}
    assert said, "nothing was found in it: look elsewhere"
    composed = {text for text in said if text.startswith(("not verified, the calibration before", "rejected"))}
    assert sorted(text for text in said - composed - NOT_SHOWN.get(file, set()) if not says_german(text)) == []


@pytest.mark.parametrize("state", [one.value for one in (*State, *Phase)])
def test_what_is_not_possible_now_has_its_german(state: str) -> None:
    assert says_german(f"not possible while {state}")


@pytest.mark.parametrize(("water_c", "scanner_m_s"), [(20, 1540), (48, 1540), (80, 1450), (20, 1000), (96, 1540)])
@pytest.mark.parametrize("corrected", [True, False])
def test_what_is_said_of_the_water_has_its_german(water_c: float, scanner_m_s: float, corrected: bool) -> None:
    try:
        said = [Sound(water_c, scanner_m_s, corrected).text]
    except ControlRefused as refusal:
        said = [refusal.what, refusal.remedy]
    assert [text for text in said if not says_german(text)] == []


def test_the_difference_to_be_accepted_has_its_german() -> None:
    assert says_german(Difference(1.2, (0.3, -0.4), (1.0, -2.0, 3.5), True, None).text)


def event(language: str, reason: str, message: str) -> dict[str, Any]:
    check = {"name": "rotation-axial", "unit": "deg"}
    status = {"language": language, "reason": reason}
    entries = [{"utc": "", "state": "halt", "reason": reason}, {"utc": "", "state": "halt", "reason": ""}]
    recalibration = {"message": message, "scan": {"compared": [check]}}
    alarms = {"entries": entries, "hour": entries, "trouble": ""}
    return {"status": status, "alarms": alarms, "recalibration": recalibration}


def test_what_the_service_says_is_said_in_the_language_of_the_room() -> None:
    reason = "too little in-plane motion to show: rotation-axial"
    back = "not verified, the calibration before is in force: monitoring: calibration verified"
    said = worded(event("de", reason, back), "de")
    assert said["status"]["reason"] == "zu wenig Bewegung in der Bildebene für: Drehung axial"
    for name in ("entries", "hour"):
        assert [entry["state"] for entry in said["alarms"][name]] == ["Halt", "Halt"]
    german = "nicht bestätigt, die Kalibrierung davor ist in Kraft: überwacht: Kalibrierung bestätigt"
    assert said["recalibration"]["message"] == german
    assert said["recalibration"]["scan"]["compared"][0]["title"] == "Drehung axial"


def test_what_is_not_known_stays_english_as_a_whole() -> None:
    back = "not verified, the calibration before is in force: halt: the moon is full"
    said = worded(event("de", "the moon is full", back), "de")
    assert said["status"]["reason"] == "the moon is full"
    assert said["alarms"]["entries"][0]["state"] == "halt", "no line in two languages"
    assert said["recalibration"]["message"] == back


def test_english_stays_as_it_is() -> None:
    before = event("en", "calibration verified", "not verified, the calibration before is in force: halt: x")
    said = worded(json.loads(json.dumps(before)), "en")
    assert said["status"]["reason"] == before["status"]["reason"]
    assert said["alarms"] == before["alarms"]
    assert said["recalibration"]["message"] == before["recalibration"]["message"]
    silent = worded({**event("de", "calibration verified", ""), "status": None}, "de")
    assert silent["status"] is None
    assert silent["alarms"]["entries"][0]["reason"] == "Kalibrierung bestätigt", "also while the service is away"
