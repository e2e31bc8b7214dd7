"""The three kinds of device the appliance opens, and the URL scheme → module table."""

import importlib
import math
from collections.abc import Collection
from dataclasses import dataclass
from types import ModuleType, TracebackType
from typing import Protocol, Self, runtime_checkable
from urllib.parse import parse_qsl

from drivers.errors import ConfigurationError
from drivers.hosttime import HostClock
from drivers.samples import Frame, MarkerBody, Pose


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
    """

    model: str
    firmware: str = ""
    serial_number: str = ""
    tools: tuple[str, ...] = ()
    rate_hz: float = math.nan
    remarks: tuple[str, ...] = ()


@runtime_checkable
class Identified(Protocol):
    """A device that knows more of itself than its URL."""

    def describe(self) -> Description:
        """Never asks the device anew, so it costs nothing while tracking."""


@runtime_checkable
class Watched(Protocol):
    """A tracker that knows how well it can measure."""

    def body(self) -> MarkerBody:
        """As of the last replies; never asks the device."""


@runtime_checkable
class BumpDetector(Protocol):
    """A tracker that remembers a blow to its position sensor: until it is cleared, all its poses are FAULT."""

    def clear_bump(self) -> None:
        """A person has checked the sensor. Between reads only. Raises DeviceLost, ProtocolError."""


class AlarmOutput(_Device, Protocol):
    """One contact in the scanner room: energised means safe."""

    def write(self, energised: bool) -> None:
        """Returns only after the device took the state. Raises DeviceLost. Leaving the context de-energises.

        Comes at least four times a second while all is well; with the option heartbeat=HZ these writes make the wave.
        """

    def read_back(self) -> bool | None:
        """Whether the contact is closed, as the hardware reports it; None where it cannot tell. Raises DeviceLost."""


_MODULES = {
    "gpio": "drivers.gpio",
    "ndi": "drivers.ndi.tracker",
    "ndi+tcp": "drivers.ndi.network",
    "opencv": "drivers.opencv",
    "optotrak": "drivers.optotrak",
    "relay": "drivers.relay",
    "replay": "drivers.replay",
    "serialpin": "drivers.serialpin",
    "sim": "drivers.sim",
    "tone": "drivers.tone",
    "v4l2": "drivers.v4l2.source",
}

_SIMULATED = ("replay", "sim")


def is_simulated(url: str) -> bool:
    """Whether a source is a simulation or a recording, and no device that is there now."""
    return url.partition(":")[0] in _SIMULATED


def split_url(url: str) -> tuple[str, str, dict[str, str]]:
    """`scheme:target?key=value` or `scheme://host:port?key=value` → (scheme, target, options).

    Raises ConfigurationError naming the known schemes.
    """
    scheme, colon, rest = url.partition(":")
    target, _, query = rest.removeprefix("//").partition("?")
    if not colon or scheme not in _MODULES:
        known = ", ".join(f"{name}:" for name in sorted(_MODULES))
        raise ConfigurationError(f"'{scheme}:' is no known device kind", url, f"Use one of {known}")
    if not target:
        raise ConfigurationError("names no device", url, f"Write {scheme}: and then a path or an address")
    return scheme, target, dict(parse_qsl(query))


def refuse_unknown(options: Collection[str], known: Collection[str], where: str, advice: str = "") -> None:
    """Raises ConfigurationError that names an option which is none of `known`, and these; advice follows them."""
    if unknown := sorted(set(options) - set(known)):
        raise ConfigurationError(f"unknown option '{unknown[0]}'", where, f"Use {', '.join(known)}{advice}")


def device_kinds(url: str) -> tuple[str, ...]:
    """Which of "output", "tracker", "video" a URL can be opened as. Raises ConfigurationError for an unknown scheme."""
    module = importlib.import_module(_MODULES[split_url(url)[0]])
    return tuple(kind for kind in ("output", "tracker", "video") if hasattr(module, f"open_{kind}"))


def _maker(url: str, function: str, kind: str) -> tuple[ModuleType, str, dict[str, str]]:
    scheme, target, options = split_url(url)
    module = importlib.import_module(_MODULES[scheme])
    if not hasattr(module, function):
        raise ConfigurationError(f"a '{scheme}:' device is not {kind}", url, f"Give the URL of {kind}")
    return module, target, options


def open_video(url: str, clock: HostClock) -> VideoSource:
    """Raises ConfigurationError for a URL that can never work, DeviceLost for a device that is not there now."""
    module, target, options = _maker(url, "open_video", "a video source")
    source: VideoSource = module.open_video(target, options, clock)
    return source


def open_tracker(url: str, clock: HostClock) -> TrackerSource:
    """Raises ConfigurationError for a URL that can never work, DeviceLost for a device that is not there now."""
    module, target, options = _maker(url, "open_tracker", "a tracker")
    source: TrackerSource = module.open_tracker(target, options, clock)
    return source


def open_output(url: str, clock: HostClock) -> AlarmOutput:
    """Raises ConfigurationError for a URL that can never work, DeviceLost for a device that is not there now."""
    module, target, options = _maker(url, "open_output", "an alarm output")
    output: AlarmOutput = module.open_output(target, options, clock)
    return output
