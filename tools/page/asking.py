"""Sends the service what a person with a token requests on the page: acknowledge, silence, sound, lamp test."""

from collections.abc import Callable, Mapping
from pathlib import Path

from probewatch.appliance.service.control.client import ControlClient

_SILENCE_S = 120.0
"""Longest silence that the service grants, s; whoever needs longer states why, with `probewatch pause --off`."""
REQUESTS: Mapping[str, Callable[[ControlClient, str], object]] = {
    "acknowledge": lambda client, why: client.acknowledge(why),
    "silence": lambda client, why: client.pause_audio(_SILENCE_S, why),
    "sound": lambda client, _: client.audio_on(),
    "lamp-test": lambda client, why: client.test_lamps(why),
}


class Asking:
    """Sends requests to the service. control: socket of the service."""

    def __init__(self, control: Path) -> None:
        self._control = control

    def ask(self, what: str, who: str) -> None:
        """Sends one of REQUESTS. who: the user who asked for the token, for the alarm log. Raises ProbewatchError."""
        with ControlClient(self._control) as client:
            REQUESTS[what](client, f"on the page, with a token of {who}")
