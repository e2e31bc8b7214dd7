"""Simulates a First Principles server below the parser: what it measures, and its answer to each command (RTC3D).

There is no socket, no process and no waiting here. The wording of a real server's replies is not public; only their
packet types are imitated.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from probewatch.drivers.samples import Matrix4
from probewatch.drivers.trackers.optotrak.rtc3d import (
    Body,
    ByteOrder,
    Component,
    ComponentType,
    DataFrame,
    Event,
    Force,
    Item,
    Marker,
    Packet,
    PacketType,
    Text,
)
from probewatch.drivers.twins.faults import pose_time_s, spoil_pose, spoil_witness
from probewatch.drivers.twins.tool_motion import PROBE, REFERENCE, PoseAt, on_probe

_RMS_MM, _DRIFTED_RMS_MM = 0.21, 1.4
"""Millimetres: fit of a rigid body, whole and with the marker moved: well below and above the limit, 0.75 mm
(docs/trackers.md)."""

_DRIFT_MM = (0.0, 3.0, 0.0)
"""Millimetres by which that marker is displaced."""

_DITHER_MM = 3e-4
"""Millimetres: scatter of a coordinate, 2.5 steps of a single float at 1.5 m to either side, so that poses do not stay
equal for long; real noise is a hundred times that."""

_MARKERS_MM = ((0.0, 0.0, 0.0), (40.0, 0.0, 0.0), (0.0, 55.0, 0.0), (-30.0, 20.0, 10.0))
"""Markers of a made-up body: four, not in one plane, no two distances alike."""
_COMPONENTS = {
    "3d": ComponentType.MARKERS,
    "6d": ComponentType.BODIES,
    "analog": ComponentType.ANALOG,
    "force": ComponentType.FORCE,
    "events": ComponentType.EVENTS,
}
_PARAMETERS = '<?xml version="1.0"?><Parameters><The_6D><Bodies>{}</Bodies></The_6D></Parameters>'

Current = Callable[[frozenset[ComponentType]], Packet]
"""The components that are wanted → the present frame as a packet."""


@dataclass(frozen=True, slots=True)
class Device:
    """Measures bodies and the rest of a frame. frame_hz: collection rate. bodies: number of rigid bodies. skew_ppm:
    that of the server's clock.
    """

    pose_at: PoseAt
    frame_hz: float = 100.0
    bodies: int = 2
    skew_ppm: float = 0.0

    def frame(self, number: int, active: Collection[str]) -> DataFrame:
        """Returns everything measured in one frame. Numbers and times count from world time 0."""
        t_s = number / self.frame_hz
        time_us = round(t_s * 1e6 * (1 + self.skew_ppm * 1e-6))
        seen = [
            (self._pose(index, t_s, number, active), index == 0 and "marker-drift" in active)
            for index in range(self.bodies)
        ]
        items: dict[ComponentType, tuple[Item, ...]] = {
            ComponentType.MARKERS: tuple(marker for pose, drifted in seen for marker in _markers(pose, drifted)),
            ComponentType.BODIES: tuple(_body(pose, drifted) for pose, drifted in seen),
            ComponentType.ANALOG: (0.5, float(number % 100), None),
            ComponentType.FORCE: (Force((0.0, 0.0, -9.5), (0.25, 0.0, 0.0)), None),
        }
        if "events" in active:
            items[ComponentType.EVENTS] = (Event(7, time_us, (number % 2, 0, 0)),)
        return DataFrame(tuple(Component(kind, number, time_us, found) for kind, found in items.items()))

    def _pose(self, index: int, t_s: float, number: int, active: Collection[str]) -> Matrix4 | None:
        name = (PROBE, REFERENCE)[index] if index < 2 else f"tool{index}"
        hidden = {PROBE: "missing", REFERENCE: "reference-missing"}.get(name, "witness-missing")
        if hidden in active:
            return None
        if "frozen-pose" in active:
            return self.pose_at(name, 0.0, 0)
        pose = self.pose_at(name, pose_time_s(t_s, active), number)
        if pose is None:
            return None
        if on_probe(name):
            pose = spoil_witness(pose, active)
        return _dithered(spoil_pose(pose, active) if name == PROBE else pose, index, number)


def _dithered(pose: Matrix4, index: int, number: int) -> Matrix4:
    """Adds the scatter of _DITHER_MM: no two measurements of a real tracker are equal to the last bit, not even those
    of a body that lies still.
    """
    dithered = pose.copy()
    dithered[:3, 3] += np.random.default_rng((index, number)).uniform(-_DITHER_MM, _DITHER_MM, 3)
    return dithered


def _body(pose: Matrix4 | None, drifted: bool) -> Body | None:
    if pose is None:
        return None
    qx, qy, qz, q0 = map(float, Rotation.from_matrix(pose[:3, :3]).as_quat())
    x_mm, y_mm, z_mm = map(float, pose[:3, 3])
    return Body((q0, qx, qy, qz), (x_mm, y_mm, z_mm), _DRIFTED_RMS_MM if drifted else _RMS_MM)


def _markers(pose: Matrix4 | None, drifted: bool) -> list[Marker]:
    if pose is None:
        return [Marker(None)] * len(_MARKERS_MM)
    model = np.array(_MARKERS_MM)
    model[-1] += np.multiply(_DRIFT_MM, drifted)
    return [Marker((float(x), float(y), float(z))) for x, y, z in model @ pose[:3, :3].T + pose[:3, 3]]


class Session:
    """Keeps what one client has asked for. divisor: of how many frames it gets one, 0 for none. ended: whether it said
    Bye.
    """

    def __init__(self, device: Device) -> None:
        self.order = ByteOrder.BIG
        self.divisor = 0
        self.wanted: frozenset[ComponentType] = frozenset()
        self.ended = False
        self._device = device
        self._commands: dict[str, Callable[[list[str]], str | None]] = {
            "version": lambda words: "Version 1.0 (simulated)" if words == ["1.0"] else None,
            "setbyteorder": self._set_byte_order,
            "streamframes": self._stream_frames,
            "sendcurrentframe": self._send_current_frame,
            "sendparameters": lambda _: "The parameters follow",
            "bye": self._bye,
        }

    def answer(self, request: Text, current: Current) -> tuple[Packet, ...]:
        """Returns the reply, closed by a NUL if the request was, and what follows it."""
        name, *words = request.text.lower().split() or [""]
        reply = self._commands[name](words) if name in self._commands else None
        if reply is None:
            return (Text(PacketType.ERROR, f"Error-'{request.text[:60]}' is not understood", request.terminated),)
        said = Text(PacketType.COMMAND, reply, request.terminated)
        if name == "sendparameters":
            return said, Text(PacketType.XML, self._parameters(), request.terminated)
        return (said, current(self.wanted)) if name == "sendcurrentframe" else (said,)

    def _set_byte_order(self, words: list[str]) -> str | None:
        orders = {order.word.lower(): order for order in ByteOrder}
        if len(words) != 1 or words[0] not in orders:
            return None
        self.order = orders[words[0]]
        return f"Byte order is {self.order.word}"

    def _stream_frames(self, words: list[str]) -> str | None:
        divisor, wanted = self._divisor(words[0] if words else ""), _wanted(words[1:])
        if divisor is None or wanted is None:
            return None
        self.divisor, self.wanted = divisor, wanted
        return "Streaming" if divisor else "Streaming has stopped"

    def _divisor(self, word: str) -> int | None:
        """Returns by what the frame rate is divided, 0 for no frames; None for a word that is not understood."""
        fixed = {"stop": 0, "allframes": 1}
        if word in fixed:
            return fixed[word]
        name, _, number = word.partition(":")
        if name not in ("frequency", "frequencydivisor") or not number.isdecimal() or int(number) < 1:
            return None
        return int(number) if name == "frequencydivisor" else max(1, round(self._device.frame_hz / int(number)))

    def _send_current_frame(self, words: list[str]) -> str | None:
        wanted = _wanted(words)
        if wanted is None:
            return None
        self.wanted = wanted
        return "The current frame follows"

    def _bye(self, _words: list[str]) -> str | None:
        self.divisor, self.ended = 0, True
        return "Bye"

    def _parameters(self) -> str:
        numbers = range(1, self._device.bodies + 1)
        return _PARAMETERS.format("".join(f"<Body><Name>body {number}</Name></Body>" for number in numbers))


def _wanted(words: list[str]) -> frozenset[ComponentType] | None:
    """Returns the components that the words name, all of them without words; None for a word that names none."""
    if not words or words == ["all"]:
        return frozenset(ComponentType)
    return frozenset(_COMPONENTS[word] for word in words) if set(words) <= set(_COMPONENTS) else None
