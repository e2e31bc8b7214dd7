"""Finds the driver of a URL by its scheme, and imports its module only when it is used.

Each folder of drivers lists its descriptors as DRIVERS in its `__init__.py` (drivers/descriptor.py).
"""

import importlib
import re
from collections.abc import Collection
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.descriptor import TARGETS, Driver
from probewatch.drivers.device_api import AlarmOutput, TrackerSource, VideoSource
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.suggestion import did_you_mean, suggested

_CALLED = {"tracker": "a tracker", "video": "a video source", "output": "an alarm output"}
_KINDS = tuple(_CALLED)
_HERE = Path(__file__).parent


@cache
def drivers() -> dict[str, Driver]:
    """Returns scheme → descriptor of every driver, trackers first, servers of several kinds last; imports no driver."""
    rooms = sorted(file.parent.relative_to(_HERE).parts for file in _HERE.glob("*/**/__init__.py"))
    packages = (importlib.import_module(".".join((__package__, *room))) for room in rooms if room[0] != "twins")
    rows = [row for package in packages for row in getattr(package, "DRIVERS", ())]
    found = {row.scheme: row for row in sorted(rows, key=lambda row: (len(row.kinds), _KINDS.index(row.kinds[0])))}
    assert len(found) == len(rows), "two drivers have one scheme"
    return found


def is_simulated(url: str) -> bool:
    """Returns whether a source is a simulation or a recording rather than a device that is there now. What a server
    forwards is not known here, so its URL states it.
    """
    driver = drivers().get(url.partition(":")[0])
    options = dict(_pairs(url.partition("?")[2]))
    return (driver is not None and driver.is_simulated) or options.get("simulated") == "yes"


def split_url(url: str, kind: str = "") -> tuple[str, str, dict[str, str]]:
    """Splits `scheme:target?key=value` or `scheme://host:port?key=value` into (scheme, target, options).

    Raises ConfigurationError that names the scheme that may have been meant, or else the known ones, of this kind if
    one is given.
    """
    scheme, colon, rest = url.partition(":")
    target, _, query = rest.removeprefix("//").partition("?")
    if scheme not in drivers() or not colon:
        raise _no_scheme(url, kind) if scheme not in drivers() else _no_device(url, scheme)
    if not target:
        raise _no_device(url, scheme)
    return scheme, target, _options(query, url)


def _pairs(query: str) -> list[tuple[str, str]]:
    """Returns (key, value) of each part, in order. A "+" remains one, since it may be in the name of a file."""
    parts = (part.partition("=") for part in query.split("&") if part)
    return [(unquote(key), unquote(value)) for key, _, value in parts]


def _options(query: str, url: str) -> dict[str, str]:
    """Returns the options of a query. Raises ConfigurationError for those that would otherwise be ignored: an option
    without a value, or one given twice.
    """
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
    close = suggested(scheme, fitting) if colon else []
    meant = (
        [f"{one}:{rest}" for one in close]
        if close
        else [one for one in _likely(url) if one.partition(":")[0] in fitting]
    )
    remedy = did_you_mean(meant) or f"Use one of {_listed(fitting)}"
    what = f"'{scheme}:' is not a known device kind" if colon else "does not say of which kind the device is"
    return ConfigurationError(what, url, remedy)


def _likely(url: str) -> list[str]:
    """Returns the URLs that may have been meant by a text without a scheme."""
    looks = (one for one in TARGETS if one.looks_like and re.fullmatch(one.looks_like, url, re.IGNORECASE))
    target = next(looks, None)
    return [one.url(url.removeprefix("tcp://")) for one in drivers().values() if target in one.targets]


def _fitting(kind: str) -> list[str]:
    return sorted(name for name, driver in drivers().items() if kind in ("", *driver.kinds))


def _listed(schemes: Collection[str]) -> str:
    return ", ".join(f"{scheme}:" for scheme in schemes)


def known_schemes() -> tuple[str, ...]:
    """Returns every URL scheme for which there is a driver."""
    return tuple(drivers())


def device_kinds(url: str) -> tuple[str, ...]:
    """Returns the kinds, of "output", "tracker" and "video", that a URL can be opened as. Raises ConfigurationError for
    an unknown scheme.
    """
    return drivers()[split_url(url)[0]].kinds


def checked_url(url: str, kind: str) -> str:
    """Returns the URL itself. Raises ConfigurationError where it cannot be opened as this kind; ignores options."""
    scheme, _, _ = split_url(url, kind)
    kinds = drivers()[scheme].kinds
    if kind not in kinds:
        what = f"'{scheme}:' is {_CALLED[kinds[0]]}, not {_CALLED[kind]}"
        raise ConfigurationError(what, url, f"Use one of {_listed(_fitting(kind))}")
    return url


def check_options(url: str, kind: str) -> None:
    """Raises ConfigurationError for a URL that can never work, as far as can be known without opening anything."""
    checked_url(url, kind)
    scheme, target, options = split_url(url)
    importlib.import_module(drivers()[scheme].module).checked(target, options)


def _opened(url: str, kind: str, clock: HostClock) -> Any:
    scheme, target, options = split_url(checked_url(url, kind))
    return getattr(importlib.import_module(drivers()[scheme].module), f"open_{kind}")(target, options, clock)


def open_video(url: str, clock: HostClock) -> VideoSource:
    """Opens a video source. Raises ConfigurationError for a URL that can never work, DeviceLost for a device that is
    not there now.
    """
    source: VideoSource = _opened(url, "video", clock)
    return source


def open_tracker(url: str, clock: HostClock) -> TrackerSource:
    """Opens a tracker. Raises ConfigurationError for a URL that can never work, DeviceLost for a device that is not
    there now.
    """
    source: TrackerSource = _opened(url, "tracker", clock)
    return source


def open_output(url: str, clock: HostClock) -> AlarmOutput:
    """Opens an alarm output. Raises ConfigurationError for a URL that can never work, DeviceLost for a device that is
    not there now.
    """
    output: AlarmOutput = _opened(url, "output", clock)
    return output
