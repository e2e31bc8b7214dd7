"""A scan by what the page's browsers ask over HTTP: who may do what, and what each of them is told."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from tests.support.live_scan import RecalibratingService, Scan
from tests.support.polling import until
from tests.support.web_page import WebPage
from tests.tools.page.test_page import Answer, asked, event, redeemed_key
from tests.tools.recalibration.test_session import truth, wires


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RecalibratingService]:
    with RecalibratingService(tmp_path_factory.mktemp("cart"), truth()) as service:
        yield service


@pytest.fixture(scope="module")
def web(service: RecalibratingService, tmp_path_factory: pytest.TempPathFactory) -> Iterator[WebPage]:
    with WebPage(tmp_path_factory.mktemp("page"), service.path) as web:
        yield web


class Browser:
    """One that has redeemed a token."""

    def __init__(self, web: WebPage) -> None:
        self._web = web
        self._key = redeemed_key(web)

    def ask(self, what: str, **body: Any) -> Answer:
        return asked(self._web, "POST", f"/recalibration/{what}", body, **self._key)

    @property
    def told(self) -> dict[str, Any]:
        """Of the recalibration."""
        return dict(event(self._web, **self._key)["recalibration"])

    @property
    def views(self) -> int:
        scan = self.told["scan"]
        return len(scan["views"]) if scan else 0


BEGIN = {"probe": "L12-5", "preset": "4 cm", "technician": "A. Smith", "wanted": "whole"}


@contextmanager
def scanning(service: RecalibratingService, web: WebPage, pictures: int) -> Iterator[Browser]:
    """A browser that has begun a scan of so many pictures, which is ended afterwards."""
    browser = Browser(web)
    with Scan(service, wires(pictures)):
        begun = until(lambda: (answer := browser.ask("begin", **BEGIN)).status == 200 and answer)
        assert begun.json["ok"]
        try:
            yield browser
        finally:
            browser.ask("reject")
            browser.ask("dismiss")


@pytest.fixture
def browser(service: RecalibratingService, web: WebPage) -> Iterator[Browser]:
    with scanning(service, web, 700) as browser:
        yield browser


def test_a_reload_and_a_second_technician_find_the_scan_as_it_is(
    browser: Browser, service: RecalibratingService, web: WebPage
) -> None:
    until(lambda: browser.views >= 2, 60)
    onlooker, second = event(web), Browser(web)
    for told in (browser.told, onlooker["recalibration"], second.told):
        assert (told["phase"], told["technician"]) == ("scanning", "A. Smith")
    assert onlooker["visitor"] is None
    assert asked(web, "POST", "/recalibration/finish", {}).status == 403
    refused = second.ask("begin", **BEGIN | {"technician": "C"})
    assert (refused.status, "A. Smith recalibrates already" in refused.json["error"]) == (409, True)
    assert service.state == "recalibrating"
    second.ask("reject")
    assert browser.told["phase"] == event(web)["recalibration"]["phase"] == "ended"
    assert service.asked[-1] == "abort-recalibration"


def test_a_scan_that_shows_too_little_cannot_be_taken(service: RecalibratingService, web: WebPage) -> None:
    with scanning(service, web, 120) as browser:
        until(lambda: browser.views >= 2, 60)
        assert browser.ask("finish").status == 200
        told = browser.told
        assert told["phase"] == "review"
        assert "too few views" in [refusal["reason"] for refusal in told["scan"]["refusals"]]
        answer = browser.ask("accept", name="B", role="r")
        assert answer.status == 409
        assert "usable views of the crossing" in answer.json["error"] or "no view" in answer.json["error"]
        answer = browser.ask("strike", index=99)
        assert (answer.status, "there is no view 100" in answer.json["error"]) == (409, True)
        assert browser.ask("correct", index=0, column=-5, row=1).status == 409
        assert (service.state, service.taken) == ("recalibrating", None)


@pytest.mark.parametrize("state", ["device lost", ""])
def test_what_is_lost_in_the_middle_loses_no_view(browser: Browser, service: RecalibratingService, state: str) -> None:
    """A device, or the service, which has begun anew when it answers again."""
    until(lambda: browser.views >= 1, 60)
    asked_before = service.asked.count("begin-recalibration")
    if state:
        service.state, service.refuse = state, True
    else:
        service.mute = True
    until(lambda: browser.told["trouble"], 20)
    kept = browser.views
    assert kept
    service.state, service.refuse, service.mute = "not verified", False, False
    until(lambda: service.asked.count("begin-recalibration") > asked_before, 20)
    until(lambda: browser.views > kept and not browser.told["trouble"], 60)
    assert service.state == "recalibrating"


def test_a_token_is_good_once_and_guessing_is_soon_over(service: RecalibratingService, web: WebPage) -> None:
    """The last, as it locks the page for a minute."""

    def redeemed(token: str) -> Answer:
        return asked(web, "POST", "/token", {"token": token})

    state, token = service.state, web.token()
    assert asked(web, "POST", "/recalibration/begin", BEGIN).status == 403
    wrong = redeemed("AAAA-AAAA")
    assert (wrong.status, "the token is wrong, was used, or is too old" in wrong.json["error"]) == (403, True)
    assert redeemed(token.lower().replace("-", " ")).status == 200
    assert redeemed(token).status == 403
    for _ in range(9):
        redeemed("wrong")
    assert redeemed(web.token()).status == 429
    assert service.state == state
