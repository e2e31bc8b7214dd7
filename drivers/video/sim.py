"""Opens `sim:/path/to/socket`: raw frames of a simulated scanner over a Unix stream socket.

Each frame is a header of 36 bytes, little-endian, and then height × width grey bytes, row by row:
"PWSV", version u16 = 1, bits per pixel u16 = 8, sequence u64, t_ns i64 (mid-exposure, host CLOCK_MONOTONIC),
err_ns u32 (bound of its error), width u32, height u32.
"""

import os
import socket
import struct
import time
from dataclasses import dataclass

import numpy as np

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable
from probewatch.drivers.errors import ConfigurationError, DeviceLost, ProtocolError
from probewatch.drivers.samples import Frame, GreyImage, Stamp
from probewatch.drivers.video import SIM
from probewatch.drivers.video.crop import LEAST_PX

_LAYOUT = struct.Struct("<4sHHQqIII")
_MAGIC, _VERSION, _BITS = b"PWSV", 1, 8
"""Header, as the docstring of this module describes it."""

_SIZE_PX = range(LEAST_PX, 4097)
"""Plausible sides of a picture. The largest, 16 MB, is the most for which a false header can make us wait."""

_PATH_BYTES = 107
"""Longest path of a socket by Linux, unix(7): 108 with the closing zero."""

_CONNECT_S = 1.0
"""Seconds to connect. The scanner is on this host and accepts at once, or its queue is full; more delays the report."""

_CHUNK_BYTES = 1 << 20
"""Bytes read at a time: three pictures of 640 × 480. Less takes more calls for a picture, more only memory."""

HEADER_BYTES = _LAYOUT.size


@dataclass(frozen=True, slots=True)
class FrameHeader:
    """Represents what precedes the pixels. t_ns, err_ns: see drivers.samples.Stamp."""

    sequence: int
    t_ns: int
    err_ns: int
    width_px: int
    height_px: int

    @property
    def body_bytes(self) -> int:
        """Returns the number of pixel bytes that follow."""
        return self.width_px * self.height_px

    def pack(self) -> bytes:
        """Returns the 36 bytes that parse() reads."""
        numbers = (self.sequence, self.t_ns, self.err_ns, self.width_px, self.height_px)
        return _LAYOUT.pack(_MAGIC, _VERSION, _BITS, *numbers)

    @classmethod
    def parse(cls, data: bytes, where: str = "") -> "FrameHeader":
        """Parses exactly HEADER_BYTES bytes. Raises ProtocolError that names the field that is wrong."""
        if len(data) != HEADER_BYTES:
            raise ProtocolError(f"a frame header has {HEADER_BYTES} bytes, not {len(data)}", where)
        magic, version, bits, *numbers = _LAYOUT.unpack(data)
        header = cls(*numbers)
        if magic != _MAGIC:
            raise ProtocolError(f"no frame starts here: {magic!r} instead of {_MAGIC!r}", where, _OTHER_END)
        if (version, bits) != (_VERSION, _BITS):
            raise ProtocolError(f"version {version} with {bits} bits per pixel is not understood", where, _OTHER_END)
        if header.width_px not in _SIZE_PX or header.height_px not in _SIZE_PX:
            size = f"{header.width_px} x {header.height_px}"
            raise ProtocolError(f"a picture of {size} pixels is not plausible", where, _OTHER_END)
        return header


_OTHER_END = "Check what listens at the other end of the socket"


def pack_frame(sequence: int, t_ns: int, err_ns: int, image: GreyImage) -> bytes:
    """Returns one frame as the socket carries it. image: (height, width) uint8."""
    height, width = image.shape
    return FrameHeader(sequence, t_ns, err_ns, width, height).pack() + image.tobytes()


def open_video(target: str, options: dict[str, str], clock: HostClock) -> "SimVideo":
    """Connects to a simulated scanner; see drivers.registry for what is raised. target: path of the socket."""
    where = checked(target, options)
    line = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    line.settimeout(_CONNECT_S)
    try:
        line.connect(target)
    except OSError as error:
        line.close()
        reason = error.strerror or "no answer"
        raise DeviceLost(f"no video ({reason.lower()})", where, "Check that the simulated scanner is running") from None
    return SimVideo(line, where, clock)


def checked(target: str, options: dict[str, str]) -> str:
    """Returns the URL. Raises ConfigurationError for an option, or a path that is too long."""
    where = f"sim:{target}"
    SIM.given(options, where)
    if len(os.fsencode(target)) > _PATH_BYTES:
        raise ConfigurationError(
            f"the path is longer than {_PATH_BYTES} bytes", where, "Put the socket nearer to the root"
        )
    return where


class SimVideo(Closable):
    """Holds one connection; a frame that arrives in parts is kept until it is whole."""

    def __init__(self, line: socket.socket, where: str, clock: HostClock) -> None:
        self._line, self._where, self._clock = line, where, clock
        self._received = bytearray()

    def close(self) -> None:
        """See Closable."""
        self._line.close()

    def read(self, timeout_s: float) -> Frame | None:
        """Returns the next frame, or None when none was whole within timeout_s of the clock. Raises DeviceLost,
        ProtocolError.
        """
        end_s = time.monotonic() + self._clock.real_s(timeout_s)
        while True:
            frame = self._take()
            if frame is not None:
                return frame
            remaining_s = end_s - time.monotonic()
            if remaining_s <= 0 or not self._receive(remaining_s):
                return None

    def _take(self) -> Frame | None:
        """Returns the first whole frame that has arrived; None where there is none."""
        if len(self._received) < HEADER_BYTES:
            return None
        header = FrameHeader.parse(bytes(self._received[:HEADER_BYTES]), self._where)
        end = HEADER_BYTES + header.body_bytes
        if len(self._received) < end:
            return None
        pixels = np.frombuffer(self._received, np.uint8, header.body_bytes, HEADER_BYTES).copy()
        del self._received[:end]
        stamp = Stamp(header.t_ns, header.err_ns)
        return Frame(stamp, header.sequence, pixels.reshape(header.height_px, header.width_px))

    def _receive(self, timeout_s: float) -> bool:
        """Receives bytes. Returns False where none came."""
        self._line.settimeout(timeout_s)
        try:
            data = self._line.recv(_CHUNK_BYTES)
        except TimeoutError:
            return False
        except OSError as error:
            raise DeviceLost(f"video broke off ({error.strerror})", self._where) from None
        if not data:
            part = " in the middle of a frame" if self._received else ""
            raise DeviceLost(f"the scanner closed the video{part}", self._where, "Check the scanner's video output")
        self._received += data
        return True
