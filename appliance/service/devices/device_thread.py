"""Keeps one device open in a thread, which blocks in the kernel so that the tick need not."""

import threading
from abc import ABC, abstractmethod

from probewatch.appliance.service.devices.backoff import Backoff
from probewatch.appliance.service.host.log import get_log
from probewatch.appliance.supervision.alarms import HAZARDS
from probewatch.appliance.types import Fault
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import EXHAUSTED, DeviceLost, ProbewatchError, ProtocolError


class DeviceThread(threading.Thread, ABC):
    """Opens the device, works, and opens it again after a loss, with capped backoff; logs once that it is lost, and
    once that it is back.

    failure: the exception that has ended the thread, such as for a configuration that can never work; the tick raises
    it. lost: what is wrong, in words, while the device is lost. losses: how often it was lost. overload_ns: since when
    this computer has been short of time; from then on the first loss is logged and the others are only counted.
    """

    def __init__(self, role: str, url: str, clock: HostClock) -> None:
        super().__init__(name=role, daemon=True)
        self._clock = clock
        self._stopping = threading.Event()
        self._backoff = Backoff()
        self._log = get_log(device=role, url=url)
        self.role, self.url = role, url
        self.failure: BaseException | None = None
        self.lost: str | None = None
        self.losses = 0
        self.overload_ns: int | None = None
        self._noted_overload_ns: int | None = None
        self._said = False

    def stop(self) -> None:
        """Asks the thread to close its device and end."""
        self._stopping.set()

    def run(self) -> None:
        try:
            while not self._stopping.is_set():
                self._keep_open()
        except BaseException as error:
            self.failure = error  # the tick raises it

    @abstractmethod
    def work(self) -> None:
        """Opens the device and uses it until stopped. Raises DeviceLost, ProtocolError."""

    def _keep_open(self) -> None:
        try:
            self.work()
        except (DeviceLost, ProtocolError) as error:
            self._lose(error)
        except (OSError, ProbewatchError) as error:
            want = _want_behind(error)
            if want is None:
                raise
            remedy = "Start the service again; see what else runs on this computer"
            self._lose(DeviceLost(f"this computer has no room for it ({want})", self.url, remedy))

    def _lose(self, error: ProbewatchError) -> None:
        self._note_loss(error)
        self._clock.wait(self._stopping, self._clock.real_s(self._backoff.next_s()))

    def _note_loss(self, error: ProbewatchError) -> None:
        if self.lost is None:
            self.losses += 1
            self._say_loss(error)
        self.lost = str(error)

    def _say_loss(self, error: ProbewatchError) -> None:
        overload_ns = self.overload_ns
        self._said = overload_ns is None or overload_ns != self._noted_overload_ns
        if not self._said:
            return
        self._noted_overload_ns, why = overload_ns, {}
        if overload_ns is not None:
            why = {"overloaded": True, "remedy": HAZARDS[Fault.OVERLOADED].remedy}
        self._log.warning("device lost", **{"what": error.what, "where": error.where, "remedy": error.remedy} | why)

    def note_success(self) -> None:
        """Records that the device has just done its work."""
        self._backoff.reset()
        if self.lost is not None:
            self.lost = None
            if self._said:
                self._log.info("device back")


def _want_behind(error: BaseException | None) -> str | None:
    """Returns the kernel's message that descriptors or memory have run out, if that caused the error. A driver that
    cannot read a file of its configuration for this reason calls the file unreadable, which would count as permanent.
    """
    while error is not None:
        if isinstance(error, OSError) and error.errno in EXHAUSTED:
            return error.strerror
        error = error.__context__
    return None
