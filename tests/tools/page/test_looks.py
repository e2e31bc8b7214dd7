"""How the status page looks: ten states on a phone, a tablet and a wall screen, in a real Chromium, compared with kept
pictures.

The page is a process, the service a real socket that tells each state in the words of the real one, the picture comes
over a real feed, the hour from a real alarm log. With PROBEWATCH_LOOKS=keep the pictures are kept anew, in
tests/data/page: look at them before they are committed. With PROBEWATCH_SCREENSHOTS naming a folder they are drawn
there at full size.
"""

import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Page

from probewatch.appliance.core.parameters import MEASURED, QUANTITIES, class_of
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import State
from probewatch.drivers.samples import GreyImage
from tests.support.browser import CHROMIUM, english_left, violations
from tests.support.page_looks import LOOKS, LOST, NO_TIMES, WIDTHS, Room, served

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium (chromium)"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # of playwright's own pipes
]
KEPT = Path(__file__).parents[2] / "data" / "page"
SHRUNK = 4
"""A kept picture has so many pixels fewer a side: letters are grey, the place of everything is to be seen."""
TILE, MOST_UNLIKE = 24, 22.0
"""Pixels of a kept picture, and grey levels by which such a square may differ in the mean: the loss of WebP takes up to
15, what is missing in `test_what_is_missing_is_noticed` 34 and more. More overlooks what is small."""
SETTLES_S = 5.0
"""For the page to look as it did: on a busy computer the browser draws what it was told some frames later."""


