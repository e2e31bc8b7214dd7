"""Publishes every step of the line to the feed, and nothing while the feed has no client.

The report to the hardware process goes out first. Pictures go through a ring of their own; everything else goes as one
packet a step through a socket pair that never blocks: a reader that is behind misses whole steps, and the step numbers
show how many. A shared page states what is wanted, so that a step of a line without subscribers costs one look at it.
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
"""Bytes, the longest packet; a longer one would be truncated. See `link`, whose reports hold as many verdicts."""
_PAGE = mmap.PAGESIZE
_WANTED, _EPOCH, _COUNTS = 0, 1, 8
"""Offsets in the page: what is wanted, a count of subscriptions begun, and the counts that the status reports."""
_COUNTED = struct.Struct("<3Q")  # clients, lost, dropped
NOTHING, ALL_BUT_PICTURES, PICTURES = 0, 1, 2
"""Values of a subscription, by what the feed receives."""


class Subscription:
    """Holds in a shared page what the feed subscribes to. The feed's process writes it, the estimator reads it, and
    either may die at any time.
    """

    def __init__(self, fd: int | None = None) -> None:
        """Raises OSError, and then leaves open nothing that it has made."""
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
        """Releases the page; it is freed when the others have gone too."""
        self._page.close()
        os.close(self.fd)

    @property
    def wanted(self) -> int:
        """Returns NOTHING, ALL_BUT_PICTURES or PICTURES."""
        return self._page[_WANTED]

    @property
    def epoch(self) -> int:
        """Returns a number that changes whenever a subscription begins, as that must be sent the settings in force."""
        return self._page[_EPOCH]

    def want(self, wanted: int) -> None:
        """Subscribes to this from now on."""
        if wanted and not self._page[_WANTED]:
            self._page[_EPOCH] = (self._page[_EPOCH] + 1) % 256
        self._page[_WANTED] = wanted

    def count(self, counts: "FeedCounts") -> None:
        """Writes the counts of the feed, for the status."""
        _COUNTED.pack_into(self._page, _COUNTS, *counts)

    @property
    def counts(self) -> "FeedCounts":
        """Returns the last counts written."""
        return FeedCounts(*_COUNTED.unpack_from(self._page, _COUNTS))


class FeedCounts(NamedTuple):
    """Counts what the feed did. clients: those connected now. lost: samples that were not sent to a client, over all
    clients since the start of the estimator. dropped: clients that were disconnected, or did not read.
    """

    clients: int = 0
    lost: int = 0
    dropped: int = 0


class TapFds(NamedTuple):
    """Holds the descriptors that the estimator needs: the socket for packets, the ring of pictures, the page."""

    packets: int
    frames: RingFds
    subscription: int

    @classmethod
    def of(cls, numbers: Sequence[int]) -> Self:
        """Returns the descriptors from the five numbers of a command line."""
        packets, *ring, subscription = numbers
        return cls(packets, RingFds(*ring), subscription)

    @property
    def flat(self) -> tuple[int, ...]:
        return (self.packets, *self.frames, self.subscription)


@dataclass(frozen=True, slots=True)
class Begun:
    """Announces the settings that the line works by.

    settings: None where there is no line. step: number of samples that this line has taken before.
    """

    settings: EstimatorSettings | None
    step: int


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """Represents a frame by its stamp and sequence number. there: the frame itself lies in the ring of pictures."""

    stamp: Stamp
    sequence: int
    there: bool


@dataclass(frozen=True, slots=True, eq=False)
class Taken:
    """Describes step number `step` of the line: the sample that it took, and the verdicts that it gave."""

    step: int
    sample: Pose | Picture
    verdicts: tuple[Verdict, ...]


Packet = Begun | Taken


class Tap:
    """Represents the estimator's end of the tap. Never blocks, and raises nothing when the feed is gone."""

    def __init__(self, fds: TapFds) -> None:
        self._packets = socket.socket(fileno=fds.packets)
        self._packets.setblocking(False)
        self._frames = Ring(FRAMES, fds.frames)
        self._subscription = Subscription(fds.subscription)
        self._settings: EstimatorSettings | None = None
        self._step = 0
        self._begun_epoch: int | None = None

    def begin(self, settings: EstimatorSettings) -> None:
        """Records that a line was made with these settings; it has taken nothing yet."""
        self._settings, self._step, self._begun_epoch = settings, 0, None

    @property
    def wanted(self) -> bool:
        """Returns whether there is a subscription."""
        return self._subscription.wanted != NOTHING

    def publish(self, sample: Sample, verdicts: tuple[Verdict, ...]) -> None:
        """Publishes what the line took, or would have taken if there were one, and its verdicts."""
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
        """Releases the descriptors."""
        self._packets.close()
        self._frames.close()
        self._subscription.close()

    def _has_begun(self, step: int) -> bool:
        """Returns whether the feed has received the settings by which this line works."""
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
    """Returns the next packet, None when none is waiting. Never blocks. Raises ConnectionResetError at the end."""
    try:
        packet = packets.recv(LONGEST_PACKET, socket.MSG_DONTWAIT)
    except BlockingIOError:
        return None
    if not packet:
        raise ConnectionResetError
    found = pickle.loads(packet)
    assert isinstance(found, Begun | Taken)
    return found
