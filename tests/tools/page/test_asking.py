"""Acknowledge, silence, sound and lamp test by HTTP: with a token alone, and told to the service with whose it is."""

import getpass
from collections.abc import Iterator
from typing import Any

import pytest

from probewatch.appliance.service.control.server import ControlRefused, Peer
from tests.support.answering import Answers, recorded
from tests.support.web_page import WebPage
from tests.tools.page.test_page import asked, event, redeemed_key


class Granting(Answers):
    """Grants every request; requests: all but those for the status. refuse: why it declines the next."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.requests: list[dict[str, Any]] = []
        self.refuse = ""

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        if do == "status":
            return {"status": recorded()}
        self.requests.append({"do": do} | {key: request[key] for key in ("seconds", "reason") if key in request})
        if self.refuse:
            raise ControlRefused(self.refuse)
        return {}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Granting]:
    with Granting(tmp_path_factory.mktemp("cart") / "control") as service:
        yield service


@pytest.fixture(scope="module")
def web(service: Granting, tmp_path_factory: pytest.TempPathFactory) -> Iterator[WebPage]:
    with WebPage(tmp_path_factory.mktemp("page"), service.path) as web:
        yield web


@pytest.fixture(scope="module")
def key(web: WebPage) -> dict[str, str]:
    return redeemed_key(web)


WHO = f"on the page, with a token of {getpass.getuser()}"
ASKED = {
    "acknowledge": {"do": "acknowledge", "reason": WHO},
    "silence": {"do": "pause-audio", "seconds": 120.0, "reason": WHO},
    "sound": {"do": "audio-on"},
    "lamp-test": {"do": "lamp-test", "reason": WHO},
}


@pytest.mark.parametrize("what", ASKED)
def test_with_a_token_the_service_is_asked(web: WebPage, service: Granting, key: dict[str, str], what: str) -> None:
    service.requests.clear()
    answer = asked(web, "POST", f"/request/{what}", {}, **key)
    assert (answer.status, answer.json, service.requests) == (200, {"ok": True}, [ASKED[what]])


@pytest.mark.parametrize("what", ASKED)
@pytest.mark.parametrize(
    "headers", [{}, {"Cookie": "probewatch=guessed"}, {"Origin": "http://evil.example"}, {"Host": "evil.example"}]
)
def test_without_one_or_from_another_page_nothing_is_asked(
    web: WebPage, service: Granting, headers: dict[str, str], what: str
) -> None:
    service.requests.clear()
    answer = asked(web, "POST", f"/request/{what}", {}, **headers)
    assert (answer.status, answer.json["ok"], service.requests) == (403, False, [])


def test_another_page_may_not_use_the_cookie(web: WebPage, service: Granting, key: dict[str, str]) -> None:
    service.requests.clear()
    foreign = {"Origin": "http://evil.example"}
    assert asked(web, "POST", "/request/acknowledge", {}, **key, **foreign).status == 403
    assert asked(web, "GET", "/request/acknowledge", None, **key).status == 405
    assert service.requests == []


def test_nothing_else_can_be_asked(web: WebPage, service: Granting, key: dict[str, str]) -> None:
    service.requests.clear()
    for what in ("reload", "clear-bump", "audio-off", "begin-recalibration", "x"):
        assert asked(web, "POST", f"/request/{what}", {}, **key).status == 404
    assert service.requests == []


def test_what_the_service_declines_is_told(web: WebPage, service: Granting, key: dict[str, str]) -> None:
    service.refuse = "not possible while monitoring"
    answer = asked(web, "POST", "/request/acknowledge", {}, **key)
    service.refuse = ""
    assert (answer.status, answer.json["error"]) == (409, "not possible while monitoring")


def test_the_event_names_the_cart_and_tells_its_clock(web: WebPage) -> None:
    told = event(web)
    assert told["cart"] == "Cart 3"
    assert told["clock"][10] == "T"
    assert told["room"]["headline"] == "Calibration verified"
    assert set(told["alarms"]) == {"entries", "hour", "trouble"}
