"""What each kind of device promises: the three kinds that the appliance opens, and what some know besides."""

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
    """Frames of one scanner."""

    def read(self, timeout_s: float) -> Frame | None:
        """Next frame, or None when none came within timeout_s of the clock. Raises DeviceLost."""


class TrackerSource(_Device, Protocol):
    """Poses of the probe's marker body."""

    def read(self, timeout_s: float) -> Pose | None:
        """Next pose, or None when none came within timeout_s of the clock. Raises DeviceLost."""


@dataclass(frozen=True, slots=True)
class Description:
    """What an open device says of itself; empty or NaN where it does not say.

    tools: what it tracks, the probe's tool first. rate_hz: measurements per second. remarks: what it warned of.
    absent: that what the URL names never came, and what comes instead; remedy: what to do about it. time_remedy: what
    to do where the time of a sample is known poorly.
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
    """A device that knows more of itself than its URL."""

    def describe(self) -> Description:
        """Never asks the device again, so it costs nothing while tracking."""


@runtime_checkable
class Watched(Protocol):
    """A tracker that knows how well it can measure."""

    def body(self) -> MarkerBody:
        """The body as of the last replies; never asks the device."""


@runtime_checkable
class BumpDetector(Protocol):
    """A tracker that remembers a blow to its position sensor: until it is cleared, all its poses are FAULT."""

    def clear_bump(self) -> None:
        """A person has checked the sensor. Between reads only. Raises DeviceLost, ProtocolError."""


BUMPED = "was bumped"
"""In a remark, or the reason of a pose, of a BumpDetector for as long as the blow stands."""


class AlarmOutput(_Device, Protocol):
    """One contact in the scanner room: energised means safe."""

    def write(self, energised: bool) -> None:
        """Returns only after the device took the state. Raises DeviceLost. Leaving the context de-energises.

        Comes at least four times a second while all is well; with the option heartbeat=HZ these writes make the wave.
        """

    def read_back(self) -> bool | None:
        """Whether the contact is closed, as the hardware reports it; None where it does not report it. Raises
        DeviceLost.
        """
