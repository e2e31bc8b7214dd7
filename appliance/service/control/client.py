"""Implements the client side of the control socket, for the operator's commands and for other software."""

import json
from pathlib import Path

from probewatch.appliance.service.control.refusal import why_silent
from probewatch.appliance.service.control.rights import join_group
from probewatch.appliance.service.control.server import VERSION, ControlRefused, Reply
from probewatch.appliance.service.control.starting import NoService, how_to_start
from probewatch.appliance.service.host.unix_socket import Lines, connected
from probewatch.drivers.closable import Closable
from probewatch.drivers.errors import ConfigurationError, DeviceLost, ProbewatchError
from probewatch.drivers.printable import printable_value

_LONGEST_REPLY = 1 << 20
"""Bytes. A status has some 20 kB; whatever sends more is no service, and would take memory."""


class ControlClient(Closable):
    """Talks to a running service. timeout_s: limit for each complete reply, s.

    Raises ControlRefused when the service declines. When none answers, raises DeviceLost, or the error for which the
    service could not start, such as ConfigurationError.
    """

    def __init__(self, path: Path, timeout_s: float = 2.0) -> None:
        self._path, self._timeout_s = path, timeout_s
        try:
            self._link = connected(path, timeout_s)
        except OSError as error:
            raise self._gone(error) from None
        self._lines = Lines(self._link, _LONGEST_REPLY)

    def close(self) -> None:
        self._link.close()

    def status(self) -> Reply:
        """Returns the whole status, as documented in appliance.service.control.status."""
        status = self._ask(do="status")["status"]
        assert isinstance(status, dict)
        return status

    def acknowledge(self, reason: str = "") -> str:
        """Acknowledges the alarm for a person who has seen it: it falls silent, and a latched state ends once the cause
        is gone. Returns state and reason of what was acknowledged. reason: for the alarm log, here as below.
        """
        return str(self._ask(do="acknowledge", **_noted(reason)).get("acknowledged", ""))

    def pause_audio(self, seconds: float, reason: str = "") -> None:
        """Silences the alarm for at most 120 s."""
        self._ask(do="pause-audio", seconds=seconds, **_noted(reason))

    def audio_off(self, reason: str) -> None:
        """Silences the alarm until audio_on, except for a reminder once a minute."""
        self._ask(do="audio-off", reason=reason)

    def audio_on(self) -> None:
        """Ends a pause or an audio-off."""
        self._ask(do="audio-on")

    def test_lamps(self, reason: str = "") -> None:
        """Switches on all lamps and the tone for five seconds; the contact stays as it is."""
        self._ask(do="lamp-test", **_noted(reason))

    def reload(self) -> None:
        """Applies the limits, times and language of the changed configuration file; an invalid file changes nothing."""
        self._ask(do="reload")

    def propose_calibration(self, wanted: Path | int) -> Reply:
        """Returns how a file, or an earlier reference by its number, differs from the one in force; docs/control.md."""
        proposal = self._ask(do="propose-calibration", **_wanted(wanted))["proposal"]
        assert isinstance(proposal, dict)
        return proposal

    def clear_bump(self) -> None:
        """Confirms that a person has checked the tracker's position sensor after a bump: its poses count again."""
        self._ask(do="clear-bump")

    def begin_recalibration(self, hold_s: float | None = None) -> None:
        """Stops monitoring for a scan. hold_s: the service gives the recalibration up when this connection is closed
        before the end, or sends no request for this time, 1 … 3600 s.
        """
        self._ask(do="begin-recalibration", **({} if hold_s is None else {"hold_s": hold_s}))

    def end_recalibration(self, wanted: Path | int, confirm: str = "", sha256: str = "", scanned: bool = True) -> None:
        """Takes a file, or an earlier reference by its number, as the reference; monitoring resumes once the line has
        confirmed it. confirm: the difference in the words of the proposal, where it must be confirmed. sha256: that of
        the proposal, so that no other file is taken. scanned: False for a file that no scan has just made.
        """
        said: dict[str, str | float] = {"sha256": sha256} if sha256 else {}
        said |= {} if scanned else {"scanned": False}
        self._ask(do="end-recalibration", confirm=confirm, **said, **_wanted(wanted))

    def abort_recalibration(self) -> None:
        """Returns to the reference that was in force before."""
        self._ask(do="abort-recalibration")

    def _ask(self, **request: str | float) -> Reply:
        try:
            self._link.settimeout(self._timeout_s)
            self._link.sendall(json.dumps({"v": VERSION, **request}).encode() + b"\n")
            line = self._lines.next(self._timeout_s)
        except OSError as error:
            raise self._gone(error) from None
        if not line:
            raise DeviceLost("the service closed the control socket", str(self._path), "Ask again; else see its log")
        reply = printable_value(json.loads(line))
        assert isinstance(reply, dict)
        if not reply["ok"]:
            raise ControlRefused(str(reply["error"]))
        return reply

    def _gone(self, error: OSError) -> ProbewatchError:
        if isinstance(error, PermissionError):
            return DeviceLost("your user may not ask the service", str(self._path), join_group(self._path))
        what = f"no service answers ({error.strerror or error})"
        return why_silent(self._path) or NoService(what, str(self._path), how_to_start(self._path))


def is_running(path: Path) -> bool:
    """Returns whether a service answers at this control socket."""
    try:
        ControlClient(path).close()
    except (DeviceLost, ConfigurationError):  # the latter is what a service that does not monitor has left
        return False
    return True


def _noted(reason: str) -> dict[str, str]:
    return {"reason": reason} if reason else {}


def _wanted(wanted: Path | int) -> dict[str, str | int]:
    return {"number": wanted} if isinstance(wanted, int) else {"file": str(wanted.absolute())}
