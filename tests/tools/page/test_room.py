"""The page shows the status as people read it: headline, bars, devices, gestures."""

import json
from pathlib import Path
from typing import Any

import pytest

from probewatch.appliance.core.quality.gesture import Gesture
from probewatch.appliance.service.control.status import alarm_fields
from probewatch.appliance.supervision.alarms import HAZARDS, operator_text
from probewatch.appliance.supervision.fault_row import Device
from probewatch.appliance.supervision.faults import of_device
from probewatch.appliance.supervision.languages import translated
from probewatch.appliance.types import PARAMETERS, AlarmState, Fault, Kind, State
from probewatch.tools import page
from probewatch.tools.page.asking import REQUESTS
from probewatch.tools.page.bars import NAMES, bars, rounded
from probewatch.tools.page.devices import devices
from probewatch.tools.page.lacks import NO_LAMPS, NO_TONE
from probewatch.tools.page.room import room
from probewatch.tools.shared.gesture_drawings import DRAWINGS, drawing, drawn
from tests.support.answering import recorded
from tests.tools.page.test_german import GERMAN

SECOND_NS = 1_000_000_000


@pytest.mark.parametrize(
    ("value", "sigma", "limit", "said"),
    [
        (-0.2735, 0.6144, 3.0, "\u22120.3 ± 0.6"),
        (0.0745, 0.5309, 5.0, "0.1 ± 0.5"),
        (-0.02, 0.6, 3.0, "0.0 ± 0.6"),
        (2.7298, 5.0, 60.0, "3 ± 5"),
        (101.26, 0.0313, 60.0, "101.3"),
        (1.234, 0.1456, 3.0, "1.23 ± 0.15"),
        (1.234, 0.0961, 3.0, "1.23 ± 0.10"),
        (-27.4, 25.2, 60.0, "\u221230 ± 30"),
        (0.0000200, 0.0, 4.0, "0.00"),
        (1.01e-13, 1e-14, 5.0, "0.00"),
        (3.14159, None, 60.0, "3.1"),
        (412.7, 0.0, 500.0, "413"),
    ],
)
def test_a_value_has_the_figures_that_its_sigma_lets_stand(
    value: float, sigma: float | None, limit: float, said: str
) -> None:
    assert rounded(value, sigma, limit) == said


def check(name: str, **fields: Any) -> dict[str, Any]:
    usual = {"fault": "offset", "value": 6.0, "sigma": 0.5, "unit": "mm", "limit": 4.0, "ratio": 1.5, "verdict": "OK"}
    ages = {"shown_age_s": 2.0, "max_age_s": 120.0, "shown": "verified", "carried": False}
    return {"name": name, **usual, **ages, **fields}


