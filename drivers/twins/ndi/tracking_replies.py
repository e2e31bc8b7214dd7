"""Encodes the measurements of all enabled tools for TX, BX and BX2."""

import re

from probewatch.drivers.clock.counter_clock import COUNTS
from probewatch.drivers.trackers.ndi import bx2
from probewatch.drivers.trackers.ndi.replies import ActiveStray, HandleState, Markers, Options, ToolReply, TrackingReply
from probewatch.drivers.twins.ndi.measurement import Measurement

READY = 0x31
_PASSIVE, _MAGNETIC = 2, 7
_PARTLY_OUTSIDE, _OUTSIDE, _INTERFERENCE, _MISSING = 3, 9, 14, 0x010D
_OUTSIDE_3D = 5
"""Combined API: port status occupied, initialised, enabled. BX2: types of frames, status of 6D items (missing: too few
markers), status of a 3D marker that is outside and used."""

_OPTION = re.compile(r"--(6d|3d|2d|1d|sensor)=(\w+)")

Measured = dict[int, tuple[int, Measurement]]
"""Port handle → (bits of the port status, what the device sees of the tool)."""


def tracking_reply(measured: Measured, frame: int, system_status: int, options: int) -> TrackingReply:
    """Returns the reply to TX and BX with the given reply options."""
    tools = tuple(_tool(handle, status, seen, frame, options) for handle, (status, seen) in measured.items())
    return TrackingReply(tools, system_status, Markers((), ()))


def _tool(handle: int, port_status: int, seen: Measurement, frame: int, options: int) -> ToolReply:
    everywhere = bool(options & Options.OUT_OF_VOLUME)
    hidden = seen.transform is None or (seen.out_of_volume and not everywhere)
    return ToolReply(
        handle,
        HandleState.MISSING if hidden else HandleState.VALID,
        None if hidden else seen.transform,
        READY | port_status | seen.status,
        frame % COUNTS,
        seen.information(),
        ActiveStray(0),
        seen.markers(everywhere),
    )


def bx2_options(arguments: str) -> dict[str, str]:
    """Returns what a BX2 request asks for, as {"6d": "tools", …}. Raises ValueError for anything else."""
    wanted = {"6d": "tools", "1d": "buttons"}
    for word in arguments.split():
        match = _OPTION.fullmatch(word)
        if match is None:
            raise ValueError(f"unknown option {word}")
        wanted[match[1]] = match[2]
    return wanted


def bx2_frame(
    measured: Measured, frame: int, time_ns: int, alerts: tuple[bx2.Alert, ...], wanted: dict[str, str], magnetic: bool
) -> bx2.Frames:
    """Returns the frame of one exposure. time_ns: time by the device's own clock."""
    components: list[bx2.Component] = []
    if wanted["6d"] == "tools":
        components.append(bx2.SixD(tuple(_tool_6d(handle, seen) for handle, (_, seen) in measured.items())))
    if wanted.get("3d") in ("tools", "all"):
        components.append(bx2.ThreeD(tuple(_tool_3d(handle, seen) for handle, (_, seen) in measured.items())))
    if alerts:
        components.append(bx2.Alerts(alerts))
    seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
    kind = _MAGNETIC if magnetic else _PASSIVE
    return bx2.Frames((bx2.FrameItem(kind, 0, 0, frame % COUNTS, seconds, nanoseconds, tuple(components)),))


def _tool_6d(handle: int, seen: Measurement) -> bx2.Tool6D:
    if seen.transform is None:
        return bx2.Tool6D(handle, _MISSING, None)
    code = _OUTSIDE if seen.out_of_volume else _PARTLY_OUTSIDE if seen.partly_outside else 0
    return bx2.Tool6D(handle, _INTERFERENCE if seen.disturbed else code, seen.transform)


def _tool_3d(handle: int, seen: Measurement) -> bx2.Tool3D:
    pairs = enumerate(zip(seen.positions_mm, seen.outside, strict=True))
    return bx2.Tool3D(handle, tuple(bx2.Marker3D(i, _OUTSIDE_3D if out else 0, place) for i, (place, out) in pairs))
