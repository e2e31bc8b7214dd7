"""What the estimator hands on of every step of the line, for the feed; nothing while it has no client.

The report to the hardware process has gone out before. Pictures lie in a ring of their own, everything else goes as one
packet a step through a socket pair that never blocks: a reader that is behind misses whole steps, and their numbers say
how many. What is wanted stands in a shared page, so that a step of a line without subscribers costs one look at it.
"""

import contextlib
import mmap
import os
import pickle
import socket
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.service.estimator.ring import FRAMES, Ring, RingFds
from probewatch.appliance.types import Verdict
from probewatch.drivers.samples import Frame, Pose, Sample, Stamp

LONGEST_PACKET = 1 << 17
"""Bytes of one packet; a longer one would be cut. See `link`, whose reports hold as many verdicts."""
_PAGE = mmap.PAGESIZE
_WANTED, _EPOCH, _COUNTS = 0, 1, 8
"""Places in the page: what is wanted, a count of those who began to want it, and what the status reports of them."""
_COUNTED = struct.Struct("<3Q")  # clients, lost, dropped
NOTHING, ALL_BUT_PICTURES, PICTURES = 0, 1, 2
"""What is subscribed to."""


class Subscription:
    """What the feed subscribes to, in a shared page. The feed's process writes it, the estimator reads it; each may die
    at any time.
    """

    def __init__(self, fd: int | None = None) -> None:
        """Raises OSError, and then leaves nothing open that it has made."""
        self.fd = os.memfd_create("probewatch-subscription") if fd is None else fd
        try:
            if fd is None:
                os.ftruncate(self.fd, _PAGE)
            self._page = mmap.mmap(self.fd, _PAGE)
        except OSError:
            if fd is None:
                os.close(self.fd)
            raise

    def close(self) -> None:
        """Release it; it is freed when the others have gone too."""
        self._page.close()
        os.close(self.fd)

    @property
    def wanted(self) -> int:
        """NOTHING, ALL_BUT_PICTURES or PICTURES."""
        return self._page[_WANTED]

    @property
    def epoch(self) -> int:
        """Changes whenever a subscription begins, which must be sent the settings in force."""
        return self._page[_EPOCH]

    def want(self, wanted: int) -> None:
        """Subscribe to this from now on."""
        if wanted and not self._page[_WANTED]:
            self._page[_EPOCH] = (self._page[_EPOCH] + 1) % 256
        self._page[_WANTED] = wanted

    def count(self, counts: "FeedCounts") -> None:
        """Write how the feed does, for the status."""
        _COUNTED.pack_into(self._page, _COUNTS, *counts)

    @property
    def counts(self) -> "FeedCounts":
        """The last that was counted."""
        return FeedCounts(*_COUNTED.unpack_from(self._page, _COUNTS))


class FeedCounts(NamedTuple):
    """clients: that listen now. lost: samples that were not sent to a client, of all clients since the start of
    the estimator. dropped: clients that were sent away, or did not read.
    """

    clients: int = 0
    lost: int = 0
    dropped: int = 0


class TapFds(NamedTuple):
    """What the estimator needs: the socket for packets, the ring of pictures, the page."""

    packets: int
    frames: RingFds
    subscription: int

    @classmethod
    def of(cls, numbers: Sequence[int]) -> Self:
        """Made from five numbers of a command line."""
        packets, *ring, subscription = numbers
        return cls(packets, RingFds(*ring), subscription)

    @property
    def flat(self) -> tuple[int, ...]:
        return (self.packets, *self.frames, self.subscription)


@dataclass(frozen=True, slots=True)
class Begun:
    """The line works by these settings; step: how many samples this line has taken before. None: there is no line."""

    settings: EstimatorSettings | None
    step: int


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A frame of the ring of pictures, if `there`, by what marks it."""

    stamp: Stamp
    sequence: int
    there: bool


@dataclass(frozen=True, slots=True, eq=False)
class Taken:
    """Step number `step` of the line: what it took, and the verdicts that it gave."""

    step: int
    sample: Pose | Picture
    verdicts: tuple[Verdict, ...]


Packet = Begun | Taken


class Tap:
    """The estimator's end. Never blocks, and raises nothing for a feed that is gone."""

    def __init__(self, fds: TapFds) -> None:
        self._packets = socket.socket(fileno=fds.packets)
        self._packets.setblocking(False)
        self._frames = Ring(FRAMES, fds.frames)
        self._subscription = Subscription(fds.subscription)
        self._settings: EstimatorSettings | None = None
        self._step = 0
        self._begun_epoch: int | None = None

    def begin(self, settings: EstimatorSettings) -> None:
        """A line was made by these settings; it has taken nothing yet."""
        self._settings, self._step, self._begun_epoch = settings, 0, None

    @property
    def wanted(self) -> bool:
        """Whether there is a subscription."""
        return self._subscription.wanted != NOTHING

    def publish(self, sample: Sample, verdicts: tuple[Verdict, ...]) -> None:
        """What the line took, or without a line would have taken, and what it said of it."""
        step, wanted = self._step, self._subscription.wanted
        self._step += 1
        if wanted == NOTHING or not self._has_begun(step):
            return
        if isinstance(sample, Frame):
            if wanted == PICTURES:
                self._frames.put(sample)
            self._send(Taken(step, Picture(sample.stamp, sample.sequence, wanted == PICTURES), verdicts))
        else:
            self._send(Taken(step, sample, verdicts))

    def close(self) -> None:
        """Release the descriptors."""
        self._packets.close()
        self._frames.close()
        self._subscription.close()

    def _has_begun(self, step: int) -> bool:
        """Whether the feed has got the settings by which this line works."""
        epoch = self._subscription.epoch
        if epoch != self._begun_epoch and self._send(Begun(self._settings, step)):
            self._begun_epoch = epoch
        return epoch == self._begun_epoch

    def _send(self, packet: Packet) -> bool:
        with contextlib.suppress(OSError):
            self._packets.send(pickle.dumps(packet))
            return True
        return False


def received(packets: socket.socket) -> Packet | None:
    """The next packet, None when there is none now. Never blocks. Raises ConnectionResetError at its end."""
    try:
        packet = packets.recv(LONGEST_PACKET, socket.MSG_DONTWAIT)
    except BlockingIOError:
        return None
    if not packet:
        raise ConnectionResetError
    found = pickle.loads(packet)
    assert isinstance(found, Begun | Taken)
    return found
