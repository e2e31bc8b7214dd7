"""URL → driver: which module serves which scheme, imported only when it is used.

Each module has open_video, open_tracker or open_output (target, options, clock), and `checked` (target, options), which
opens nothing.
"""

import difflib
import importlib
import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote

from drivers.clock.host_clock import HostClock
from drivers.device_api import AlarmOutput, TrackerSource, VideoSource
from drivers.errors import ConfigurationError


@dataclass(frozen=True, slots=True)
class _Driver:
    """module: its code. kinds: what it can be opened as."""

    module: str
    kinds: tuple[str, ...]


_DRIVERS = {
    "gpio": _Driver("drivers.outputs.gpio", ("output",)),
    "igtl": _Driver("drivers.openigtlink.source", ("tracker", "video")),
    "ndi": _Driver("drivers.trackers.ndi.tracker", ("tracker",)),
    "ndi+tcp": _Driver("drivers.trackers.ndi.network", ("tracker",)),
    "opencv": _Driver("drivers.video.opencv", ("video",)),
    "optotrak": _Driver("drivers.trackers.optotrak.tracker", ("tracker",)),
    "relay": _Driver("drivers.outputs.relay", ("output",)),
    "replay": _Driver("drivers.recordings.replay", ("tracker", "video")),
    "serialpin": _Driver("drivers.outputs.serialpin", ("output",)),
    "sim": _Driver("drivers.video.sim", ("video",)),
    "tone": _Driver("drivers.outputs.tone", ("output",)),
    "v4l2": _Driver("drivers.video.v4l2.source", ("video",)),
}

_SIMULATED = ("replay", "sim")


def is_simulated(url: str) -> bool:
    """Whether a source is a simulation or a recording, and no device that is there now; a server cannot be looked
    through, so its URL says it.
    """
    options = dict(_pairs(url.partition("?")[2]))
    return url.partition(":")[0] in _SIMULATED or options.get("simulated") == "yes"


_CALLED = {"output": "an alarm output", "tracker": "a tracker", "video": "a video source"}
_LOOKS_LIKE = (
    (r"/dev/(tty|serial/|cu\.).*", ("ndi:{}", "relay:{}", "serialpin:{}?pin=rts")),
    (r"/dev/(video|v4l/).*", ("v4l2:{}",)),
    (r"/dev/gpiochip.*", ("gpio:{}?line=17",)),
    (r"(rtsp|rtsps|rtmp|http|https|udp)://.*", ("opencv:{}",)),
    (r".*\.(mha|mhd)", ("replay:{}",)),
    (r".*\.(mp4|avi|mkv|mov)", ("opencv:{}",)),
    (r"(tcp://)?[\w.-]*[\w-](:\d+)?", ("ndi+tcp://{}", "optotrak://{}", "igtl://{}")),
)
"""What people write for a URL, and what they may have meant."""


def split_url(url: str, kind: str = "") -> tuple[str, str, dict[str, str]]:
    """`scheme:target?key=value` or `scheme://host:port?key=value` → (scheme, target, options).

    Raises ConfigurationError naming what may have been meant, or the known schemes, of this kind if one is given.
    """
    scheme, colon, rest = url.partition(":")
    target, _, query = rest.removeprefix("//").partition("?")
    if scheme not in _DRIVERS or not colon:
        raise _no_scheme(url, kind) if scheme not in _DRIVERS else _no_device(url, scheme)
    if not target:
        raise _no_device(url, scheme)
    return scheme, target, _options(query, url)


def _pairs(query: str) -> list[tuple[str, str]]:
    """(key, value) of each part, in order. A "+" stays one, since it may be in the name of a file."""
    parts = (part.partition("=") for part in query.split("&") if part)
    return [(unquote(key), unquote(value)) for key, _, value in parts]


def _options(query: str, url: str) -> dict[str, str]:
    """Raises ConfigurationError for what would be passed over: an option without a value, or one that comes twice."""
    options: dict[str, str] = {}
    for key, value in _pairs(query):
        if not key:
            raise ConfigurationError(f"'={value}' names no option", url, "Write ?OPTION=VALUE&OPTION=VALUE")
        if not value:
            remedy = f"Write {key}=VALUE, or leave it out"
            raise ConfigurationError(f"option '{key}' has no value", url, remedy)
        if key in options:
            remedy = f"Write {key}= once"
            raise ConfigurationError(f"option '{key}' is given twice, as {options[key]} and {value}", url, remedy)
        options[key] = value
    return options


