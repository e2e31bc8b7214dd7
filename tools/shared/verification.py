"""Changes the reference on behalf of a person, who confirms the difference and moves the probe until it is verified."""

import contextlib
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from probewatch.appliance.core.quality.gesture import gestures
from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.supervision.alarms import HAZARDS, NOT_NOW, SIGNALS
from probewatch.appliance.types import Fault, Kind, State
from probewatch.drivers.errors import ConfigurationError, DeviceLost, ProbewatchError
from probewatch.tools.german.translation import confirmed, recognised, told
from probewatch.tools.shared.interruption import stopped_saying
from probewatch.tools.shared.terminal import progress_bar

_HOLD_S = 900.0
"""Seconds of silence after which the service gives up on behalf of a command that hangs: reading a long recording takes
minutes. The service notices a command that was killed at once, whatever this is. Not measured."""
_MISSING = "not shown yet: "
_LOOK_EVERY_S = 0.25
"""Seconds between two looks at the status, five ticks of the service: a progress bar still seems alive."""


def accepted(proposal: dict[str, Any], yes: bool, language: str) -> tuple[str, str]:
    """Returns (the difference as text, SHA-256 of what was compared), which the service requires back, after a person
    has accepted the difference where that is required. Raises ControlRefused.
    """
    text = str(proposal["text"])
    click.echo(told("against the reference in force: {text}", language, text=recognised(text, language)))
    if proposal["confirm"]:
        ask(told("Accept that? Nothing of it is verified then.", language), yes, language)
    return text, str(proposal["sha256"])


def ask(question: str, yes: bool, language: str) -> None:
    """Returns once a person has agreed, now or before. Raises ControlRefused without a terminal."""
    if not yes and not sys.stdin.isatty():
        refusal = told("needs a person to accept it; nothing was changed", language)
        raise ControlRefused(refusal, f"'{question}'", told("Give --yes to accept it", language))
    if not yes and not confirmed(question, language):
        raise click.Abort


def refuse_simulated(socket: Path) -> None:
    """Raises ConfigurationError where the service watches real devices."""
    with ControlClient(socket) as client:
        if not client.status().get("simulated"):
            what = "watches real devices, and a simulated scan does not apply to them"
            raise ConfigurationError(
                what, f"the service at {socket}", "Scan the cross-wire with this probe: --recording"
            )


@contextlib.contextmanager
def recalibrating(client: ControlClient | None, language: str) -> Iterator[None]:
    """Keeps the service, if any, in recalibration while the block runs. A block that fails or is interrupted aborts the
    recalibration, and so does the service when this process is killed.
    """
    if client is None:
        yield
        return
    with _told_what_to_look_at(language):
        client.begin_recalibration(_HOLD_S)
    try:
        with _told_what_to_look_at(language):
            yield
    except BaseException as error:
        with contextlib.suppress(ProbewatchError):
            client.abort_recalibration()
            if isinstance(error, ProbewatchError):  # reporting_change reports an interruption
                click.echo(_gone_back(client.status().get("reference"), language), err=True)
        raise


@contextlib.contextmanager
def _told_what_to_look_at(language: str) -> Iterator[None]:
    """Adds to a refusal that is due to the state of the service where to find the cause of that state."""
    try:
        yield
    except ControlRefused as error:
        if error.what.startswith(NOT_NOW) and not error.remedy:
            error.what = recognised(error.what, language)
            error.remedy = told("What stands in its way: probewatch status", language)
        raise


def _gone_back(reference: Mapping[str, Any] | None, language: str) -> str:
    """Returns, as text, what a refused scan or file leaves behind: a contact that opened when recalibration began."""
    if reference is None:
        return told("there is no calibration, as before", language)
    back = "reference {number} is in force, as before; the contact closes once motion has verified it"
    return told(back, language, number=reference["number"])


@contextlib.contextmanager
def reporting_change(socket: Path | None, language: str) -> Iterator[None]:
    """Reports, if the block is interrupted or declined, whether the service has a different reference from that at the
    beginning. `socket` is that of the service, None without one. Raises ProbewatchError where it does not answer.
    """
    if socket is None:
        with stopped_saying(told("no service was notified", language), told("stopped", language)):
            yield
        return
    before = _reference_of(socket)
    with stopped_saying(lambda: _become(socket, before, language), told("stopped", language)):
        yield


def _reference_of(socket: Path) -> dict[str, Any] | None:
    with ControlClient(socket) as client:
        reference = client.status().get("reference")
    return None if reference is None else {key: reference[key] for key in ("number", "sha256")}


