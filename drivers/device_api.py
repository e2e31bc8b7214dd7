"""Defines the interface of each kind of device: the three kinds that the appliance opens, and what some of them offer
in addition.
"""

import math
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self, runtime_checkable

from probewatch.drivers.samples import Frame, MarkerBody, Pose


class _Device(Protocol):
    def __enter__(self) -> Self: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None: ...


class VideoSource(_Device, Protocol):
    """Yields the frames of one scanner."""

    def read(self, timeout_s: float) -> Frame | None:
        """Returns the next frame, or None when none came within timeout_s of the clock. Raises DeviceLost."""


class TrackerSource(_Device, Protocol):
    """Yields the poses of the probe's marker body."""

    def read(self, timeout_s: float) -> Pose | None:
        """Returns the next pose, or None when none came within timeout_s of the clock. Raises DeviceLost."""


@dataclass(frozen=True, slots=True)
class Description:
    """Holds what an open device reports about itself; a field is empty or NaN where it reports nothing.

    tools: what it tracks, the probe's tool first. rate_hz: measurements per second. remarks: what it warned of. absent:
    the statement that what the URL names never came, and what comes instead; remedy: what to do about that.
    time_remedy: what to do where the time of a sample is known poorly.
    """

    model: str
    firmware: str = ""
    serial_number: str = ""
    tools: tuple[str, ...] = ()
    rate_hz: float = math.nan
    remarks: tuple[str, ...] = ()
    absent: str = ""
    remedy: str = ""
    time_remedy: str = ""


@runtime_checkable
class Identified(Protocol):
    """Represents a device that knows more about itself than its URL states."""

    def describe(self) -> Description:
        """Returns what the device reported. Never asks the device again, so it costs nothing while tracking."""


@runtime_checkable
class Watched(Protocol):
    """Represents a tracker that reports how well it can measure."""

    def body(self) -> MarkerBody:
        """Returns the marker body as of the last replies; never asks the device."""


@runtime_checkable
class BumpDetector(Protocol):
    """Represents a tracker that remembers a blow to its position sensor: until that is cleared, all poses are FAULT."""

    def clear_bump(self) -> None:
        """Clears the blow, after a person has checked the sensor. May be called between reads only. Raises DeviceLost,
        ProtocolError.
        """


BUMPED = "was bumped"
"""Words in a remark of a BumpDetector, or in the reason of a pose, until the blow is cleared."""


class AlarmOutput(_Device, Protocol):
    """Drives one contact in the scanner room: energised means safe. Leaving the context de-energises the contact."""

    def write(self, energised: bool) -> None:
        """Sets the contact, and returns only after the device took the state. Raises DeviceLost.

        It is called at least four times a second while all is well; with the option heartbeat=HZ these calls make the
        wave.
        """

    def read_back(self) -> bool | None:
        """Returns whether the contact is closed, as the hardware reports it; None where it does not report it. Raises
        DeviceLost.
        """
