"""What a person with a token asks of the service from the page: acknowledge, silence, sound, lamp test."""

from collections.abc import Callable, Mapping
from pathlib import Path

from probewatch.appliance.service.control.client import ControlClient

_SILENCE_S = 120.0
"""The longest that the service grants; whoever needs longer says why, with `probewatch pause --off`."""
REQUESTS: Mapping[str, Callable[[ControlClient, str], object]] = {
    "acknowledge": lambda client, why: client.acknowledge(why),
    "silence": lambda client, why: client.pause_audio(_SILENCE_S, why),
    "sound": lambda client, _: client.audio_on(),
    "lamp-test": lambda client, why: client.test_lamps(why),
}


class Asking:
    """control: socket of the service."""

    def __init__(self, control: Path) -> None:
        self._control = control

    def ask(self, what: str, who: str) -> None:
        """One of REQUESTS. who: asked for the token; the alarm log keeps it. Raises ProbewatchError."""
        with ControlClient(self._control) as client:
            REQUESTS[what](client, f"on the page, with a token of {who}")
