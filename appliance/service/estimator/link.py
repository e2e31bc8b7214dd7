"""What the two processes say to each other: one message a packet, over a socket pair that keeps message bounds."""

import pickle
import socket
from dataclasses import dataclass, field

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.types import Verdict
from probewatch.drivers.samples import Matrix4

_LONGEST = 1 << 17
"""Bytes of a message; a longer one would be cut. 64 verdicts, as many as `Pairing` lets wait, of 19 checks each came to
85 kB.
"""


@dataclass(frozen=True, slots=True)
class EstimatorReport:
    """Estimator → hardware process, at least ten times a second. The counts are since the estimator's start.

    sent_ns: CLOCK_MONOTONIC when it was sent. relative_pose: as of `EstimatorSettings`, as it is known now.
    """

    generation: int
    sent_ns: int
    verdicts: tuple[Verdict, ...]
    frames: int
    poses: int
    dropped_frames: int
    dropped_poses: int
    relative_pose: Matrix4 | None = field(default=None, compare=False)


Message = EstimatorSettings | EstimatorReport


class LinkClosed(Exception):  # noqa: N818  an event, not a fault
    """The peer has gone."""


def link_pair() -> tuple[socket.socket, socket.socket]:
    """Two connected ends."""
    return socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)


def send(link: socket.socket, message: Message) -> None:
    """Blocks, or not, as the socket does. Raises LinkClosed, BlockingIOError."""
    try:
        link.send(pickle.dumps(message))
    except (BrokenPipeError, ConnectionResetError) as error:
        raise LinkClosed from error


def receive(link: socket.socket) -> Message | None:
    """The next message, None when there is none now. Never blocks. Raises LinkClosed."""
    try:
        packet = link.recv(_LONGEST, socket.MSG_DONTWAIT)
    except BlockingIOError:
        return None
    except ConnectionResetError as error:
        raise LinkClosed from error
    if not packet:
        raise LinkClosed
    message = pickle.loads(packet)
    assert isinstance(message, EstimatorSettings | EstimatorReport)
    return message
