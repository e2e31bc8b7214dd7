"""How old what the page shows may be: prompt, grey with its age, lost; in a real Chromium.

The page is a process that is stopped by a signal, or reached over a link that hands out late.
"""

import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from playwright.sync_api import Browser, Page

from probewatch.appliance.types import State
from tests.support.answering import Answering
from tests.support.browser import CHROMIUM, english_left, violations
from tests.support.slow_link import SlowLink
from tests.support.web_page import WebPage
from tests.tools.page.test_looks import Room, drawn, served

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium (chromium)"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # of playwright's own pipes
]
GREEN = "#state[data-lamp=green]"
OLD = "body.old #state-old:visible"
LOST = "#state[data-lamp=red] >> text=This page has lost its cart"


class Place:
    """A cart's page, the link to it, and a browser."""

    def __init__(self, service: Answering, web: WebPage, link: SlowLink, browser: Browser) -> None:
        self.web, self.link = web, link
        self.room = Room(service, f"http://127.0.0.1:{link.port}/", browser)

    @contextmanager
    def stopped(self) -> Iterator[None]:
        """The page's process says nothing."""
        self.web.part.process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self.web.part.process.send_signal(signal.SIGCONT)

    @contextmanager
    def late(self, page: Page, state: State = State.MONITORING, language: str = "en") -> Iterator[None]:
        """The page shows a state a second and a half after it was."""
        self.room.enter(state, page, language)
        self.link.late_s = 1.5
        try:
            page.wait_for_selector("#state-old >> text=/[12] s/")
            page.wait_for_function("() => performance.now() - heard.at_ms < 100")
            yield
        finally:
            self.link.late_s = 0.0


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with (
        served(tmp_path_factory.mktemp("cart")) as (service, web, browser),
        SlowLink(web.address) as link,
    ):
        yield Place(service, web, link, browser)


def ground(page: Page) -> str:
    return str(page.evaluate("getComputedStyle(document.getElementById('state')).backgroundColor"))


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_what_is_old_is_grey_with_its_age(place: Place, scheme: str) -> None:
    """A link that hands out late keeps the pace of four events a second; what they say is old all the same."""
    with place.room.screen(1280, scheme) as page, place.late(page):
        shades = [int(shade) for shade in re.findall(r"\d+", ground(page))[:3]]
        assert max(shades) - min(shades) < 30, "grey"
        assert re.fullmatch(r"As of [12] s ago", page.inner_text("#state-old"))
        assert re.fullmatch(r"… As of [12] s ago · Cart 3", page.title())
        page.wait_for_selector("#picture-why >> text=/^As of [12] s ago$/")
        drawn(page, f"page-old-{scheme}")
        assert violations(page) == []
        place.link.late_s = 4.0
        page.wait_for_selector(LOST)
        page.wait_for_function("() => performance.now() - heard.at_ms < 100 && 'lost' in document.body.dataset")
        assert page.is_hidden("#state-old")


def test_a_page_that_hears_nothing_is_old_then_lost_and_comes_back(place: Place) -> None:
    with place.room.screen(1280) as page:
        place.room.enter(State.MONITORING, page)
        green = ground(page)
        with place.stopped():
            page.wait_for_selector(OLD)
            page.wait_for_selector(LOST)
        page.wait_for_selector(GREEN)
        page.wait_for_selector("#picture-why", state="hidden")
        assert (ground(page), page.title()[0]) == (green, "✓")


def test_an_alarm_stays_red(place: Place) -> None:
    with place.room.screen(1280) as page, place.late(page, State.HALT):
        assert ground(page) == "rgb(200, 30, 30)"


def test_the_age_is_told_in_german(place: Place) -> None:
    with place.room.screen(1280) as page, place.late(page, language="de"):
        assert re.fullmatch(r"Stand: vor [12] s", page.inner_text("#state-old"))
        assert english_left(page) == []
