"""Yields the pictures of an OpenIGTLink server: IMAGE, made grey, cut out and turned."""

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable
from probewatch.drivers.device_api import Description
from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.openigtlink.client import FOLLOW_REMEDY, IgtlClient
from probewatch.drivers.openigtlink.image import grey_picture, parse_image
from probewatch.drivers.openigtlink.message import Header
from probewatch.drivers.openigtlink.options import IgtlOptions
from probewatch.drivers.openigtlink.sender_time import SenderTime
from probewatch.drivers.openigtlink.stream import Arrived
from probewatch.drivers.printable import printable
from probewatch.drivers.samples import Frame
from probewatch.drivers.video.crop import LEAST_PX

_NAME_IT = "Name one of its IMAGEs by image= in the URL"
_SEND_IT = "Have the server send its pictures as IMAGE, which is the only kind that is read"


class IgtlVideo(Closable):
    """Holds one connection. refused: count of damaged pictures. repeated: count of pictures dropped because they had
    the time of the one before.
    """

    def __init__(self, address: tuple[str, int], options: IgtlOptions, clock: HostClock) -> None:
        """Connects to the server. Raises DeviceLost."""
        self._options, self._clock = options, clock
        self.repeated = self.refused = 0
        self._shown = self._damage = ""
        self._count = 0
        self._time_ns = 0
        deadline_ns = round(options.video_deadline_ms * 1e6)
        self._client = IgtlClient(address, self._wanted, deadline_ns, options.version, clock)
        self._time = SenderTime(round(options.latency_ms * 1e6), self._client.round_trip_ns)

    def close(self) -> None:
        """See Closable."""
        self._client.close()

    def describe(self) -> Description:
        """See drivers.device_api.Identified."""
        remarks = (
            (self._time.untimed, "pictures had no time: they are stamped at their arrival"),
            (self.refused, "damaged pictures were refused"),
            (self.repeated, "pictures had the time of the one before and were dropped: each needs its own"),
        )
        said = tuple(f"{count} {words}" for count, words in remarks if count)
        if self._shown and (self._count or not self._damage):
            model = f"OpenIGTLink, picture '{self._shown}'"
            return Description(model, remarks=said, time_remedy=self._time.remedy)
        wanted = f" '{printable(self._options.image)}'" if self._options.image else ""
        if self._damage:
            absent = f"no IMAGE{wanted} could be read: {self._damage}"
            return Description("OpenIGTLink server", remarks=said, absent=absent, remedy=FOLLOW_REMEDY)
        absent = f"no IMAGE{wanted} came; the server sends {self._client.others}"
        pictures = any(name.startswith("IMAGE ") for name in self._client.received)
        return Description("OpenIGTLink server", remarks=said, absent=absent, remedy=_NAME_IT if pictures else _SEND_IT)

    def read(self, timeout_s: float) -> Frame | None:
        """Returns the next picture, or None when none came within timeout_s of the clock. Raises DeviceLost.

        A damaged picture is refused and counted; where none can be used, DeviceLost names the reason.
        """
        end_ns = self._clock.now_ns() + round(timeout_s * 1e9)
        while True:
            try:
                arrived = self._client.receive(end_ns)
                frame = None if arrived is None else self._frame(arrived)
            except ProtocolError as error:
                self.refused += 1
                self._damage = error.what
                frame = None
            if frame is not None or self._clock.now_ns() >= end_ns:
                return frame

    def _wanted(self, header: Header) -> bool:
        return header.kind == "IMAGE" and self._options.image in ("", header.device)

    def _frame(self, arrived: Arrived) -> Frame | None:
        message = arrived.message
        self._settle_on(message.device)
        self._time.note(message.time_ns)
        if message.time_ns and message.time_ns == self._time_ns:
            self.repeated += 1
            return None
        picture = parse_image(message.content)
        try:
            grey = grey_picture(picture, self._options.levels)
        except ValueError as error:
            what, _, remedy = str(error).partition(". ")
            raise self._client.lost(f"'{message.device}' {what}", remedy) from None
        shown = self._options.cut.apply(grey, self._client.where)
        if min(shown.shape) < LEAST_PX:
            raise ProtocolError(f"a picture of {shown.shape[1]} x {shown.shape[0]} pixels is not plausible")
        self._time_ns = message.time_ns
        self._count += 1
        return Frame(self._time.stamp(message.time_ns, arrived.arrival_ns), self._count - 1, shown)

    def _settle_on(self, device: str) -> None:
        """Fixes the only picture that there may be without image=: alternating ones would show two scanners as one."""
        if self._shown and device != self._shown:
            both = f"'{self._shown}' and '{device}'"
            raise self._client.lost(f"the server sends several pictures, {both}", "Name one of them by image=")
        self._shown = device
