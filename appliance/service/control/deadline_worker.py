"""Reads files for requests in a thread of its own, so that a slow disk delays the tick only as far as is allowed."""

import threading
from collections.abc import Callable
from typing import TypeVar

from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.service.host.own_files import own_files

_LONGEST_S = 0.1
"""s, how long the tick waits for a job. With a tick, this is less than the lifetime of a command to an output."""

_T = TypeVar("_T")


class DeadlineWorker:
    """Runs one job at a time. While a job that was given up has not returned, every other one is refused at once.
    longest_s: s, how long the tick waits for a job.
    """

    def __init__(self, longest_s: float = _LONGEST_S) -> None:
        self._longest_s = longest_s
        self._thread: threading.Thread | None = None
        self._file = ""

    def run(self, file: str, job: Callable[[], _T]) -> _T:
        """Returns or raises what the job returns or raises. file: what the job waits for, in words. Raises
        ControlRefused when the job takes too long; its result is lost then.
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