def _no_device(url: str, scheme: str) -> ConfigurationError:
    return ConfigurationError("names no device", url, f"Write {scheme}: and then a path or an address")


def _no_scheme(url: str, kind: str) -> ConfigurationError:
    scheme, colon, rest = url.partition(":")
    fitting = _fitting(kind)
    close = difflib.get_close_matches(scheme.lower(), fitting, n=1, cutoff=0.6) if colon else []
    meant = [f"{close[0]}:{rest}"] if close else [one for one in _likely(url) if one.partition(":")[0] in fitting]
    remedy = f"Did you mean {' or '.join(meant)}?" if meant else f"Use one of {_listed(fitting)}"
    what = f"'{scheme}:' is not a known device kind" if colon else "does not say of which kind the device is"
    return ConfigurationError(what, url, remedy)


def _likely(url: str) -> list[str]:
    forms = (forms for pattern, forms in _LOOKS_LIKE if re.fullmatch(pattern, url, re.IGNORECASE))
    return [form.format(url.removeprefix("tcp://")) for form in next(forms, ())]


def _fitting(kind: str) -> list[str]:
    return sorted(name for name, driver in _DRIVERS.items() if kind in ("", *driver.kinds))


def _listed(schemes: Collection[str]) -> str:
    return ", ".join(f"{scheme}:" for scheme in schemes)


def refuse_unknown(options: Collection[str], known: Collection[str], where: str, advice: str = "") -> None:
    """Raises ConfigurationError that names an option which is none of `known`, and these; advice follows them."""
    if unknown := sorted(set(options) - set(known)):
        raise ConfigurationError(f"unknown option '{unknown[0]}'", where, f"Use {', '.join(known)}{advice}")


def known_schemes() -> tuple[str, ...]:
    """Every URL scheme that there is a driver for."""
    return tuple(_DRIVERS)


def device_kinds(url: str) -> tuple[str, ...]:
    """Which of "output", "tracker", "video" a URL can be opened as. Raises ConfigurationError for an unknown scheme."""
    return _DRIVERS[split_url(url)[0]].kinds


def checked_url(url: str, kind: str) -> str:
    """The URL itself. Raises ConfigurationError for one that cannot be opened as this kind; options are not read."""
    scheme, _, _ = split_url(url, kind)
    kinds = _DRIVERS[scheme].kinds
    if kind not in kinds:
        what = f"'{scheme}:' is {_CALLED[kinds[0]]}, not {_CALLED[kind]}"
        raise ConfigurationError(what, url, f"Use one of {_listed(_fitting(kind))}")
    return url


def check_options(url: str, kind: str) -> None:
    """Raises ConfigurationError for a URL that can never work, as far as it tells without opening anything."""
    checked_url(url, kind)
    scheme, target, options = split_url(url)
    importlib.import_module(_DRIVERS[scheme].module).checked(target, options)


def _opened(url: str, kind: str, clock: HostClock) -> Any:
    scheme, target, options = split_url(checked_url(url, kind))
    return getattr(importlib.import_module(_DRIVERS[scheme].module), f"open_{kind}")(target, options, clock)


def open_video(url: str, clock: HostClock) -> VideoSource:
    """Raises ConfigurationError for a URL that can never work, DeviceLost for a device that is not there now."""
    source: VideoSource = _opened(url, "video", clock)
    return source


def open_tracker(url: str, clock: HostClock) -> TrackerSource:
    """Raises ConfigurationError for a URL that can never work, DeviceLost for a device that is not there now."""
    source: TrackerSource = _opened(url, "tracker", clock)
    return source


def open_output(url: str, clock: HostClock) -> AlarmOutput:
    """Raises ConfigurationError for a URL that can never work, DeviceLost for a device that is not there now."""
    output: AlarmOutput = _opened(url, "output", clock)
    return output
