"""What a client sends, on its way into the alarm log and the status."""

import json
import pwd
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest

from probewatch.appliance.service.control.allowance import BURST
from probewatch.appliance.service.control.deadline_worker import DeadlineWorker
from probewatch.appliance.service.control.hold import Hold
from probewatch.appliance.service.control.recalibration import Recalibration, Wanted
from probewatch.appliance.service.control.requests import Requests, ServiceActions
from probewatch.appliance.service.control.rights import user_ids
from probewatch.appliance.service.control.server import ControlRefused, Peer
from probewatch.appliance.storage.alarm_log import ENTRIES_A_SEGMENT, SEGMENTS_KEPT
from probewatch.appliance.supervision.annunciator import Annunciator
from probewatch.appliance.supervision.supervisor import Request
from probewatch.appliance.types import AlarmState, Fault, State

ANNA = Peer(pid=7, uid=0)
VIEWER = Peer(pid=9, uid=4_000_001)
NOBODY_KNOWS = Peer(pid=8, uid=4_000_000)
DAY_NS = 86_400 * 10**9


class Desk:
    """Everything that a request may move, without a service behind it."""

    def __init__(self, onlookers: frozenset[int] = frozenset({VIEWER.uid})) -> None:
        self.noted: list[dict[str, Any]] = []
        self.wanted: list[Wanted] = []
        self.annunciator = Annunciator()
        self.now_ns = 0
        self.alarm = AlarmState(State.HALT, 0, Fault.SCALE, "Picture scale has changed", False, None)
        nothing = cast(Callable[..., Any], lambda *_: None)
        take = self.wanted.append
        self.hold = Hold(lambda: None, lambda *_, **__: None, lambda _: True)
        recalibration = SimpleNamespace(propose=take, end=take, begin=lambda: None, abort=lambda: None)
        self.requests = Requests(
            ServiceActions(
                ask=lambda request: self.alarm if request is Request.ACKNOWLEDGE else None,
                status=lambda _: {},
                clear_bump=nothing,
                reload=nothing,
                recalibration=cast(Recalibration, recalibration),
                hold=self.hold,
                annunciator=self.annunciator,
                worker=DeadlineWorker(),
                now_ns=lambda: self.now_ns,
                note=lambda event, **data: self.noted.append(data),
                onlookers=onlookers,
            )
        )


@pytest.mark.parametrize(
    "reason", ["\ud800\ud800\ud800", "a\nb\x1b[2J", "x" * 4000, [[["deep"]]], {"a": float("nan")}, 7.5e300]
)
def test_whatever_a_client_gives_as_a_reason_becomes_one_plain_line(reason: object) -> None:
    desk = Desk()
    desk.requests.answer("audio-off", {"reason": reason}, ANNA)
    desk.requests.answer("lamp-test", {"reason": reason, "file": reason, "seconds": reason}, ANNA)
    for said in (text for noted in desk.noted for name, text in noted.items() if name not in ("do", "who")):
        assert said.isprintable()
        assert len(said) <= 200
        said.encode()
    json.dumps(desk.noted, allow_nan=False)


def test_what_was_acknowledged_is_answered_and_noted_and_cannot_be_made_up() -> None:
    desk = Desk()
    answer = desk.requests.answer("acknowledge", {"acknowledged": "nothing"}, ANNA)
    assert answer["acknowledged"] == "halt: Picture scale has changed"
    assert desk.noted[-1]["acknowledged"] == "halt: Picture scale has changed"
    desk.requests.answer("lamp-test", {"acknowledged": "halt: made up"}, ANNA)
    assert "acknowledged" not in desk.noted[-1]


@pytest.mark.parametrize(
    ("do", "body", "ignored"),
    [
        ("pause-audio", {"second": 30}, ("second",)),
        ("begin-recalibration", {"hold": 5}, ("hold",)),
        ("end-recalibration", {"file": "/a.toml", "comfirm": "x"}, ("comfirm",)),
        ("acknowledge", {"reasn": "seen"}, ("reasn",)),
        ("status", {"file": "/a.toml"}, ("file",)),
        ("lamp-test", {"reason": "morning"}, None),
        ("pause-audio", {"seconds": 30, "reason": "scan"}, None),
        ("propose-calibration", {"number": 2, "confirm": ""}, None),
    ],
)
def test_a_field_that_means_nothing_to_the_request_is_named_in_the_reply(do, body, ignored) -> None:
    answer = Desk().requests.answer(do, {"v": 1, "do": do, **body}, ANNA)
    assert answer.get("ignored") == ignored


def test_a_viewer_may_ask_for_the_status_and_nothing_else() -> None:
    desk = Desk()
    assert desk.requests.answer("status", {}, VIEWER) == {"status": {}}
    for name in set(desk.requests.names) - {"status"}:
        with pytest.raises(ControlRefused, match="may ask for the status and nothing else"):
            desk.requests.answer(name, {"number": 1, "reason": "x"}, VIEWER)
    assert (desk.noted, desk.wanted) == ([], [])


