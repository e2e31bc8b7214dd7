"""Whatever the pages say by themselves has its German, and what has figures in it is recognised as it is said."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import tools.page
from appliance.crosswire import coverage, running
from appliance.crosswire.crossing import NoCrossing
from appliance.crosswire.running import Reason, RunningCalibration, WholeDemand
from appliance.crosswire.scan import CrosswireScan
from tests.support.crossings import SIZE_PX, TRUE, guided_views
from tools.recalibration.steps import CheckStep

FILES = Path(tools.page.__file__).parent / "files"
SOURCE = (FILES / "german.js").read_text(encoding="utf-8")
GERMAN = json.loads(re.search(r"const GERMAN = (\{.*?\});", SOURCE, re.DOTALL)[1])
PATTERNS = [re.compile(found) for found in re.findall(r"^  \[/(\^.*\$)/, ", SOURCE, re.MULTILINE)]
ALIKE = {"probewatch", "probewatch: recalibrate", "…", "ζ …", "probewatch page --token"}
"""What both languages say."""


class Texts(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: set[str] = set()

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.found.add(data.strip())


def says_german(text: str) -> bool:
    return text in GERMAN or any(pattern.search(text) for pattern in PATTERNS)


@pytest.mark.parametrize("page", ["status.html", "recalibrate.html"])
def test_every_text_of_the_pages_has_its_german(page: str) -> None:
    texts = Texts()
    texts.feed((FILES / page).read_text(encoding="utf-8"))
    assert [text for text in texts.found - ALIKE if text not in GERMAN] == []


@pytest.mark.parametrize("script", ["common.js", "status.js", "recalibrate.js"])
def test_every_text_that_a_script_says_has_its_german(script: str) -> None:
    said = re.findall(r'\bsay\("([^"]+)"\)', (FILES / script).read_text(encoding="utf-8"))
    assert said
    assert [text for text in said if text not in GERMAN] == []


def test_what_the_scan_says_of_motion_and_of_pictures_has_its_german() -> None:
    said = [one.value for one in (*Reason, *NoCrossing)]
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
