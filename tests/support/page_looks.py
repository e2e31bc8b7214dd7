"""Ten states of a service for the status page, and a room with its browser in which they are shown."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Page

from probewatch.appliance.core.quality.gesture import Gesture
from probewatch.appliance.service.control.status import alarm_fields
from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.appliance.supervision.alarms import SIGNALS
from probewatch.appliance.types import AlarmState, Fault, State
from probewatch.drivers.samples import Frame, GreyImage, Sample, Stamp
from probewatch.drivers.twins.scene.world import WorldSettings
from tests.support.answering import Answering, recorded
from tests.support.browser import chromium
from tests.support.live_scan import Scan
from tests.support.sessions import kept
from tests.support.web_page import WebPage

WIDTHS = {390: 844, 1280: 800, 1920: 1080}
NO_TIMES = """() => {
  document.getElementById("clock").textContent = "12:00:00";
  for (const one of document.querySelectorAll("#alarms .soft"))
    one.textContent = one.textContent.replace(/[0-9-]{10}/, "2026-01-01").replace(/[0-9]+:[0-9]+/, "12:00");
}"""
SECOND_NS = 1_000_000_000
LOST = (
    "no reply to BX within 1.0 s; 17 bytes of garbage were read: /dev/serial/by-id/"
    "usb-NDI_Northern_Digital_Inc._Polaris_Vega_ST_P9-00123456-if00-port0: could not be opened"
)
"""As long as drivers say it, with words that no line breaks at."""


def checks(**wrong: float) -> list[dict[str, Any]]:
    """The recorded ones, with other values of some."""
    found = recorded()["checks"]
    for check in found:
        for name, value in wrong.items():
            if check["name"] == name.replace("_", "-"):
                check |= {"value": value, "ratio": abs(value) / check["limit"], "verdict": "FAULT"}
    return found


def unknown() -> list[dict[str, Any]]:
    """Before anything was measured."""
    nothing = {"value": None, "sigma": None, "ratio": None, "verdict": "NOT_VERIFIED", "shown_age_s": None}
    return [check | nothing for check in checks()]


def half() -> list[dict[str, Any]]:
    """Three are shown, the others not yet."""
    found = checks()
    for check in found[3:10]:
        check |= {"sigma": check["limit"], "verdict": "NOT_VERIFIED", "shown": "missing", "shown_age_s": None}
    return found


def carried() -> list[dict[str, Any]]:
    """Some only by earlier motion."""
    found = checks()
    for check in found[6:9]:
        check |= {"shown": "carried", "carried": True, "shown_age_s": 34.0, "max_age_s": 120.0}
    return found


def gone(*names: str) -> list[dict[str, Any]]:
    """The recorded devices, these of them lost."""
    found = recorded()["devices"]
    for check in found:
        if check["name"] in names:
            check |= {"value": 92_000.0, "verdict": "FAULT"}
    return found


def bounded() -> dict[str, Any]:
    """The recorded error of a point, with bounds that grow away from a place near the face."""
    point: dict[str, Any] = recorded()["point"]
    rows = [[2.0 + 2.2 * (0.8 * (x - 2) ** 2 + (y - 1) ** 2) ** 0.7 / 4 for x in range(5)] for y in range(5)]
    return {**point, "region": {"left": 0.0, "right": 1.0, "top": 0.0, "bottom": 1.0}, "region_mm": rows}


LOOKS: dict[State, dict[str, Any]] = {
    State.SELF_TEST: {"checks": unknown(), "since": 1},
    State.WAITING: {
        "checks": unknown(),
        "devices": gone("video presence", "tracker presence"),
        "since": 40,
        "fps": {"video": 0.0, "tracker": 0.0},
    },
    State.NOT_VERIFIED: {
        "checks": half(),
        "since": 9,
        "wanted": tuple(Gesture),
        "reason": "not shown yet: rotation-elevational, scale-lateral, scale-axial, offset-lateral, latency",
    },
    State.MONITORING: {
        "checks": carried(),
        "point": bounded(),
        "since": 2580,
        "text": "SIMULATED · Calibration verified · {earlier}",
    },
    State.WARNING: {"checks": checks(latency=101.3), "fault": Fault.LATENCY, "since": 2},
    State.HALT: {
        "checks": checks(polarity=1.0),
        "fault": Fault.POLARITY,
        "since": 75,
        "reason": "picture and tracker disagree: polarity 2.0 × its limit",
    },
    State.RECALIBRATION_REQUESTED: {
        "checks": checks(scale_axial=9.7, scale_lateral=10.2),
        "fault": Fault.SCALE,
        "since": 4000,
        "acknowledged": True,
        "audio": {"mode": "acknowledged", "left_s": None, "reason": "", "lamp_test": False},
    },
    State.RECALIBRATING: {"checks": unknown(), "since": 200},
    State.DEVICE_LOST: {
        "checks": unknown(),
        "devices": gone("tracker presence"),
        "fault": Fault.TRACKER_LOST,
        "since": 92,
        "lost": {
            "tracker ndi:/dev/serial/by-id/usb-NDI_Northern_Digital_Inc._Polaris_Vega_ST_P9-00123456-if00-port0": LOST
        },
        "audio": {"mode": "paused", "left_s": 87.0, "reason": "", "lamp_test": False},
    },
    State.INTERNAL_FAULT: {
        "checks": unknown(),
        "devices": gone("estimator presence"),
        "fault": Fault.ESTIMATOR_SILENT,
        "since": 3,
    },
}
"""Fields of the status that the service sends in each state; its texts are made from them."""
CONFIGURATION = """
video.url = "sim:{folder}/scanner"
tracker.url = "ndi:{folder}/polaris"
output = [{{ url = "relay:{folder}/board" }}]
calibration.file = "{folder}/probe.toml"
control.socket = "{folder}/control"
alarm.folder = "{folder}/alarms"
"""
"""Beside the socket, where the page of a test finds it."""
EARLIER = {"en": "in part by earlier motion", "de": "teils durch frühere Bewegung"}


def told(state: State, language: str = "en") -> dict[str, Any]:
    """The whole status."""
    look = dict(LOOKS[state])
    alarm = AlarmState(
        state,
        -look.pop("since") * SECOND_NS,
        look.pop("fault", None),
        look.pop("reason", SIGNALS[state].text),
        state is State.MONITORING,
        -12 * SECOND_NS if state is State.MONITORING else None,
        state if state in (State.HALT, State.RECALIBRATION_REQUESTED) else None,
        acknowledged=look.pop("acknowledged", False),
    )
    words = alarm_fields(0, alarm, language, ["sim:x"], look.pop("wanted", ()))
    text = look.pop("text", None)
    if text is not None:
        words["text"] = f"{words['text']} · {EARLIER[language]}"
    return recorded(**words, language=language, **look)


def hour_of(folder: Path) -> None:
    """Written as a service writes it: verified, a warning of two seconds, a halt, a restart."""
    log = AlarmLog(folder)
    for minutes, event, state in (
        (52, "started", ""),
        (52, "state", "not verified"),
        (50, "state", "monitoring"),
        (30, "state", "warning"),
        (29.96, "state", "monitoring"),
        (20, "state", "halt"),
        (16, "state", "monitoring"),
        (10, "stopped", ""),
        (7, "started", ""),
        (7, "state", "not verified"),
        (5, "state", "monitoring"),
    ):
        utc = datetime.now(UTC) - timedelta(minutes=minutes)
        log.append(utc, 0, event, {"state": state, "reason": "Calibration verified", "fault": None}, None)


def cart_of(folder: Path) -> Path:
    """A cart's configuration and its last hour, in that folder."""
    hour_of(folder / "alarms")
    (folder / "probewatch.toml").write_text(CONFIGURATION.format(folder=folder))
    return folder


