"""A status as the service tells it, and a service that tells what the test wants, over its real control socket."""

import threading
import time
from pathlib import Path
from typing import Any

from appliance.service.control.server import ControlServer, Peer

MATRIX = [[0.08, 0.0, 0.0, -25.0], [0.0, 0.07, 0.0, -17.0], [0.0, 0.0, 1.0, 3.5], [0.0, 0.0, 0.0, 1.0]]


def told_status(**changes: Any) -> dict[str, Any]:
    """Of a verified cart, with changes."""
    check = {"name": "scale-axial", "fault": "scale", "value": 0.4, "sigma": 0.1, "unit": "%", "limit": 5.0,
             "ratio": 0.08, "verdict": "OK", "shown_age_s": 2.5}  # fmt: skip
    reference = {"number": 3, "origin": "recalibration", "sha256": "ab" * 32, "image_size_px": [640, 480],
                 "image_to_probe": MATRIX, "polarity": [1, 1]}  # fmt: skip
    return {
        "t_ns": time.monotonic_ns(), "state": "monitoring", "text": "Calibration verified", "remedy": "", "fault": None,
        "reason": "Calibration verified", "energised": True, "latched": None, "acknowledged": False, "notices": [],
        "since_s": 4.0, "verification_age_s": 2.5, "simulated": [], "fps": {"video": 30.0, "tracker": 60.0},
        "reference": reference, "checks": [check], "devices": [], "outputs": [
            {"url": "relay:/dev/x", "signal": "contact", "energised": True},
            {"url": "relay:/dev/y", "signal": "red", "energised": False},
        ],
    } | changes  # fmt: skip


OPEN = {"state": "halt", "text": "Do not use the navigation", "reason": "polarity +1 axes", "fault": "polarity",
        "energised": False, "verification_age_s": None}  # fmt: skip


class ToldService:
    """changes: of the status, from now on. asked: how often it was. hangs: it does not answer."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.changes: dict[str, Any] = {}
        self.asked = 0
        self.hangs = False
        self._end = threading.Event()
        self._server = ControlServer(path)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        self.asked += 1
        return {"status": told_status(**self.changes)}

    def _run(self) -> None:
        while not self._end.wait(0.01):
            if not self.hangs:
                self._server.poll(self._answer)

    def close(self) -> None:
        self._end.set()
        self._thread.join()
        self._server.__exit__()
