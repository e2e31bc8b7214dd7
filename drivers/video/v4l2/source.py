"""Opens `v4l2:/dev/video0` or `v4l2:/dev/v4l/by-id/…`: a frame grabber or camera through the kernel's capture
interface.

Its options are the rows of V4L2, in `drivers/video/__init__.py`.
Pictures that the driver marks as damaged are dropped and counted. The signal is checked twice a second, as drivers
continue to send pictures without one.
"""

from contextlib import ExitStack

import numpy as np

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable
from probewatch.drivers.device_api import Description
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.samples import Frame, GreyImage, Stamp
from probewatch.drivers.video import V4L2
from probewatch.drivers.video.crop import Cut, cut_from
from probewatch.drivers.video.v4l2 import abi
from probewatch.drivers.video.v4l2.negotiation import RequestedFormat, negotiate, requested_from, require_signal
from probewatch.drivers.video.v4l2.node import Node
from probewatch.drivers.video.v4l2.pixels import BrokenPicture, Bytes, grey
from probewatch.drivers.video.v4l2.stamps import Counter, FrameTimes
from probewatch.drivers.video.v4l2.stream import Filled, Stream

_ASK_AGAIN_NS = 500_000_000
"""Time between checks of the signal, ns: docs/devices.md promises its loss within half a second. Rarer checks break
that; each is some calls to the driver.
"""


def open_video(target: str, options: dict[str, str], clock: HostClock) -> "V4l2Video":
    """Opens a frame grabber; see drivers.registry for what is raised. target: path of the node."""
    return V4l2Video(target, *checked(target, options), clock)


def checked(target: str, options: dict[str, str]) -> tuple[RequestedFormat, Cut]:
    """Returns what to request from the device, and what to cut out. Raises ConfigurationError that names the option."""
    where = f"v4l2:{target}"
    given = V4L2.given(options, where)
    if not target.startswith("/"):
        raise ConfigurationError(
            "is not the path of a device", where, "Write v4l2:/dev/video0 or v4l2:/dev/v4l/by-id/…"
        )
    return requested_from(given), cut_from(given)


class V4l2Video(Closable):
    """Holds one running capture. damaged: count of pictures dropped because the driver or their bytes show that they
    are broken.
    """

    def __init__(self, path: str, requested: RequestedFormat, cut: Cut, clock: HostClock) -> None:
        self._cut, self._clock = cut, clock
        with ExitStack() as opened:
            self._node = Node(path)
            opened.callback(self._node.close)
            self.agreed = negotiate(self._node, requested)
            cut.require_within(self.agreed.width, self.agreed.height, self._node.where)
            self._stream = Stream(self._node)
            opened.callback(self._stream.close)
            self._closing = opened.pop_all()
        self._times, self._counter = FrameTimes(self.agreed.period_ns), Counter()
        self._asked_ns = clock.now_ns()
        self.damaged = 0

    def close(self) -> None:
        """See Closable."""
        self._closing.close()

    def describe(self) -> Description:
        """See drivers.device_api.Identified."""
        agreed, times = self.agreed, self._times
        remarks = [f"sends {agreed.width}x{agreed.height} pixels as {agreed.code}", *agreed.remarks]
        if self._counter.lost:
            remarks.append(f"{self._counter.lost} pictures were lost before they reached this host's memory")
        if self.damaged:
            remarks.append(f"{self.damaged} damaged pictures were dropped")
        if times.foreign:
            remarks.append(f"{times.foreign} pictures without a time of this host, stamped at their arrival")
        if times.ahead:
            remarks.append(f"{times.ahead} pictures stamped later than they arrived")
        model = ", ".join(word for word in (agreed.card, agreed.bus) if word)
        return Description(model, rate_hz=agreed.rate_hz, remarks=tuple(remarks))

    def read(self, timeout_s: float) -> Frame | None:
        """Returns the next whole picture, or None when none came within timeout_s of the clock. Raises DeviceLost."""
        self._watch_signal()
        return self._stream.take(self._clock.real_s(timeout_s), self._frame)

    def _watch_signal(self) -> None:
        now_ns = self._clock.now_ns()
        if now_ns - self._asked_ns >= _ASK_AGAIN_NS:
            self._asked_ns = now_ns
            require_signal(self._node)

    def _frame(self, filled: Filled) -> Frame | None:
        """Returns the frame in a buffer; None where it is damaged."""
        agreed, sequence = self.agreed, self._counter.count(filled.sequence)
        try:
            if filled.flags & abi.BUF_FLAG_ERROR:
                raise BrokenPicture("the driver says that it is damaged")
            image = grey(agreed.code, filled.data, agreed.width, agreed.height, agreed.bytes_per_line)
        except BrokenPicture:
            self.damaged += 1
            return None
        real = self._times.stamp(filled.flags, filled.t_ns, filled.arrival_ns)
        stamp = Stamp(self._clock.at(real.t_ns), round(real.err_ns * self._clock.rate))
        return Frame(stamp, sequence, self._own(self._cut.apply(image, self._node.where), filled.data))

    @staticmethod
    def _own(image: GreyImage, buffer: Bytes) -> GreyImage:
        """Returns the image, copied if it is a view of the driver's buffer; a decoder has already written its own."""
        return image.copy() if np.may_share_memory(image, buffer) else image