class Feed:
    """Sends one picture again and again, without a reference, which no page asks for."""

    def __init__(self, path: Path) -> None:
        self.feed, self.reference = path, None
        world = kept(3, settings=WorldSettings())
        self._image: GreyImage = world.frame(1.0, 30, frozenset())

    def samples(self) -> Iterator[Sample]:
        """Ten a second, as the page takes them of a scanner."""
        for number in range(1_000_000):
            time.sleep(0.1)
            yield Frame(Stamp(time.monotonic_ns(), 0), 3 * number, self._image)


class Room:
    """Service, page and browser."""

    def __init__(self, service: Answering, url: str, browser: Browser) -> None:
        self.service, self._url, self._browser = service, url, browser
        self.errors: list[str] = []

    @contextmanager
    def screen(self, width: int, scheme: str = "light") -> Iterator[Page]:
        """A browser of that width."""
        size = {"width": width, "height": WIDTHS[width]}
        context = self._browser.new_context(viewport=size, color_scheme=scheme, reduced_motion="reduce")
        page = context.new_page()
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda line: self.errors.append(line.text) if line.type == "error" else None)
        page.goto(self._url)
        yield page
        context.close()
        assert self.errors == []

    def enter(self, state: State, page: Page, language: str = "en") -> None:
        """Until the page shows it, with its picture."""
        status = told(state, language)
        self.service.tell = lambda: status | {"t_ns": time.monotonic_ns()}
        headline = status["text"].split(" · ")[1]
        page.wait_for_function("text => document.getElementById('state-title').textContent === text", arg=headline)
        page.wait_for_selector("#picture-why", state="hidden")
        page.wait_for_selector("#hour rect")
        page.evaluate("Promise.all([...document.images].map(one => one.decode()))")


@contextmanager
def served(folder: Path) -> Iterator[tuple[Answering, WebPage, Browser]]:
    """Service and page of a cart in that folder, and a browser."""
    feed = Feed(cart_of(folder) / "feed")
    with (
        Answering(folder / "control") as service,
        Scan(feed, feed.samples()),
        WebPage(folder, service.path) as web,
        chromium() as browser,
    ):
        yield service, web, browser
