"""Defines the requests that a person may send over the control socket, and carries them out."""

import math
import pwd
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from probewatch.appliance.service.control.allowance import BURST, EVERY_NS, Allowance
from probewatch.appliance.service.control.deadline_worker import DeadlineWorker
from probewatch.appliance.service.control.hold import Hold, hold_s_of
from probewatch.appliance.service.control.recalibration import Recalibration, Wanted
from probewatch.appliance.service.control.server import ControlRefused, Peer, Reply
from probewatch.appliance.service.host.request_line import unknown_fields
from probewatch.appliance.storage.alarm_chain import Event
from probewatch.appliance.supervision.annunciator import Annunciator
from probewatch.appliance.supervision.audio import LONGEST_PAUSE_NS
from probewatch.appliance.supervision.supervisor import Request
from probewatch.appliance.types import AlarmState
from probewatch.drivers.printable import printable

_ALWAYS = ("acknowledge", "audio-on")
"""Requests that are never refused for their rate: both can change something only after something else has."""

Body = Mapping[str, Any]

_CALIBRATION = ("file", "number", "confirm")
_FIELDS: Mapping[str, tuple[str, ...]] = {
    "pause-audio": ("seconds",),
    "propose-calibration": _CALIBRATION,
    "begin-recalibration": ("hold_s",),
    "end-recalibration": (*_CALIBRATION, "sha256", "scanned"),
}
"""The fields that each request reads. Every request may also have `reason`, which is kept in the alarm log."""


@dataclass(frozen=True, slots=True)
class ServiceActions:
    """Holds the actions of the service that a request may call. `note` adds an entry to the alarm log.

    `onlookers` holds the ids of the users who may ask for the status only. `worker` reads the list of users and does
    nothing else, so that a list that hangs delays no file access.
    """

    ask: Callable[[Request], AlarmState | None]
    status: Callable[[Peer], Reply]
    clear_bump: Callable[[], bool]
    reload: Callable[[], None]
    recalibration: Recalibration
    hold: Hold
    annunciator: Annunciator
    worker: DeadlineWorker
    now_ns: Callable[[], int]
    note: Callable[..., None]
    onlookers: frozenset[int]


