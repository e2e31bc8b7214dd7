"""The cart's web page in a real Chromium: the room's status, and the whole recalibration.

What is refused, lost and kept on the way is asked over HTTP in tests/tools/page/test_scan.py. One cart, one page, one
browser; each test leaves the recalibration ended. PROBEWATCH_SCREENSHOTS names a folder into which the pictures of
docs/page.md are drawn.
"""

import getpass
import os
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Page

from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.storage.alarm_chain import Event, read_log
from tests.support.browser import CHROMIUM, begins, chromium, english_left, violations
from tests.support.demo_cart import Cart
from tests.support.polling import until
from tests.support.web_page import WebPage

pytestmark = [
    pytest.mark.alone,
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium (chromium)"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # of playwright's own pipes
]
DESK, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
TIMEOUT_MS = 60_000


class Bench:
    """Cart, page and browser. One context is one person with a browser of his own."""

    def __init__(self, cart: Cart, web: WebPage, browser: Browser) -> None:
        self.cart, self.web, self._browser = cart, web, browser
        self._contexts: list[BrowserContext] = []

    def person(self, size: dict[str, int] = DESK, scheme: str = "light", may: bool = False) -> Page:
        """Someone who opens the page; may: with a token."""
        context = self._browser.new_context(viewport=size, color_scheme=scheme)
        self._contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.goto(self.web.url + "recalibrate")
        if may:
            page.fill("#token", self.web.token())
            page.click("#token-form button")
            page.wait_for_selector("#part-token", state="hidden")
        return page

    errors: list[str]

    def leave(self) -> None:
        """A test that failed amid a scan leaves none behind."""
        self.cart.tank.unlink(missing_ok=True)
        if self.cart.status().get("state") == "recalibrating":
            self.web.part.end()
            self.web.start()
        for context in self._contexts:
            context.close()
        self._contexts.clear()


