"""Reads what the feed sends for some seconds, with the time at which each sample arrived."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from probewatch.appliance.service.feed.message import Lost, Taken
from probewatch.drivers.samples import Frame, Pose
from probewatch.tools.shared.feed import Feed

_SLICE_S = 0.2
"""Seconds to wait for a message, and the delay with which the end is noticed."""


@dataclass(slots=True)
class Measured:
    """Holds the samples. frames, poses: in order, each with its arrival in ns beside it. lost: number of samples that
    the feed did not deliver.
    """

    frames: list[Frame] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)
    frames_ns: list[int] = field(default_factory=list)
    poses_ns: list[int] = field(default_factory=list)
    lost: int = 0


def measured(feed: Path, seconds: float, progress: Callable[[float], None]) -> Measured:
    """Reads the feed for some seconds. progress: is called with the share of the time that has passed. Raises
    DeviceLost, ProtocolError.
    """
    found, began_s = Measured(), time.monotonic()
    with Feed(feed) as link:
        while (over_s := time.monotonic() - began_s) < seconds:
            progress(over_s / seconds)
            message = link.next(_SLICE_S)
            if isinstance(message, Lost):
                found.lost += message.samples
            elif isinstance(message, Taken):
                _note(found, message.sample)
    return found


def _note(found: Measured, sample: Frame | Pose) -> None:
    now_ns = time.monotonic_ns()
    if isinstance(sample, Frame):
        found.frames.append(sample)
        found.frames_ns.append(now_ns)
    else:
        found.poses.append(sample)
        found.poses_ns.append(now_ns)