def test_who_is_a_viewer() -> None:
    root = pwd.getpwuid(0).pw_name
    assert user_ids((root, "no-such-user-here")) == {0}


@pytest.mark.parametrize("file", ["", "\0", "a\nb", "\ud800", 7, None, ["x"]])
def test_what_is_no_name_of_a_file_is_refused(file: object) -> None:
    with pytest.raises(ControlRefused, match="must name a calibration file, or number an"):
        Desk().requests.answer("propose-calibration", {"file": file}, ANNA)


@pytest.mark.parametrize("number", ["1", 1.5, True, None, [1]])
def test_what_is_no_number_of_a_reference_is_refused(number: object) -> None:
    with pytest.raises(ControlRefused, match="number must be that of an earlier reference"):
        Desk().requests.answer("propose-calibration", {"number": number}, ANNA)


def test_the_first_request_after_the_start_knows_who_asks() -> None:
    desk = Desk()
    desk.requests.answer("begin-recalibration", {"hold_s": 20}, ANNA)
    told = desk.hold.fields(ANNA, 0, recalibrating=True, monitoring=False)
    assert told is not None
    assert told["who"] == desk.noted[0]["who"] == "root, process 7"


def test_a_change_carries_what_was_confirmed_and_who_asked() -> None:
    desk = Desk()
    desk.requests.answer("end-recalibration", {"number": 3, "confirm": "moved by 30 mm"}, ANNA)
    (wanted,) = desk.wanted
    assert (wanted.number, wanted.file, wanted.confirm, wanted.who) == (3, None, "moved by 30 mm", "root, process 7")
    assert desk.noted[0]["number"] == "3"
    with pytest.raises(ControlRefused, match="no file beside it"):
        desk.requests.answer("end-recalibration", {"number": 3, "file": "/x.toml"}, ANNA)


@pytest.mark.parametrize("seconds", [float("nan"), float("inf"), -1, 0, 121, 10**400, True, "30", None, [30]])
def test_a_pause_that_is_no_number_of_seconds_is_refused(seconds: object) -> None:
    with pytest.raises(ControlRefused, match=r"seconds must be a number|lasts from 1 to 120 s"):
        Desk().requests.answer("pause-audio", {"seconds": seconds}, ANNA)


def granted(desk: Desk, do: str, who: Peer, **body: object) -> bool:
    try:
        desk.requests.answer(do, body, who)
    except ControlRefused:
        return False
    return True


def test_whatever_is_granted_is_noted_with_who_asked() -> None:
    desk = Desk()
    for who in (ANNA, NOBODY_KNOWS):
        desk.requests.answer("lamp-test", {}, who)
        desk.requests.answer("status", {}, who)
    assert [noted["do"] for noted in desk.noted] == ["lamp-test"] * 2
    assert [noted["who"] for noted in desk.noted] == ["root, process 7", "uid 4000000, process 8"]
    with pytest.raises(ControlRefused, match="is not a request of this service"):
        desk.requests.answer("\ud800", {}, ANNA)


def test_a_user_who_asks_too_often_is_told_how_long_to_wait_and_keeps_no_other_out() -> None:
    desk = Desk()
    assert [granted(desk, "lamp-test", ANNA) for _ in range(BURST + 1)] == [True] * BURST + [False]
    with pytest.raises(ControlRefused, match=r"root has asked too often \(30 at once, then one in 60 s\); wait 60 s"):
        desk.requests.answer("begin-recalibration", {}, ANNA)
    assert granted(desk, "begin-recalibration", NOBODY_KNOWS)
    desk.now_ns = 59 * 10**9
    with pytest.raises(ControlRefused, match="wait 1 s"):
        desk.requests.answer("lamp-test", {}, ANNA)
    desk.now_ns = 60 * 10**9
    assert [granted(desk, "lamp-test", ANNA) for _ in range(2)] == [True, False]
    assert all(granted(desk, do, ANNA) for do in ("status", "acknowledge", "audio-on")), "what calms nothing is free"


def test_who_asks_for_a_whole_day_leaves_the_history_in_the_log() -> None:
    """Twenty requests a second, each kind that changes something in turn; a recalibration changes states as well."""
    desk, kinds = Desk(), ("begin-recalibration", "abort-recalibration", "lamp-test", "pause-audio", "audio-on")
    for number in range(20 * 3600):
        desk.now_ns = number * DAY_NS // (20 * 3600)
        granted(desk, kinds[number % len(kinds)], ANNA)
    assert len(desk.noted) < ENTRIES_A_SEGMENT * SEGMENTS_KEPT / 10


def test_what_ends_no_silence_is_not_noted() -> None:
    desk = Desk()
    for _ in range(100):
        desk.requests.answer("audio-on", {}, ANNA)
    desk.requests.answer("audio-off", {"reason": "room empty"}, ANNA)
    for _ in range(100):
        desk.requests.answer("audio-on", {}, ANNA)
    assert [noted["do"] for noted in desk.noted] == ["audio-off", "audio-on"]
