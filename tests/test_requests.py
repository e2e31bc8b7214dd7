"""What a client sends, on its way into the alarm log and the status."""

import json
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest

from appliance.service.control import ControlRefused
from appliance.service.estimator_host import EstimatorHost
from appliance.service.recalibration import Recalibration
from appliance.service.requests import Hands, Requests
from appliance.supervision.annunciator import Annunciator
from appliance.supervision.supervisor import Durations, Supervisor


class Desk:
    """Everything that a request may move, without a service behind it."""

    def __init__(self) -> None:
        self.noted: list[dict[str, Any]] = []
        self.annunciator = Annunciator()
        self.now_ns = 0
        nothing = cast(Callable[..., Any], lambda *_: None)
        estimator = cast(EstimatorHost, SimpleNamespace(reference=None))
        recalibration = Recalibration(Supervisor(Durations()), estimator, nothing)
        self.requests = Requests(
            Hands(
                ask=nothing,
                status=dict,
                clear_bump=nothing,
                reload=nothing,
                recalibration=recalibration,
                annunciator=self.annunciator,
                now_ns=lambda: self.now_ns,
                note=lambda event, **data: self.noted.append(data),
            )
        )


@pytest.mark.parametrize(
    "reason", ["\ud800\ud800\ud800", "a\nb\x1b[2J", "x" * 4000, [[["deep"]]], {"a": float("nan")}, 7.5e300]
)
def test_whatever_a_client_gives_as_a_reason_becomes_one_plain_line(reason: object) -> None:
    desk = Desk()
    desk.requests.answer("audio-off", {"reason": reason}, "anna, process 7")
    desk.requests.answer("lamp-test", {"reason": reason, "file": reason, "seconds": reason}, "anna, process 7")
    for said in (text for noted in desk.noted for name, text in noted.items() if name not in ("do", "who")):
        assert said.isprintable()
        assert len(said) <= 200
        said.encode()
    json.dumps(desk.noted, allow_nan=False)


@pytest.mark.parametrize("file", ["", "\0", "a\nb", "\ud800", 7, None, ["x"]])
def test_what_is_no_name_of_a_file_is_refused(file: object) -> None:
    with pytest.raises(ControlRefused, match="must name a calibration file"):
        Desk().requests.answer("propose-calibration", {"file": file}, "anna, process 7")


@pytest.mark.parametrize("seconds", [float("nan"), float("inf"), -1, 0, 121, 10**400, True, "30", None, [30]])
def test_a_pause_that_is_no_number_of_seconds_is_refused(seconds: object) -> None:
    with pytest.raises(ControlRefused):
        Desk().requests.answer("pause-audio", {"seconds": seconds}, "anna, process 7")


def test_each_kind_is_noted_once_a_second_at_most() -> None:
    desk = Desk()
    for at_ns in (0, 10**8, 10**9):
        desk.now_ns = at_ns
        desk.requests.answer("lamp-test", {}, "anna, process 7")
        desk.requests.answer("status", {}, "anna, process 7")
    assert desk.noted == [{"do": "lamp-test", "who": "anna, process 7"}] * 2
    with pytest.raises(ControlRefused, match="is no request of this service"):
        desk.requests.answer("\ud800", {}, "anna, process 7")
