"""The last alarms, from the alarm log on the disk: read again when the state has changed, and not while nobody asks."""

import time
from pathlib import Path
from typing import Any

from appliance.storage.alarm_chain import Entry, Event, read_log
from drivers.printable import printable

_LAST = 12
"""Of them shown: what fits on a tablet beside everything else."""
_EVERY_S = 5.0
"""Between two readings at most: one of 40,000 entries takes .3 s of the processor. Not measured on a cart."""


class LastAlarms:
    """folder: of the alarm log, [alarm] folder; None where nobody said."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._read_s = -_EVERY_S
        self._of: object = None
        self._known: dict[str, Any] = {"entries": [], "trouble": ""}

    def fields(self, of: object) -> dict[str, Any]:
        """entries, the newest first, and why there are none. of: what must have changed before they are read again."""
        now_s = time.monotonic()
        if of != self._of and now_s - self._read_s >= _EVERY_S:
            self._of, self._read_s = of, now_s
            self._known = self._read()
        return self._known

    def _read(self) -> dict[str, Any]:
        if self._folder is None:
            return {"entries": [], "trouble": "start the page with --config to see the alarm log"}
        try:
            entries = read_log(self._folder).entries
        except OSError as error:
            return {"entries": [], "trouble": f"the alarm log cannot be read ({error.strerror})"}
        states = [entry for entry in entries if entry.event == Event.STATE]
        shown = [
            {"utc": entry.utc, "state": _said(entry, "state"), "reason": _said(entry, "reason")}
            for entry in reversed(states[-_LAST:])
        ]
        return {"entries": shown, "trouble": ""}


def _said(entry: Entry, name: str) -> str:
    return printable(str(entry.data.get(name, "")))
