"""Reads the past from the alarm log on the disk, again when the state has changed, and not while no browser asks."""

import time
from pathlib import Path
from typing import Any

from probewatch.appliance.storage.alarm_chain import read_log
from probewatch.tools.page.past import hour, last_states

_EVERY_S = 5.0
"""Seconds between two readings at least: one of 40,000 entries takes .3 s of the processor. Not measured on a cart."""


class AlarmLogWatch:
    """Watches the alarm log. folder: that of the log, [alarm] folder; None where it was not stated."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._read_s = -_EVERY_S
        self._of: object = None
        self._known = _nothing("")

    def fields(self, of: object) -> dict[str, Any]:
        """Returns entries, the newest first; hour, its stretches; and trouble, why there are none. of: what must have
        changed before the log is read again.
        """
        now_s = time.monotonic()
        if of != self._of and now_s - self._read_s >= _EVERY_S:
            self._of, self._read_s = of, now_s
            self._known = self._read()
        return self._known

    def _read(self) -> dict[str, Any]:
        if self._folder is None:
            return _nothing("start the page with --config to see the alarm log")
        try:
            entries = read_log(self._folder).entries
        except OSError as error:
            return _nothing(f"the alarm log cannot be read ({error.strerror})")
        return {"entries": last_states(entries), "hour": hour(entries, time.time()), "trouble": ""}


def _nothing(trouble: str) -> dict[str, Any]:
    return {"entries": [], "hour": [], "trouble": trouble}
