"""The first day of a cart, as docs/first-day.md has it: from a package that nobody configured to MONITORING, by the
documented commands alone, typed at a real terminal, or from the scan on by what stands on the page, in a real Chromium.
PROBEWATCH_SCREENSHOTS: tests.support.drawn.
"""

import os
import re
import signal
import subprocess
import time
import tomllib
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from playwright.sync_api import Page

from probewatch.appliance.configuration.config import load_config
from probewatch.tools.shared.configuration_text import template
from probewatch.tools.simulators.whole_cart import Event, status_of
from tests.support.browser import CHROMIUM, begins, chromium
from tests.support.demo_cart import PROBEWATCH
from tests.support.drawn import draw_terminal, draws
from tests.support.person import Person
from tests.support.polling import until
from tests.support.web_page import WebPage

LONGEST_S = 600.0
"""What the whole day may take."""


class Day:
    """A simulated cart whose configuration is the package's. urls: what its devices' first lines name."""

    def __init__(self, folder: Path, left: ExitStack) -> None:
        self.file, self.tank, self._left = folder / "cart.toml", folder / "parts/tank", left
        self.began_s = time.monotonic()
        arguments = ["--unconfigured", "--write", str(self.file), "--folder", str(folder / "parts"), "--seed", "3"]
        devices = self._started("simulate", "cart", *arguments)
        assert devices.stderr is not None
        self.urls: dict[str, str] = {}
        while "contact" not in self.urls or "socket" not in self.urls:
            name, _, rest = devices.stderr.readline().partition(": ")
            self.urls[name] = rest.strip()
        self.socket = Path(self.urls["socket"])
        self.service = self.serve()

    def _started(self, *arguments: str) -> "subprocess.Popen[str]":
        command = [str(PROBEWATCH), *arguments]
        program = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        self._left.callback(program.communicate)
        self._left.callback(program.send_signal, signal.SIGTERM)
        return program

    def serve(self) -> "subprocess.Popen[bytes]":
        """As the unit starts it, and again after every end."""
        service = subprocess.Popen(
            [str(PROBEWATCH), "run", "--config", str(self.file)], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
        )
        self._left.callback(service.wait)
        self._left.callback(service.terminate)
        return service

    def status(self) -> Event:
        return status_of(self.socket)

    def waits_for_a_calibration(self) -> None:
        """The devices are there, and nothing is verified."""

        def look() -> bool:
            told = self.status()
            return told.get("state") == "not verified" and "no calibration yet" in (told["reference_waits"] or "")

        until(look, 60, 0.2, self.status)

    def configure(self) -> None:
        """Every question answered, with defaults where there are any; the service starts by itself."""
        with Person("configure", self.file) as person:
            person.sees("the scanner's picture")
            person.types(self.urls["video"])
            assert "640 x 480 pixels" in person.sees("The tracker: a number")
            person.sees("the tracker")
            person.types(self.urls["tracker"])
            assert "can be used" in person.sees("the output that drives the contact")
            person.types(self.urls["contact"])
            person.sees("calibration [none]")
            person.types("")
            person.sees("(coarse, clinical, fine) [coarse]")
            person.types("")
            person.sees("language of the operator's texts")
            person.types("")
            assert "+configured = true" in person.sees("Write it? [Y/n]")
            person.types("")
            person.sees("starts by itself")
            assert person.ends() == 0
            self.draw("first-day-configure", "sudo probewatch configure", person.text)

    def draw(self, name: str, title: str, shown: str) -> None:
        """For docs/, with the places that a cart has."""
        parts = self.socket.parent
        places = {
            self.file: "/etc/probewatch/probewatch.toml",
            parts / "alarms": "/var/lib/probewatch",
            f"ndi:{parts}/polaris?probe={parts}/probe.rom": "ndi:/dev/ttyUSB0?probe=/etc/probewatch/probe.rom",
            f"sim:{parts}/scanner": "v4l2:/dev/video0",
            f"relay:{parts}/relay_board": "relay:/dev/ttyUSB1",
        }
        for place, usual in places.items():
            shown = shown.replace(str(place), usual)
        draw_terminal(name, title, shown)

    def said(self, *arguments: str | Path) -> str:
        """What a command prints into a pipe."""
        command = [str(PROBEWATCH), *map(str, arguments)]
        wide = os.environ | {"COLUMNS": "110"}
        return subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120, env=wide, check=False
        ).stdout


