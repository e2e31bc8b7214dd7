"""What a request needs of files, in a thread of its own: the tick waits for a disk only as long as it may be late."""

import threading
from collections.abc import Callable
from typing import TypeVar

from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.service.host.own_files import own_files

_LONGEST_S = 0.1
"""With a tick, less than the life of a command to an output."""

_T = TypeVar("_T")


class DeadlineWorker:
    """One at a time; while one that was given up has not come back, every other is refused at once. longest_s: for
    which the tick waits for one.
    """

    def __init__(self, longest_s: float = _LONGEST_S) -> None:
        self._longest_s = longest_s
        self._thread: threading.Thread | None = None
        self._file = ""

    def run(self, file: str, job: Callable[[], _T]) -> _T:
        """What the job returns or raises. file: what it waits for, in words. Raises ControlRefused when it must not
        be waited for any longer; the job's result is lost then.
        """
        if self._thread is not None and self._thread.is_alive():
            raise ControlRefused(f"{self._file} still does not answer; check its disk, or wait")
        done: list[_T] = []
        failed: list[BaseException] = []
        self._file = file
        self._thread = threading.Thread(target=_carry_out, args=(job, done, failed), name="job", daemon=True)
        try:
            self._thread.start()
        except RuntimeError:
            self._thread = None
            raise ControlRefused(f"this computer has no room for a thread that reads {file}; try again") from None
        self._thread.join(self._longest_s)
        if failed:
            raise failed[0]
        if not done:
            raise ControlRefused(f"{file} does not answer within {self._longest_s:g} s; check its disk, then ask again")
        return done[0]


def _carry_out(job: Callable[[], _T], done: list[_T], failed: list[BaseException]) -> None:
    own_files()
    try:
        done.append(job())
    except BaseException as error:
        failed.append(error)  # the caller that waits for it raises it