@pytest.fixture(scope="module")
def rooms(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    folder = tmp_path_factory.mktemp("cart")
    with Cart(folder, trusting=True) as cart, WebPage(folder, cart.socket) as web, chromium() as browser:
        cart.wait_for("monitoring", 60)
        yield Bench(cart, web, browser)


@pytest.fixture
def bench(rooms: Bench) -> Iterator[Bench]:
    rooms.errors = []
    yield rooms
    rooms.leave()
    assert rooms.errors == []


def at_the_beginning(page: Page) -> None:
    page.wait_for_selector("body[data-phase]")
    if page.get_attribute("body", "data-phase") in ("done", "ended"):
        page.click("#part-over button")
    page.wait_for_selector("body[data-phase=idle]")


def begun(page: Page, wanted: str = "whole", technician: str = "A. Smith") -> None:
    at_the_beginning(page)
    for name, value in (("probe", "L12-5"), ("preset", "4 cm"), ("technician", technician)):
        page.fill(f"#{name}", value)
    page.select_option("#wanted", wanted)
    begins(page, "scanning")


def views(page: Page) -> int:
    text = page.inner_text("#counts")
    return int(text.split()[0]) if text else 0


def scanned(page: Page, number: int) -> None:
    until(lambda: views(page) >= number, 120, 0.2, lambda: page.inner_text("main"))


def ended(page: Page, button: str = "button:visible:has-text('Give up')") -> None:
    page.click(button)
    page.wait_for_selector("body[data-phase=ended]")


def phase(page: Page, wanted: str) -> None:
    page.wait_for_selector(f"body[data-phase={wanted}]")


def drawn(page: Page, name: str, whole: bool = False) -> None:
    folder = os.environ.get("PROBEWATCH_SCREENSHOTS")
    if folder:
        page.screenshot(path=Path(folder) / f"{name}.png", full_page=whole)


def test_the_whole_procedure_by_the_page_alone(bench: Bench) -> None:
    """The contact opens when it begins, and closes after the service has proved what two people have signed."""
    page = bench.person(may=True)
    drawn(page, "page-choose")
    assert violations(page) == []
    bench.cart.tank.touch()
    begun(page)
    bench.cart.wait_for("recalibrating")
    page.wait_for_selector("#refusals p")
    assert "too few views" in page.inner_text("#refusals")
    onlooker = bench.person(PHONE)
    phase(onlooker, "scanning")
    assert "by A. Smith" in onlooker.inner_text("#picture-title")
    assert onlooker.is_disabled("#finish")
    assert onlooker.is_visible("#part-token")
    scanned(page, 6)
    assert violations(page) == []
    until(lambda: "±" in page.inner_text("#zeta") and not page.query_selector("#refusals p"), 180, 0.2)
    drawn(page, "page-scan")

    def zeta_mm() -> tuple[float, float]:
        """With its sigma, which shrinks with every view."""
        words = page.inner_text("#zeta").split()
        return float(words[1]), float(words[3])

    value_mm, sigma_mm = until(lambda: zeta_mm() if zeta_mm()[1] < 0.5 else None, 60, 0.2)
    assert abs(value_mm - 14) < 4 * sigma_mm
    page.click("text=Scan is complete")
    phase(page, "review")
    page.wait_for_selector("#views li >> nth=19")
    before = page.inner_text("#zeta")
    page.click("#views li:nth-child(3) button")
    page.wait_for_selector("#views li:nth-child(3) >> text=struck out")
    assert page.inner_text("#zeta") != before
    page.click("#views li:nth-child(3) button")
    until(lambda: page.inner_text("#zeta") == before)
    page.click("#views li:nth-child(4) canvas", position={"x": 20, "y": 20})
    until(lambda: page.inner_text("#zeta") != before)
    page.click("#views li:nth-child(4) button")
    page.wait_for_selector("#views li:nth-child(4) >> text=struck out")
    assert violations(page) == []
    drawn(page, "page-review", whole=True)
    until(lambda: not page.query_selector("#refusals p") or page.query_selector("#refusals p"), 5)
    if page.query_selector("#refusals p"):  # one view less may be one too few: scan on, and nothing is lost
        page.click("text=Scan on")
        until(lambda: not page.query_selector("#refusals p"), 120, 0.2)
        page.click("text=Scan is complete")
        phase(page, "review")
    page.wait_for_selector("#compare tr >> nth=7")
    assert "σ" in page.inner_text("#compare")
    page.click("#check-now")
    phase(page, "checking")
    page.wait_for_selector("#checking >> text=from where the scan was made")
    drawn(page, "page-check")
    assert violations(page) == []
    page.click("text=Check is complete")
    phase(page, "review")
    bench.cart.tank.unlink()
    page.fill("#unchecked", "x")
    page.fill("#signer", "A. SMITH")
    page.fill("#role", "technician")
    page.click("#accept")
    page.wait_for_selector("#refused >> text=made it and cannot sign it as well")
    page.fill("#signer", "B. Jones")
    page.fill("#role", "clinical engineer")
    page.fill("#comment", "good scan")
    page.wait_for_selector("#unchecked-part:not([hidden])")
    page.fill("#unchecked", "the tank stands in a frame")
    page.click("#accept")
    phase(page, "done")
    drawn(page, "page-done")
    status = bench.cart.wait_for("monitoring")
    file = Path(status["reference"]["file"])
    assert str(file) in page.inner_text("#over-file")
    said = tomllib.loads(file.read_text())
    assert said["simulated"]
    signed = {
        name: said["provenance"][name]
        for name in ("made_by", "signed_by", "signed_role", "comment", "probe_serial", "check")
    }
    assert signed == {
        "made_by": "A. Smith",
        "signed_by": "B. Jones",
        "signed_role": "clinical engineer",
        "comment": "good scan",
        "probe_serial": "L12-5",
        "check": "not made: the tank stands in a frame",
    }
    until(bench.cart.contact)


def test_the_latency_is_a_step_and_the_water_is_looked_at(bench: Bench) -> None:
    page = bench.person(may=True)
    at_the_beginning(page)
    for name, value in (("probe", "L12-5"), ("preset", "4 cm"), ("technician", "A. Smith"), ("water", "20")):
        page.fill(f"#{name}", value)
    page.select_option("#latency", "1")
    page.click("text=Begin to scan")
    page.wait_for_selector("#refused >> text=depths appear 3.9 % too deep")
    page.fill("#water", "48")
    begins(page, "latency")
    bench.cart.wait_for("recalibrating")
    drawn(page, "page-latency")
    assert violations(page) == []
    page.click("text=Leave it to the scan")
    phase(page, "scanning")
    ended(page)
    bench.cart.wait_for("monitoring", 40)


def reloaded(bench: Bench) -> None:
    with ControlClient(bench.cart.socket) as client:
        client.reload()


def test_a_german_room_reads_the_whole_page_in_german(bench: Bench) -> None:
    """By the configuration; the browser is English. In every phase that a scan of some views reaches."""
    english = bench.cart.config.read_text()
    bench.cart.config.write_text('alarm.language = "de"\n' + english)
    try:
        reloaded(bench)
        page = bench.person(may=True)
        at_the_beginning(page)
        page.wait_for_selector("text=1. Auswählen")
        page.wait_for_selector("text=Scan beginnen")
        assert page.get_attribute("html", "lang") == "de"
        assert violations(page) == []
        assert english_left(page) == []
        drawn(page, "page-choose-de")
        bench.cart.tank.touch()
        for name, value in (("probe", "L12-5"), ("preset", "4 cm"), ("technician", "A. Schmidt"), ("water", "20")):
            page.fill(f"#{name}", value)
        page.select_option("#latency", "1")
        page.click("#begin-form button")
        page.wait_for_selector("#refused >> text=Tiefen erscheinen 3,9 % zu tief")
        assert english_left(page) == []
        page.select_option("#corrected", "1")
        begins(page, "latency")
        assert english_left(page) == []
        page.click("#late-skip")
        phase(page, "scanning")
        page.wait_for_selector("#refusals p")
        scanned(page, 3)
        assert english_left(page) == []
        page.click("#finish")
        phase(page, "review")
        page.wait_for_selector("#views li >> nth=2")
        assert english_left(page) == []
        ended(page, "#part-sign [data-act=reject]")
        page.wait_for_selector("#over >> text=abgelehnt: auf der Seite")
        assert english_left(page) == []
        page.goto(bench.web.url)
        page.wait_for_selector("#alarms li >> nth=1")
        assert english_left(page) == []
    finally:
        bench.cart.tank.unlink(missing_ok=True)
        bench.cart.config.write_text(english)
        reloaded(bench)


def acknowledged(bench: Bench, page: Page) -> None:
    """By a person who has looked on until now: the button asks for a token, which lets silence and lamp test be asked
    for as well; who asked is in the alarm log.
    """
    assert page.is_hidden("#token-form")
    page.click("[data-request=acknowledge]")
    page.fill("#token", "AAAA-AAAA")
    page.click("text=Unlock")
    page.wait_for_selector("#refused >> text=the token is wrong")
    assert not bench.cart.status()["acknowledged"]
    page.fill("#token", bench.web.token())
    page.click("text=Unlock")
    page.wait_for_selector("#done >> text=Acknowledge: done")
    page.wait_for_selector("#state-facts >> text=· acknowledged")
    page.click("[data-request=silence]")
    page.wait_for_selector("#state-facts >> text=sound paused")
    page.click("[data-request=sound]")
    page.wait_for_selector("[data-request=silence]")
    page.click("[data-request=lamp-test]")
    page.wait_for_selector("#state-facts >> text=lamp test")
    entries = read_log(bench.cart.config.parent / "alarms").entries
    asked = {entry.data["do"]: entry.data.get("reason", "") for entry in entries if entry.event == Event.REQUEST}
    for do in ("acknowledge", "pause-audio", "lamp-test"):
        assert f"on the page, with a token of {getpass.getuser()}" in asked[do]


def test_the_status_page_shows_the_state_and_says_when_it_has_lost_the_service_or_itself(bench: Bench) -> None:
    pages = [bench.person(DESK), bench.person(PHONE, "dark")]
    for page in pages:
        page.goto(bench.web.url)
        page.wait_for_selector("#state[data-lamp=green] >> text=Calibration verified")
        page.wait_for_selector("#picture-why", state="hidden")
        page.wait_for_selector("#alarms >> text=recalibrating")
        assert violations(page) == []
    width = pages[1].evaluate("document.documentElement.scrollWidth")
    assert width <= PHONE["width"], "it would have to be moved sideways"
    bench.cart.say("polarity")
    for page in pages:
        page.wait_for_selector("#state[data-lamp=red] >> text=Picture is mirrored")
    assert violations(pages[0]) == []
    acknowledged(bench, pages[0])
    bench.cart.say(None)
    for page in pages:
        page.wait_for_selector("#state[data-lamp=green]")
    bench.cart.daemon.end(kill=True)
    pages[0].wait_for_selector("#state[data-lamp=red] >> text=No answer from the service")
    bench.cart.start_daemon()
    pages[0].wait_for_selector("#state[data-lamp=green]")
    bench.web.part.end(kill=True)
    pages[0].wait_for_selector("#state[data-lamp=red] >> text=This page has lost its cart")
    bench.web.start()
    pages[0].wait_for_selector("#state[data-lamp=green]")


LOCKS = """{
  const ask = WakeLock.prototype.request;
  window.locks = [];
  WakeLock.prototype.request = async function (kind) {
    const lock = await ask.call(this, kind);
    locks.push(lock);
    return lock;
  };
}"""
"""Notes what the browser has granted."""


@pytest.mark.parametrize("part", ["", "recalibrate"])
def test_a_tablet_that_shows_the_page_does_not_fall_asleep(bench: Bench, part: str) -> None:
    page = bench.person()
    page.add_init_script(LOCKS)
    page.goto(bench.web.url + part)
    page.wait_for_function("locks.some(lock => lock.type === 'screen' && !lock.released)")