class Requests:
    """Handles requests, one method for each; each raises ControlRefused, or ConfigurationError for a file.

    Every granted request is logged, and the rate per user is limited, so that no client can flood the log.
    """

    def __init__(self, actions: ServiceActions) -> None:
        self._actions = actions
        self._allowance = Allowance()
        self._names: dict[int, str] = {}
        self._asking, self._peer = "", Peer(0, 0)
        self._table: dict[str, Callable[[Body], Reply | None]] = {
            "status": lambda _: {"status": actions.status(self._peer)},
            "acknowledge": lambda _: self._acknowledge(),
            "pause-audio": self._pause_audio,
            "audio-off": self._audio_off,
            "audio-on": lambda _: actions.annunciator.audio.on(),
            "lamp-test": lambda _: actions.annunciator.test_lamps(actions.now_ns()),
            "clear-bump": self._clear_bump,
            "propose-calibration": lambda body: {"proposal": actions.recalibration.propose(_wanted(body, ""))},
            "begin-recalibration": self._begin_recalibration,
            "end-recalibration": self._end_recalibration,
            "abort-recalibration": self._abort_recalibration,
            "reload": lambda _: actions.reload(),
        }

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all requests."""
        return tuple(self._table)

    def answer(self, do: str, body: Body, who: Peer) -> Reply:
        """Returns the fields of the reply. `who` is the calling process as the kernel reports it. `ignored` in the
        reply lists fields that mean nothing to this request.
        """
        reply = self._answered(do, body, who)
        ignored = unknown_fields(body, ("reason", *_FIELDS.get(do, ())))
        return {**reply, "ignored": ignored} if ignored else reply

    def _answered(self, do: str, body: Body, who: Peer) -> Reply:
        self._actions.hold.hear(who, self._actions.now_ns())
        self._peer = who
        if do not in self._table:
            raise ControlRefused(f"'{do[:40]}' is not a request of this service; it knows {', '.join(self._table)}")
        if do != "status" and who.uid in self._actions.onlookers:
            where = "viewers of [control] and [feed]"
            raise ControlRefused(f"{self._name(who.uid)} may ask for the status and nothing else ({where})")
        if do == "status" or (do == "audio-on" and not self._actions.annunciator.audio.silenced):
            return self._table[do](body) or {}
        self._refuse_too_many(do, who)
        self._asking = f"{self._name(who.uid)}, process {who.pid}"
        reply = self._table[do](body) or {}
        self._note(do, body, reply, who)
        return reply

    def _refuse_too_many(self, do: str, who: Peer) -> None:
        wait_ns = self._allowance.wait_ns(who.uid, self._actions.now_ns())
        if wait_ns and do not in _ALWAYS:
            rate = f"{BURST} at once, then one in {EVERY_NS // 10**9} s"
            wait_s = math.ceil(wait_ns / 1e9)
            raise ControlRefused(f"{self._name(who.uid)} has asked too often ({rate}); wait {wait_s} s")

    def _note(self, do: str, body: Body, reply: Reply, who: Peer) -> None:
        if do not in _ALWAYS:
            self._allowance.take(who.uid, self._actions.now_ns())
        said = {
            key: printable(str(body[key]))
            for key in ("file", "number", "confirm", "reason", "seconds", "hold_s")
            if key in body
        }
        said |= {"acknowledged": printable(reply["acknowledged"])} if "acknowledged" in reply else {}
        self._actions.note(Event.REQUEST, do=do, who=self._asking, **said)

    def _name(self, uid: int) -> str:
        """Returns the user's name, looked up once: the list of users may be on a disk or network that hangs."""
        try:
            if uid not in self._names:
                self._names[uid] = self._actions.worker.run("the list of users", lambda: pwd.getpwuid(uid).pw_name)
            return self._names[uid]
        except (ControlRefused, KeyError):
            return f"uid {uid}"

    def _acknowledge(self) -> Reply:
        """Acknowledges the alarm and returns what was acknowledged; another alarm may follow immediately."""
        seen = self._actions.ask(Request.ACKNOWLEDGE)
        return {} if seen is None else {"acknowledged": f"{seen.state.value}: {seen.reason}"}

    def _begin_recalibration(self, body: Body) -> None:
        hold_s = hold_s_of(body.get("hold_s"))
        self._refuse_other(begins=True)
        self._actions.recalibration.begin()
        self._actions.hold.begin(self._peer, self._asking, hold_s, self._actions.now_ns())

    def _end_recalibration(self, body: Body) -> None:
        """Ends the recalibration; from then on the service itself verifies the new reference."""
        self._refuse_other()
        self._actions.recalibration.end(_wanted(body, self._asking))
        self._actions.hold.give()

    def _abort_recalibration(self, _: Body) -> None:
        self._refuse_other()
        self._actions.recalibration.abort()
        self._actions.hold.release()

    def _refuse_other(self, begins: bool = False) -> None:
        """Raises ControlRefused while a process other than the caller is recalibrating."""
        self._actions.hold.refuse_other(self._peer, self._actions.now_ns(), begins)

    def _pause_audio(self, body: Body) -> None:
        seconds = body.get("seconds", LONGEST_PAUSE_NS // 10**9)
        if not isinstance(seconds, int | float) or isinstance(seconds, bool):
            raise ControlRefused("seconds must be a number")
        ns = seconds * 1e9 if abs(seconds) < LONGEST_PAUSE_NS else math.inf
        try:
            self._actions.annunciator.audio.pause(self._actions.now_ns(), round(min(ns, 2 * LONGEST_PAUSE_NS)))
        except ValueError as error:
            raise ControlRefused(str(error)) from None

    def _audio_off(self, body: Body) -> None:
        try:
            self._actions.annunciator.audio.off(printable(str(body.get("reason", ""))))
        except ValueError as error:
            raise ControlRefused(str(error)) from None

    def _clear_bump(self, body: Body) -> None:
        if not self._actions.clear_bump():
            raise ControlRefused("the tracker has no bump detector, or is lost")


def _wanted(body: Body, who: str) -> Wanted:
    """Returns the file, or the number, that is to become the reference. Raises ControlRefused."""
    confirm = body.get("confirm", "")
    if not isinstance(confirm, str):
        raise ControlRefused("confirm must repeat the difference that is accepted")
    sha256 = body.get("sha256", "")
    if not isinstance(sha256, str):
        raise ControlRefused("sha256 must repeat that of the proposal")
    scanned = body.get("scanned", True)
    if not isinstance(scanned, bool):
        raise ControlRefused("scanned must be true or false")
    if "number" in body:
        number = body["number"]
        if not isinstance(number, int) or isinstance(number, bool) or "file" in body:
            raise ControlRefused("number must be that of an earlier reference, and no file beside it")
        return Wanted(number=number, confirm=confirm, sha256=sha256, who=who)
    file = body.get("file")
    if not isinstance(file, str) or not file or not file.isprintable():
        raise ControlRefused("file must name a calibration file, or number an earlier reference")
    return Wanted(file=Path(file), confirm=confirm, sha256=sha256, who=who, scanned=scanned)
