"""Asks the service to recalibrate for the session of a scan, over a connection that lives as long as the scan.

Where that connection breaks, or is silent for long, the service gives the scan up by itself. It is asked again where it
has forgotten the request, as after a restart or as soon as a lost device is back, but not where it has monitored since
or recalibrates for another client: whoever works with it then must not lose it to a scan that may be unattended.
"""

import contextlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.types import State
from probewatch.drivers.errors import ProbewatchError
from probewatch.tools.shared.status_watch import Seen

ANSWER_S = 3.0
"""Seconds for the service to answer a request: sixty ticks, as it may read a file before it answers."""
_HOLD_S = 20.0
"""Seconds of silence after which the service gives the scan up, as when a page hangs. The session sends a request twice
a second; longer blocks a cart that nobody can go on with, shorter gives up when the computer is busy. Not measured on a
cart.
"""
_RETURN_S = 3.0
"""Seconds between two looks, at most, for the session to take back a service that monitors again after a lost device:
six looks, within which nobody can have taken it into use. Longer takes it from whoever works with it; shorter loses a
scan on a busy computer, until it is signed."""
_WITHOUT_US = (State.MONITORING.value, State.RECALIBRATING.value)
"""States in which the service works for others once it has forgotten this session."""

_Answer = TypeVar("_Answer")


class Asked(ControlRefused):
    """Reports a difference from the calibration in force that must be accepted first. text: the difference, to be
    repeated in order to accept it.
    """

    def __init__(self, text: str) -> None:
        super().__init__(
            f"differs from the calibration in force: {text}", "new calibration", "Accept that, or reject it"
        )
        self.text = text


class HeldService:
    """Holds the service for a scan. control: its socket. Requests raise ProbewatchError, worded for the technician."""

    def __init__(self, control: Path) -> None:
        self._control = control
        self._held: ControlClient | None = None
        self._asked_ns = self._looked_ns = 0
        self._gave_way = self._lost = False

    def grasp(self) -> None:
        """Has the service recalibrate for as long as this connection lives."""
        client = self._client()
        try:
            client.begin_recalibration(_HOLD_S)
        except BaseException:
            client.close()
            raise
        self.let_go()
        self._held, self._asked_ns = client, time.monotonic_ns()
        self._looked_ns, self._gave_way, self._lost = self._asked_ns, False, False

    def keep(self) -> None:
        """Keeps the service recalibrating for this session if it still does, and requests nothing, whoever views the
        scan. Raises ControlRefused where it does not.
        """
        if not self.speak():
            raise ControlRefused("the service does not wait for this scan. The scan is kept; signing it asks again")

    def hold(self, seen: Seen, wanted: bool = False) -> None:
        """Has the service recalibrate for this session, again where it has forgotten. seen: its status. wanted: whether
        a person asks for it now, which also takes the service from monitoring. Raises ControlRefused where it does not
        recalibrate.
        """
        since_ns, self._looked_ns = self._looked_ns, time.monotonic_ns()
        if self.speak():
            return
        if seen.status is None:
            raise ControlRefused(f"the service does not answer ({seen.silence}). The scan is kept")
        state = seen.status["state"]
        unwatched_s = (self._looked_ns - since_ns) / 1e9
        returns = self._lost and state == State.MONITORING.value and unwatched_s <= _RETURN_S
        gone_on = _without_us(seen.status) and not self.is_older(seen) and not returns
        self._gave_way |= unwatched_s > _HOLD_S or gone_on
        if self._gave_way and not wanted:
            raise ControlRefused("the service has gone on without this scan. The scan is kept; signing it asks again")
        try:
            self.grasp()
        except ControlRefused:
            if state in _WITHOUT_US:
                raise
            self._lost = True
            lost = "; ".join(f"{device}: {what}" for device, what in seen.status["lost"].items())
            why = lost or seen.status["reason"]
            raise ControlRefused(f"{state}: {why}. The scan is kept, and goes on by itself") from None

    def give(self, file: Path, confirm: str) -> str:
        """Has the service take and prove a new calibration, which nobody else ends while the connection is held, and
        returns its SHA-256.

        confirm: the difference that a person has accepted. Raises Asked for a difference that must be accepted.
        """

        def given(client: ControlClient) -> dict[str, Any]:
            proposal = client.propose_calibration(file)
            if proposal["confirm"] and confirm != proposal["text"]:
                raise Asked(str(proposal["text"]))
            client.end_recalibration(file, str(proposal["text"]), str(proposal["sha256"]))
            return proposal

        proposal = self._ask(given)
        return str(proposal["sha256"])

    def abort(self) -> None:
        """Ends the recalibration, so that the calibration before it stays in force. Raises ProbewatchError where the
        service does not answer.
        """
        with contextlib.suppress(ControlRefused):  # it does not recalibrate any more
            self._ask(lambda client: client.abort_recalibration())
        self.let_go()

    def let_go(self) -> None:
        """Ends the connection."""
        if self._held is not None:
            self._held.close()
            self._held = None

    def is_older(self, seen: Seen) -> bool:
        """Returns whether this status was reported before the service did what it was last asked."""
        return seen.status is not None and seen.t_ns <= self._asked_ns

    def speak(self) -> bool:
        """Sends a request over that connection, by which the service knows that this session lives, and returns whether
        it recalibrates for this session.
        """
        if self._held is None:
            return False
        try:
            recalibration = self._held.status()["recalibration"]
        except ProbewatchError:
            self.let_go()
            return False
        return bool(recalibration and recalibration["yours"])

    def _ask(self, request: Callable[[ControlClient], _Answer]) -> _Answer:
        if self.speak():
            assert self._held is not None
            answer = request(self._held)
        else:
            with self._client() as client:
                answer = request(client)
        self._asked_ns = time.monotonic_ns()
        return answer

    def _client(self) -> ControlClient:
        return ControlClient(self._control, ANSWER_S)


def _without_us(status: dict[str, Any]) -> bool:
    """Returns whether the service monitors, or recalibrates for another client. A status that names this session as the
    owner was reported before the connection was lost.
    """
    ours = (status["recalibration"] or {}).get("yours", False)
    return status["state"] in _WITHOUT_US and not ours
