"""The cart's web page as people use it: the real program, and Debian's Chromium before it."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

from tests.support.demo_cart import PROBEWATCH
from tests.support.polling import until
from tools.page.door import invitation
from tools.simulators.whole_cart import Part

CHROMIUM = shutil.which("chromium")


class WebPage:
    """`probewatch page` for the service at a socket. url: where it is reached."""

    def __init__(self, folder: Path, control: Path, listen: str = "127.0.0.1:0") -> None:
        self.door = folder / "door"
        self._command = [str(PROBEWATCH), "page", "--socket", str(control), "--folder", str(folder)]
        self._command += ["--door", str(self.door), "--config", str(control.with_name("probewatch.toml"))]
        self._listen = listen
        self.url = ""

    def __enter__(self) -> "WebPage":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.part.end()

    def start(self) -> None:
        """Where it was, if it has been."""
        self.part = Part("page", [*self._command, "--listen", self._listen])
        until(lambda: self.part.noise, 60, otherwise=self.part.require)
        self.url = self.part.noise[0].strip()
        self._listen = self.url.removeprefix("http://").rstrip("/")

    def token(self) -> str:
        """A one-time token."""
        return invitation(self.door)[0]


@contextmanager
def chromium() -> Iterator[Browser]:
    """Without a sandbox, as root has none."""
    with sync_playwright() as playwright:
        options = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=options)
        yield browser
        browser.close()