@pytest.fixture
def day(tmp_path: Path) -> Iterator[Day]:
    with ExitStack() as left:
        yield Day(tmp_path, left)


def configured(day: Day) -> float:
    """s since the day began."""
    until(lambda: "not configured yet" in _status(day.socket), 30, 0.2)
    day.configure()
    return time.monotonic() - day.began_s


def served_again(day: Day) -> None:
    """The service ends, as it does once it is configured, and the unit starts it again."""
    assert day.service.wait(20) == 0
    day.service = day.serve()
    day.waits_for_a_calibration()


def is_what_was_answered(day: Day) -> None:
    """The configuration, which keeps the template's comments."""
    config = load_config(day.file)
    assert (config.video.url, config.tracker.url) == (day.urls["video"], day.urls["tracker"])
    assert (config.output[0].url, config.calibration.file) == (day.urls["contact"], None)
    assert subprocess.run([PROBEWATCH, "check", day.file], check=False).returncode == 0
    comments = [line for line in template().splitlines() if re.match("# [A-Z]", line)]
    assert [line for line in day.file.read_text().splitlines() if re.match("# [A-Z]", line)] == comments


def test_an_answer_that_cannot_be_is_asked_again_and_nothing_is_written_before_it_is_accepted(day: Day) -> None:
    before = day.file.read_text()
    with Person("configure", day.file) as person:
        person.sees("the scanner's picture")
        person.types("/dev/video0")
        person.sees("Did you mean 'v4l2:/dev/video0'")
        person.sees("the scanner's picture")
        person.types(f"sim:{day.socket}-nobody")
        person.sees("Use it anyway? [y/N]")
        person.types("")
        person.sees("the scanner's picture")
        person.types(day.urls["video"])
        person.sees("the tracker")
        person.types("ndi:" + day.urls["tracker"].partition(":")[2].partition("?")[0])
        person.sees("tool definition file")
        person.types(str(day.socket.with_name("probe.rom")))
        person.sees("second marker body")
        person.types("none")
        person.sees("the output that drives the contact")
        person.types(day.urls["contact"])
        person.sees("calibration [none]")
        person.types("")
        person.sees("(coarse, clinical, fine) [coarse]")
        person.types("")
        person.sees("language of the operator's texts")
        person.types("fr")
        person.sees("is not one of")
        person.types("de")
        person.sees("Write it? [Y/n]")
        person.types("n")
        assert person.ends() == 130
    assert day.file.read_text() == before


def test_a_file_that_was_changed_while_a_person_thought_is_not_overwritten(day: Day) -> None:
    urls = [f"--{name}={day.urls[name]}" for name in ("video", "tracker", "contact")]
    with Person(
        "configure", day.file, *urls, "--untried", "--no-calibration", "--profile", "coarse", "--language", "en"
    ) as person:
        person.sees("Write it? [Y/n]")
        day.file.write_text(template() + "# another person\n")
        person.types("y")
        person.sees("was changed by another program")
        assert person.ends() == 78
    assert day.file.read_text().endswith("# another person\n")


def _status(socket: Path) -> str:
    said = subprocess.run(
        [PROBEWATCH, "status", "--socket", socket], capture_output=True, text=True, timeout=30, check=False
    )
    return said.stdout + said.stderr