@pytest.fixture(scope="module")
def looked_at(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    with served(tmp_path_factory.mktemp("cart")) as (service, web, browser):
        yield Room(service, web.url, browser)


@contextmanager
def whole(page: Page) -> Iterator[None]:
    """On a screen that is high enough for all of it; what is beyond the screen is not drawn yet."""
    size = page.viewport_size
    height = page.evaluate("document.documentElement.scrollHeight")
    page.set_viewport_size({"width": size["width"], "height": height})
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    yield
    page.set_viewport_size(size)


def picture_of(page: Page) -> GreyImage:
    """(h, w, 3) shrunk."""
    with whole(page):
        page.evaluate(NO_TIMES)
        content = np.frombuffer(page.screenshot(animations="disabled"), np.uint8)
    image = cv2.imdecode(content, cv2.IMREAD_COLOR)
    return cv2.resize(image, (image.shape[1] // SHRUNK, image.shape[0] // SHRUNK), interpolation=cv2.INTER_AREA)


def unlike(image: GreyImage, before: GreyImage) -> float:
    """Mean difference in the square that differs most; what is longer differs from black."""
    height = -(-max(len(image), len(before)) // TILE) * TILE
    both = [np.pad(one.astype(float), ((0, height - len(one)), (0, 0), (0, 0))) for one in (image, before)]
    off = cv2.blur(np.abs(both[0] - both[1]).mean(axis=2), (TILE, TILE))
    return float(off.max())


def compared(image: GreyImage, name: str) -> float:
    """With the kept one, which it becomes where that is asked for."""
    file = KEPT / f"{name}.webp"
    if os.environ.get("PROBEWATCH_LOOKS") == "keep":
        KEPT.mkdir(exist_ok=True)
        cv2.imwrite(str(file), image, [cv2.IMWRITE_WEBP_QUALITY, 80])
    return unlike(image, cv2.imread(str(file), cv2.IMREAD_COLOR))


def settled(page: Page, name: str) -> float:
    """The difference to the kept picture, once it is small, or else after a while."""
    end_s = time.monotonic() + SETTLES_S
    while (off := compared(picture_of(page), name)) > MOST_UNLIKE and time.monotonic() < end_s:
        page.wait_for_timeout(200)
    return round(off, 1)


def drawn(page: Page, name: str) -> None:
    """All of a phone's page, the first screen of others."""
    folder = os.environ.get("PROBEWATCH_SCREENSHOTS")
    if folder:
        with whole(page) if page.viewport_size["width"] < 1000 else nullcontext():
            page.screenshot(path=Path(folder) / f"{name}.png")


@pytest.mark.parametrize("width", WIDTHS)
def test_ten_states_look_as_they_did_and_fit_the_screen(looked_at: Room, width: int) -> None:
    """The phone in a dark room."""
    found = {}
    with looked_at.screen(width, "dark" if width == 390 else "light") as page:
        for state in LOOKS:
            looked_at.enter(state, page)
            name = f"{state.value.replace(' ', '-')}-{width}"
            wide = page.evaluate("document.documentElement.scrollWidth")
            assert wide <= width, f"{name} is {wide} px wide"
            drawn(page, f"page-{name}")
            found[name] = settled(page, name)
    print(found)
    others = {name: off for name, off in found.items() if off > MOST_UNLIKE}
    assert others == {}, "look at them; PROBEWATCH_LOOKS=keep keeps them as they are now"


def test_contours_are_drawn_of_what_is_known_now_and_go_at_a_touch(looked_at: Room) -> None:
    def figures() -> list[str]:
        return [one.text_content() or "" for one in page.query_selector_all("#contours text")]

    with looked_at.screen(1280) as page:
        looked_at.enter(State.MONITORING, page)
        page.wait_for_selector("#contours text")
        assert figures() == ["3 mm", "4 mm", "5 mm"]
        drawing = page.eval_on_selector("#contours", "one => one.getScreenCTM().a")
        shown_px, own_px = page.eval_on_selector("#picture", "one => [one.clientWidth, one.width]")
        assert drawing == pytest.approx(shown_px / own_px, rel=0.02), "as large as the picture"
        page.click("#contours-on")
        assert figures() == []
        page.reload()
        looked_at.enter(State.MONITORING, page)
        assert (page.get_attribute("#contours-on", "aria-pressed"), figures()) == ("false", [])
        page.click("#contours-on")
        assert len(figures()) == 3
        looked_at.enter(State.HALT, page)
        page.wait_for_function("document.querySelectorAll('#contours *').length === 0")
        assert page.is_hidden("#contours-on")


@pytest.mark.parametrize("part", ["#state", ".part-picture", "#shown tr:nth-child(3)", "#hour", "#devices", ".acts"])
def test_what_is_missing_is_noticed(looked_at: Room, part: str) -> None:
    with looked_at.screen(1280) as page:
        looked_at.enter(State.MONITORING, page)
        page.evaluate("part => document.querySelector(part).setAttribute('hidden', '')", part)
        off = compared(picture_of(page), "monitoring-1280")
        assert off > MOST_UNLIKE


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_state_keeps_people_out(looked_at: Room, scheme: str) -> None:
    with looked_at.screen(1280, scheme) as page:
        for state in LOOKS:
            looked_at.enter(state, page)
            assert violations(page) == [], state


def test_every_state_is_told_in_german_whole(looked_at: Room) -> None:
    with looked_at.screen(1280) as page:
        for state in LOOKS:
            looked_at.enter(state, page, "de")
            page.wait_for_selector("html[lang=de]")
            left = [text for text in english_left(page) if LOST not in text]
            assert left == [], state
            assert not re.search(r"\d\.\d", page.inner_text("#shown")), "decimals are commas"


def test_an_alarm_interrupts_what_is_read_aloud_and_the_tab_names_it(looked_at: Room) -> None:
    with looked_at.screen(1280) as page:
        looked_at.enter(State.MONITORING, page)
        assert "Calibration verified" in page.inner_text("#spoken[aria-live=polite]")
        assert re.fullmatch(r"✓ Calibration verified · 43 min · Cart 3", page.title())
        looked_at.enter(State.HALT, page)
        assert "Picture is mirrored" in page.inner_text("#spoken-now[role=alert]")
        assert page.inner_text("#spoken") == ""
        assert re.fullmatch(r"✗ Picture is mirrored · 1 min · Cart 3", page.title())
        assert "for 1 min" in page.inner_text("#state-facts")
        assert page.inner_text("#cart") == "Cart 3"
        assert re.fullmatch(r"\d\d:\d\d:\d\d", page.inner_text("#clock"))


def test_a_large_picture_and_a_headline_for_the_room(looked_at: Room) -> None:
    with looked_at.screen(1920) as page:
        looked_at.enter(State.MONITORING, page)
        assert page.evaluate("document.getElementById('picture').clientWidth") > 1000
        letters_px = page.evaluate("parseFloat(getComputedStyle(document.getElementById('state-title')).fontSize)")
        assert letters_px > 80
        assert "earlier" not in page.inner_text("#state-title")
        assert "in part by earlier motion" in page.inner_text("#state-facts")


def test_a_dark_room_is_chosen_and_stays(looked_at: Room) -> None:
    ground = "getComputedStyle(document.body).backgroundColor"
    with looked_at.screen(1280) as page:
        looked_at.enter(State.MONITORING, page)
        light = page.evaluate(ground)
        page.click("#room")
        dark = page.evaluate(ground)
        assert (light != dark, page.get_attribute("#room", "aria-pressed")) == (True, "true")
        page.reload()
        assert page.evaluate(ground) == dark
        page.click("#room")
        assert page.evaluate(ground) == light


def test_every_quantity_has_its_bar_within_its_limit(looked_at: Room) -> None:
    """The value is drawn where it is: of 10.2 % beyond the limit of 5 %, at the end of the track."""
    limits = {name: QUANTITIES[class_of(name)].limit(Limits()) for name in MEASURED}
    with looked_at.screen(1280) as page:
        looked_at.enter(State.RECALIBRATION_REQUESTED, page)
        rows = page.query_selector_all("#shown tr")
        assert len(rows) == 1 + len(limits)
        places = "[...document.querySelectorAll('#shown .value')].map(one => Number(one.getAttribute('x')) + 2)"
        where = page.evaluate(places)
    assert min(where) >= 0
    assert max(where) > 100, "beyond its limit"
    assert sorted(where)[0] < 60 < sorted(where)[-1]


def test_what_does_not_change_is_not_drawn_again(looked_at: Room) -> None:
    """An open tooltip stays and an animation goes on, though the page gets four events a second."""
    parts = ["#shown tr", "#gestures img", "#devices li", "#alarms li"]
    with looked_at.screen(1280) as page:
        looked_at.enter(State.NOT_VERIFIED, page)
        page.evaluate("parts => parts.forEach(part => { document.querySelector(part).mark = true; })", parts)
        before = page.inner_text("#clock")
        page.wait_for_function("text => document.getElementById('clock').textContent !== text", arg=before)
        assert page.evaluate("parts => parts.map(part => document.querySelector(part).mark)", parts) == [True] * 4


def test_the_hour_ends_where_the_service_was_heard_last(looked_at: Room) -> None:
    with looked_at.screen(1280) as page:
        looked_at.enter(State.MONITORING, page)
        hour = r"verified 4\d min · not verified \d min · warning 2 s · alarm \d min · not known .* · 2 alarms began"
        assert re.fullmatch(hour, page.inner_text("#hour-told"))
        looked_at.service.mute = True
        try:
            page.wait_for_selector("#state[data-lamp=red] >> text=No answer from the service")
            assert page.title().startswith("✗ No answer from the service · Cart 3")
            assert "No answer from the service" in page.inner_text("#spoken-now")
            told = page.get_attribute("#hour", "aria-label")
            page.wait_for_timeout(4500)  # longer than a step of the strip
            assert page.get_attribute("#hour", "aria-label") == told
        finally:
            looked_at.service.mute = False
        page.wait_for_selector("#state[data-lamp=green]")