def of(name: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    return next(row for row in rows if row["name"] == name)


@pytest.mark.parametrize(
    ("signals", "lacking"),
    [
        (["contact"], {"lamp-test": NO_LAMPS, "silence": NO_TONE, "sound": NO_TONE}),
        (["contact", "red"], {"silence": NO_TONE, "sound": NO_TONE}),
        (["tone", "contact"], {}),
    ],
)
def test_of_a_cart_without_lamp_or_tone_the_page_says_so_instead_of_done(
    signals: list[str], lacking: dict[str, str]
) -> None:
    """It said "done" of a lamp test and of silence, whatever the cart had."""
    told = room(recorded(outputs=[{"url": "relay:x", "signal": signal} for signal in signals]))
    assert told["lacks"] == lacking
    assert set(lacking) <= set(REQUESTS)
    assert set(lacking.values()) <= set(GERMAN)
    script = (Path(page.__file__).parent / "files" / "status.js").read_text(encoding="utf-8")
    assert "shownLast.lacks[what]" in script


def test_there_are_ten_bars_also_where_nothing_is_known() -> None:
    rows = bars([], "en")
    assert [row["name"] for row in rows] == [*NAMES] == ["polarity", *PARAMETERS, "latency"]
    assert {(row["text"], row["share"], row["mark"]) for row in rows} == {("–", None, "missing")}
    unknown = of("offset-axial", bars([check("offset-axial", value=None, sigma=None, verdict="NOT_VERIFIED")], "en"))
    assert (unknown["text"], unknown["mark"]) == ("–", "missing")


@pytest.mark.parametrize(
    ("fields", "mark"),
    [
        ({}, "shown"),
        ({"shown": "carried", "carried": True}, "carried"),
        ({"shown": "carried", "carried": True, "verdict": "NOT_VERIFIED"}, "carried"),
        ({"shown": "missing"}, "missing"),
        ({"verdict": "NOT_VERIFIED"}, "missing"),
        ({"verdict": "FAULT"}, "wrong"),
    ],
)
def test_a_bar_says_its_share_of_the_limit_and_how_it_is_known(fields: dict[str, Any], mark: str) -> None:
    row = of("offset-axial", bars([check("offset-axial", **fields)], "de"))
    assert (row["mark"], row["share"], row["sigma_share"]) == (mark, 1.5, 0.125)
    assert (row["title"], row["text"], row["limit"]) == ("Versatz axial", "6,0 ± 0,5 mm", "4 mm")


@pytest.mark.parametrize(("value", "said"), [(0.0, "as calibrated"), (1.0, "mirrored")])
def test_polarity_is_told_in_words(value: float, said: str) -> None:
    row = bars([check("polarity", value=value, sigma=0.0, unit="axes", limit=0.5)], "en")[0]
    assert (row["text"], row["limit"], said in GERMAN) == (said, "", True)


def told(state: State, fault: Fault | None = None, language: str = "en", **fields: Any) -> dict[str, Any]:
    """A status in that state, its words as the service makes them."""
    alarm = AlarmState(state, 0, fault, "why", state is State.MONITORING, None)
    said = alarm_fields(90 * SECOND_NS, alarm, language, ["sim:x"], fields.pop("wanted", ()))
    return recorded(**said, language=language, simulated=["sim:x"], **fields)


@pytest.mark.parametrize("language", ["en", "de"])
@pytest.mark.parametrize("state", State)
def test_the_headline_is_short_and_what_is_wrong_stands_beside_it(state: State, language: str) -> None:
    for fault in (None, Fault.POLARITY):
        shown = room(told(state, fault, language))
        assert shown["headline"] == operator_text(state, None, language)[0]
        assert shown["named"] == ("" if fault is None else translated(HAZARDS[fault].text, language))
        assert (shown["simulated"], shown["rests"]) == (True, "")
        assert len(shown["headline"]) <= 40


def test_what_is_carried_is_no_headline() -> None:
    text = "SIMULATED · Calibration verified · in part by earlier motion"
    shown = room(recorded(text=text))
    assert (shown["headline"], shown["named"]) == ("Calibration verified", "")
    assert shown["rests"] == "in part by earlier motion"


def test_every_hazard_that_is_none_of_the_calibration_belongs_to_one_device() -> None:
    for fault, row in HAZARDS.items():
        about = "none, as it is about the calibration" if fault.kind is Kind.CALIBRATION else "one"
        assert (row.device is None) is (fault.kind is Kind.CALIBRATION), f"device of the row of {fault}: name {about}"
    for one in Device:
        places = [HAZARDS[fault].place for fault in of_device(one)]
        assert places == [*range(1, len(places) + 1)], f"{one}: place of each of {of_device(one)}, the worst first"
    assert [name for name in Device if name not in GERMAN] == []


def device(status: dict[str, Any], name: str, language: str = "en") -> dict[str, Any]:
    return next(row for row in devices(status, language) if row["device"] == name)


def test_devices_are_as_they_should_be() -> None:
    """Also where something is not told, as the field of an optical tracker."""
    rows = devices(recorded(), "en")
    assert {(row["kind"], *row["wrong"], *row["driver"]) for row in rows} == {("good",)}
    assert [row["rate"] for row in rows[:2]] == [27.11, 59.07]


def test_a_lost_device_says_what_is_wrong_and_its_driver_beside_it() -> None:
    gone = {"name": "tracker presence", "fault": "tracker-lost", "value": 900.0, "verdict": "FAULT"}
    stale = {"name": "tracker freshness", "fault": "tracker-stale", "value": 900.0, "verdict": "FAULT"}
    status = recorded(devices=[stale, gone], lost={"tracker ndi:/dev/ttyUSB0": "no answer within 1 s"})
    row = device(status, "Tracker", "de")
    assert row["kind"] == "bad"
    assert row["wrong"] == [{"text": "Tracker antwortet nicht", "remedy": "Strom und Kabel des Trackers prüfen"}]
    assert (row["driver"], row["rate"]) == (["ndi:/dev/ttyUSB0: no answer within 1 s"], None)
    assert device(status, "Scanner")["kind"] == "good"


def test_a_probe_out_of_sight_is_no_broken_tracker() -> None:
    unseen = {"name": "line of sight", "fault": "line-of-sight", "value": 4000.0, "verdict": "NOT_VERIFIED"}
    row = device(recorded(devices=[unseen]), "Tracker")
    assert (row["kind"], row["wrong"][0]["text"]) == ("wait", "Probe not seen by the tracker")


def test_what_needs_attention_but_no_alarm_is_no_alarm() -> None:
    """Red is the colour of alarms, everywhere."""
    busy = {"name": "processor time", "fault": "overloaded", "value": 1.4, "verdict": "FAULT"}
    row = device(recorded(devices=[busy]), "Computer")
    assert (row["kind"], row["wrong"][0]["text"]) == ("notice", "This computer is overloaded")


@pytest.mark.parametrize("language", ["en", "de"])
def test_each_gesture_that_is_asked_for_has_its_moving_drawing(language: str) -> None:
    shown = room(told(State.NOT_VERIFIED, None, language, wanted=tuple(Gesture)))["gestures"]
    assert [one["text"] for one in shown] == [translated(gesture.value, language) for gesture in Gesture]
    for one, gesture in zip(shown, Gesture, strict=True):
        text = (DRAWINGS / one["drawing"]).read_text(encoding="utf-8")
        assert DRAWINGS / one["drawing"] == drawing(gesture) == drawn(one["text"], language)
        assert "infinite alternate" in text, "it moves"
        assert "prefers-reduced-motion" in text
        assert "http" not in text.replace('xmlns="http://www.w3.org/2000/svg"', "")
    assert drawn("hop", language) is None
    assert {file.name for file in DRAWINGS.iterdir()} == {one["drawing"] for one in shown}


def test_the_event_can_be_told_as_json() -> None:
    status = json.loads(json.dumps(room(recorded())))
    assert status["bars"][0]["text"] == "as calibrated"
    assert Path(page.__file__).exists()
