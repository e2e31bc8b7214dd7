"""Decides what is written of the feed, and when: line after line, without the patient's name. It reads no clock."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from probewatch.appliance.core.registration.sector import Sector
from probewatch.appliance.service.feed.message import FeedMessage, Judged, LineStarted, Lost, Taken
from probewatch.appliance.storage.black_box import FORMAT
from probewatch.appliance.storage.black_box_fields import Begun, Gap, Item, Made, Mark, State
from probewatch.appliance.types import Verdict
from probewatch.drivers.samples import Frame
from probewatch.tools.recorder.ring import DiskRing

_STATE_EVERY_NS = 10_000_000_000
"""Nanoseconds between two states that differ in their figures alone: a replay shows them as a curve. More often is more
to write, and more chunks in a quiet night."""
_AGAIN_NS = 5_000_000_000
"""Nanoseconds before a disk that failed, or was full, is tried again."""
_WITHHELD_EVERY_NS = 1_000_000_000
"""Nanoseconds between two entries that report withheld pictures."""
_SAID = ("state", "fault", "reason", "latched", "acknowledged", "energised", "notices", "lost", "reference")
"""Fields of the status whose change is worth an entry, as is that of the sound's mode. People's requests show there."""
_LONGEST_MARK_NS = 3_600_000_000_000
"""Nanoseconds of a stretch that a person started and forgot: an hour. Longer evicts kept alarms for nothing."""
_ALREADY = "a stretch is being kept already. End it: probewatch record stop"
_NEITHER = (
    "no stretch is being kept: none was started, or it has ended, as it does after an hour. "
    "Begin one: probewatch record start"
)
_QUIET = ("low", "none")
"""Priorities of states that are not alarms."""


@dataclass(frozen=True, slots=True)
class Keeping:
    """Holds how much is kept of an alarm, ns before and after. every, blacken: by every and text of [recorder]."""

    before_ns: int
    after_ns: int
    every: int
    blacken: bool


class Recorder:
    """Writes a run of the feed. session: names this run. software, utc: for the file's head; utc(now_ns) is a date as
    ISO 8601. say: writes to the journal.

    failing: why nothing is written at present, None while it is. withheld, lost: numbers of samples that are not in the
    files.
    """

    def __init__(
        self,
        ring: DiskRing,
        keeping: Keeping,
        session: str,
        software: str,
        utc: Callable[[int], str],
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._ring, self._keeping, self._session, self._software = ring, keeping, session, software
        self._utc, self._say = utc, say
        self._sector = Sector()
        self._made: Made | None = None
        self._step = 0
        self._status: dict[str, Any] | None = None
        self._noted_ns = 0
        self._alarmed = False
        self._withheld_here, self._withheld_ns = 0, 0
        self._missing: Gap | None = None
        self._retry_ns = 0
        self._marked_ns: int | None = None
        self.failing: str | None = None
        self.withheld = self.lost = 0

    def take(self, message: FeedMessage, now_ns: int) -> None:
        """Takes a message of the feed."""
        if isinstance(message, LineStarted):
            self._made = Made(message.settings, message.step)
            self._step = message.step
            self._put(self._made, now_ns)
        elif isinstance(message, Taken):
            self._step = message.step + 1
            self._sample(message, now_ns)
        elif isinstance(message, Judged):
            self._put(message.verdict, now_ns)
        elif isinstance(message, Lost):
            self.lost += message.samples
            self._put(Gap("this recorder was too slow, or the computer too busy", message.samples), now_ns)

    def interrupted(self, why: str, now_ns: int) -> None:
        """Records that the feed has ended; what follows begins with settings of its own."""
        self._made = None
        self._put(Gap(why), now_ns)

    def state(self, status: dict[str, Any], now_ns: int) -> None:
        """Takes a status of the control socket, as often as the service is asked for it."""
        before, self._status = self._status, status
        changed = before is None or _said(before) != _said(status)
        if changed or now_ns - self._noted_ns >= _STATE_EVERY_NS:
            self._noted_ns = now_ns
            self._put(State(status), now_ns)
        if self._marked_ns is not None and now_ns - self._marked_ns >= _LONGEST_MARK_NS:
            self.mark("stop", "an hour after its start", now_ns)
        alarmed = status.get("priority") not in _QUIET
        if alarmed and (not self._alarmed or changed):
            self._put(Mark("alarm", f"{status.get('state')}: {status.get('reason')}"), now_ns)
            self._keep(now_ns - self._keeping.before_ns, now_ns + self._keeping.after_ns)
        self._alarmed = alarmed

    def mark(self, kind: str, reason: str, now_ns: int) -> None:
        """Marks a stretch that a person wants kept. kind: "start" or "stop" of it. Raises ValueError for the start of
        one that is kept already, and the end of one that is not.
        """
        if (kind == "start") == (self._marked_ns is not None):
            raise ValueError(_ALREADY if kind == "start" else _NEITHER)
        self._put(Mark(kind, reason), now_ns)
        if kind == "start":
            self._marked_ns = now_ns
        else:
            assert self._marked_ns is not None
            self._keep(self._marked_ns, now_ns)
            self._marked_ns = None
            return
        self._keep(now_ns, now_ns + _LONGEST_MARK_NS)

    def fields(self) -> dict[str, Any]:
        """Returns the fields of the reply about the recorder's state."""
        sizes, counts = self._ring.sizes, self._ring.counts
        return {
            "session": self._session,
            "recording": self._made is not None and self.failing is None,
            "failing": self.failing,
            "marked": self._marked_ns is not None,
            "ring_bytes": sizes["ring"],
            "kept_bytes": sizes["kept"],
            "ring_files": counts["ring"],
            "kept_files": counts["kept"],
            "evicted_files": self._ring.evicted,
            "free_bytes": self._ring.free_bytes,
            "lost_samples": self.lost,
            "withheld_pictures": self.withheld,
        }

    def close(self) -> None:
        """Ends the file."""
        self._ring.close_part()

    def _sample(self, taken: Taken, now_ns: int) -> None:
        sample = taken.sample
        if not isinstance(sample, Frame) or not self._keeping.blacken:
            self._put(sample, now_ns)
            return
        inside = self._sector.step(sample.image)
        if inside is None:
            self.withheld += 1
            self._withheld_here += 1
            if now_ns - self._withheld_ns >= _WITHHELD_EVERY_NS:
                self._report_withheld(now_ns)
            return
        self._report_withheld(now_ns)
        self._put(replace(sample, image=np.where(inside, sample.image, np.uint8(0))), now_ns)

    def _report_withheld(self, now_ns: int) -> None:
        if self._withheld_here:
            number, self._withheld_here = self._withheld_here, 0
            self._withheld_ns = now_ns
            self._put(
                Gap("pictures were withheld: where tissue is and where names are is not known yet", number), now_ns
            )

    def _keep(self, from_ns: int, to_ns: int) -> None:
        try:
            self._ring.keep(from_ns, to_ns)
        except OSError as error:
            self._say(f"what is to be kept could not be moved: {error.strerror}")

    def _put(self, item: Item, now_ns: int) -> None:
        """Writes the item, and handles every error of the disk."""
        if self.failing is not None and now_ns < self._retry_ns:
            self._miss()
            return
        try:
            self._write(item, now_ns)
        except ValueError as error:
            self._miss(f"something could not be written down ({error})")
        except OSError as error:
            self._miss()
            self._fail(error.strerror or str(error), now_ns)

    def _write(self, item: Item, now_ns: int) -> None:
        """Writes the item, in a new part where one is due; no part begins between a sample and its verdict."""
        if not self._ring.is_open or (self._ring.due(now_ns) and not isinstance(item, Verdict)):
            self._begin(now_ns, fresh=isinstance(item, Made))
        if self._missing is not None:
            missing, self._missing = self._missing, None
            self._ring.put(missing, now_ns)
        self._ring.put(item, now_ns)

    def _begin(self, now_ns: int, fresh: bool) -> None:
        """Begins a part with what it needs to be read alone. Raises OSError where the disk has no room to spare."""
        if not self._ring.room():
            raise OSError(28, "the disk has less free than [recorder] leave_free_gb")
        simulated = tuple(str(url) for url in (self._status or {}).get("simulated", ()))
        text = "blackened" if self._keeping.blacken else "kept"
        number = self._ring.part + 1
        utc = self._utc(now_ns)
        head = Begun(FORMAT, self._software, utc, now_ns, self._session, number, simulated, text, self._keeping.every)
        self._ring.begin(head)
        if self.failing is not None:
            self._say("recording again")
            self.failing = None
        if self._made is not None and not fresh:
            self._ring.put(replace(self._made, step=self._step), now_ns)
        if self._status is not None:
            self._ring.put(State(self._status), now_ns)

    def _miss(self, why: str = "the disk failed or was full") -> None:
        number = 0 if self._missing is None else self._missing.samples
        self._missing = Gap(why, number + 1)

    def _fail(self, why: str, now_ns: int) -> None:
        self._ring.close_part()
        self._retry_ns = now_ns + _AGAIN_NS
        if self.failing is None:
            self._say(f"not recording: {why}; trying again")
        self.failing = why


def _said(status: dict[str, Any]) -> list[object]:
    audio = status.get("audio")
    return [*(status.get(name) for name in _SAID), audio.get("mode") if isinstance(audio, dict) else None]