@pytest.mark.alone
def test_from_an_unconfigured_package_to_monitoring_within_ten_minutes(day: Day) -> None:
    configured_s = configured(day)
    is_what_was_answered(day)
    served_again(day)
    day.tank.touch()
    with Person("recalibrate", "--live", "--solve", "all", "--config", day.file) as person:
        for question, answer in (("probe:", "L12-5"), ("preset of the scanner:", "4 cm"), ("your name:", "A. Smith")):
            person.sees(question)
            person.types(answer)
        person.sees("Scan the crossing; Enter when it is complete")
        person.sees("The scan is complete: press Enter", 300)
        person.types("")
        person.sees("numbers of views to strike out or take back:")
        person.types("accept")
        for question, answer in (
            ("name of the second person:", "B. Jones"),
            ("role:", "clinical engineer"),
            ("why is there no check at another point:", "a simulated tank cannot be moved"),
            ("comment", ""),
        ):
            person.sees(question)
            person.types(answer)
        person.sees("Now move the probe over tissue")
        scanned_s = time.monotonic() - day.began_s
        assert not day.status()["energised"], "nothing has been proved"
        day.tank.unlink()
        person.sees("written:", 200)
        assert person.ends() == 0
    status = until(lambda: (told := day.status()).get("state") == "monitoring" and told, 60, 0.2, day.status)
    took_s = time.monotonic() - day.began_s
    print(f"configured after {configured_s:.0f} s, signed after {scanned_s:.0f} s, monitoring after {took_s:.0f} s")
    assert took_s < LONGEST_S
    assert (status["energised"], status["reference"]["number"]) == (True, 1)
    file = Path(status["reference"]["file"])
    assert file.parent == load_config(day.file).alarm.folder / "calibrations"
    said = tomllib.loads(file.read_text())
    assert said["simulated"]
    assert (said["provenance"]["made_by"], said["provenance"]["signed_by"]) == ("A. Smith", "B. Jones")
    if draws():
        folder = load_config(day.file).alarm.folder
        known = [day.said("calibration", *what, "--folder", folder) for what in (("list",), ("show", "1"))]
        day.draw("calibrations", "probewatch calibration list, probewatch calibration show 1", "\n\n".join(known))
        test = day.said("self-test", "--config", day.file, "--yes", "--lamps", "seen", "--operator", "A. Smith")
        day.draw("self-test", 'probewatch self-test --operator "A. Smith"', test)


def scanned_and_signed(page: Page, token: str, tank: Path) -> None:
    """What a technician does who has nothing but the page: every button by the word on it, as it is offered."""
    page.fill("#token", token)
    page.click("button:has-text('Unlock')")
    page.wait_for_selector("#part-token", state="hidden")
    for label, value in (("Probe", "L12-5"), ("Preset", "4 cm"), ("Your name", "A. Smith")):
        page.get_by_label(label).fill(value)
    begins(page, "scanning")
    tank.touch()
    until(lambda: "±" in page.inner_text("#zeta") and not page.query_selector("#refusals p"), 300, 0.2)
    page.click("button:has-text('Scan is complete')")
    page.wait_for_selector("body[data-phase=review]")
    tank.unlink()
    page.fill("#unchecked", "a simulated tank cannot be moved")
    page.fill("#signer", "B. Jones")
    page.fill("#role", "clinical engineer")
    page.click("#accept")


@pytest.mark.alone
@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium (chromium)")
@pytest.mark.filterwarnings("ignore::ResourceWarning")  # of playwright's own pipes
def test_from_an_unconfigured_package_to_monitoring_by_the_page_within_ten_minutes(day: Day) -> None:
    """The questions of configure are the only words typed beside it; its token is what `page --token` prints."""
    configured_s = configured(day)
    served_again(day)
    with WebPage(day.file.parent, day.socket) as web, chromium() as browser:
        page = browser.new_page()
        page.set_default_timeout(60_000)
        page.goto(web.url)
        page.wait_for_selector("#state:not([data-lamp=green])")
        page.click("a:has-text('Recalibrate')")
        scanned_and_signed(page, web.token(), day.tank)
        page.wait_for_selector("body[data-phase=proving]")
        scanned_s = time.monotonic() - day.began_s
        assert not day.status()["energised"], "nothing has been proved"
        until(lambda: page.get_attribute("body", "data-phase") == "done", 400, 0.2, day.status)
        took_s = time.monotonic() - day.began_s
        page.goto(web.url)
        page.wait_for_selector("#state[data-lamp=green] >> text=Calibration verified")
    print(f"configured after {configured_s:.0f} s, signed after {scanned_s:.0f} s, monitoring after {took_s:.0f} s")
    assert took_s < LONGEST_S
    status = until(lambda: (told := day.status()).get("state") == "monitoring" and told, 60, 0.2, day.status)
    assert (status["energised"], status["reference"]["number"]) == (True, 1)
    said = tomllib.loads(Path(status["reference"]["file"]).read_text())
    assert said["simulated"]
    assert (said["provenance"]["made_by"], said["provenance"]["signed_by"]) == ("A. Smith", "B. Jones")
