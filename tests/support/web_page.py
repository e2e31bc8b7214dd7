"""The cart's web page as a process of its own."""

from collections.abc import Sequence
from pathlib import Path

from probewatch.tools.page.token_socket import invitation
from probewatch.tools.simulators.whole_cart import Part
from tests.support.demo_cart import PROBEWATCH
from tests.support.polling import until


class WebPage:
    """`probewatch page` for the service at a socket, of a cart of that name. url: where it is reached. before: command
    that starts it.
    """

    def __init__(
        self,
        folder: Path,
        control: Path,
        listen: str = "127.0.0.1:0",
        before: Sequence[str] = (),
        cart: str = "Cart 3",
    ) -> None:
        self.door = folder / "door"
        self._command = [*before, str(PROBEWATCH), "page", "--socket", str(control), "--folder", str(folder)]
        self._command += ["--door", str(self.door), "--cart", cart]
        if (config := control.with_name("probewatch.toml")).exists():
            self._command += ["--config", str(config)]
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
        self._listen = self.address

    @property
    def address(self) -> str:
        """HOST:PORT."""
        return self.url.removeprefix("http://").rstrip("/")

    def token(self) -> str:
        """A one-time token."""
        return invitation(self.door)[0]