def _become(socket: Path, before: dict[str, Any] | None, language: str) -> str:
    """Returns, as text, which reference the service has now; waits first, so that its last request is complete."""
    time.sleep(_LOOK_EVERY_S)
    try:
        now = _reference_of(socket)
    except ProbewatchError as error:
        unknown = "whether the reference was changed is not known ({why}); see: probewatch calibration list"
        return told(unknown, language, why=error.what)
    if now is None:
        return told("nothing was changed, there is no calibration, as before", language)
    if now == before:
        return told("nothing was changed, reference {number} is in force, as before", language, number=now["number"])
    if before is not None and now["sha256"] == before["sha256"]:
        again = "the calibration before is in force again, as reference {number}; motion has to verify it"
        return told(again, language, number=now["number"])
    taken = "reference {number} was taken, and the contact stays open until motion has verified it"
    said = told(taken, language, number=now["number"])
    if before is None:
        return said
    back = told("back to the one before: probewatch calibration back {number}", language, number=before["number"])
    return f"{said}; {back}"


def waits_for(status: Mapping[str, Any]) -> str:
    """Returns why the service has not verified a new reference yet: an obstacle, such as a probe in the air, else which
    parameters no motion has shown yet.
    """
    reason = str(status.get("reference_waits") or status["reason"])
    if reason != SIGNALS[State.RECALIBRATING].text:
        return reason
    checks = (*status["devices"], *status["checks"])
    found = {one["fault"] for one in checks if one["verdict"] != "OK" and one["value"] is not None}
    unseen = next((HAZARDS[fault].text for fault in Fault if fault.kind is Kind.SIGHT and fault in found), "")
    missing = ", ".join(status.get("missing", ()))
    return unseen or (f"{_MISSING}{missing}" if missing else reason)


def motions_for(reason: str) -> str:
    """Returns the motions that show what `waits_for` calls not shown yet; empty where it names no parameter."""
    _, found, names = reason.rpartition(_MISSING)
    return "; ".join(gesture.value for gesture in gestures(names.split(", "))) if found else ""


def with_motions(reason: str, language: str) -> str:
    """Returns the reason of `waits_for` in the language, after the motions that it requires."""
    return " · ".join(recognised(part, language) for part in (motions_for(reason), reason) if part)


def await_verification(client: ControlClient, socket: Path, wait_s: float, language: str) -> None:
    """Returns as soon as the service is monitoring. `client` gave it the reference; its connection stays open, so that
    no other client changes the reference meanwhile. Raises DeviceLost, ControlRefused.
    """
    end_s = time.monotonic() + wait_s
    given: dict[str, Any] = {}
    move = "now move the probe over tissue, to and fro, tilting and turning it: the service verifies the reference"
    click.echo(told(move, language))
    with progress_bar("{task.fields[state]}: {task.fields[reason]}") as progress:
        task = progress.add_task("wait", total=None, state="", reason="")
        while True:
            status = client.status()
            state, reason = recognised(str(status["state"]), language), waits_for(status)
            progress.update(task, state=state, reason=with_motions(reason, language))
            if status["state"] != State.RECALIBRATING.value:
                break
            given = status.get("reference") or given
            if time.monotonic() > end_s:
                why = recognised(reason, language)
                what = told("not verified within {seconds} s: {why}", language, seconds=f"{wait_s:g}", why=why)
                raise _not_verified(what, language, motions_for(reason), given.get("number", 0) - 1)
            time.sleep(_LOOK_EVERY_S)
    why = recognised(str(status["reason"]), language)
    if status["state"] == State.DEVICE_LOST.value:
        what = told("a device was lost before the new calibration was verified: {why}", language, why=why)
        remedy = "The old one is in force again; repair the device and recalibrate again"
        raise DeviceLost(what, str(socket), told(remedy, language))
    if given and (status.get("reference") or given).get("number") != given.get("number"):
        # The state may be that of a halt which the reference before had latched.
        what = told(
            "a device was lost before the new calibration was verified, and the one before is in force", language
        )
        again = "As soon as the device is back: probewatch calibration use {file}"
        raise DeviceLost(what, str(socket), told(again, language, file=given.get("file", "FILE")))
    if status["state"] != State.MONITORING.value:
        what = told("not verified, the service is in state {state}: {why}", language, state=state, why=why)
        raise _not_verified(what, language)


def _not_verified(what: str, language: str, motions: str = "", before: int = 0) -> ControlRefused:
    """Returns an error that names the missing motions, and how to go back to the reference before. `before`: number of
    that reference; 0 where there is none, or where the service has gone back to it.
    """
    remedy = told("The contact stays open; move the probe over tissue, see its status", language)
    if motions:
        moves = recognised(motions, language)
        remedy = told("The contact stays open; to show it, on tissue: {motions}", language, motions=moves)
    if before > 0:
        back = "back to the one before: probewatch calibration back {number}"
        remedy = f"{remedy}; {told(back, language, number=before)}"
    return ControlRefused(what, recognised("new calibration", language), remedy)
