"""Defines the messages between the two processes: one a packet, over a socket pair that keeps message boundaries."""

import pickle
import socket
from dataclasses import dataclass, field

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.types import Verdict
from probewatch.drivers.samples import Matrix4

_LONGEST = 1 << 17
"""Bytes, the longest message; more would be truncated. 64 verdicts, as many as `Pairing` lets wait, of 19 checks each
came to 85 kB.
"""


@dataclass(frozen=True, slots=True)
class EstimatorReport:
    """Reports from the estimator to the hardware process, at least ten times a second.

    The counts run from the estimator's start. sent_ns: CLOCK_MONOTONIC when the report was sent. relative_pose: as in
    `EstimatorSettings`, as far as it is known now.
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
    """Signals that the peer has gone."""


def link_pair() -> tuple[socket.socket, socket.socket]:
    """Returns two connected ends."""
    return socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)


def send(link: socket.socket, message: Message) -> None:
    """Sends a message; whether it blocks depends on the socket. Raises LinkClosed, BlockingIOError."""
    try:
        link.send(pickle.dumps(message))
    except (BrokenPipeError, ConnectionResetError) as error:
        raise LinkClosed from error


def receive(link: socket.socket) -> Message | None:
    """Returns the next message, or None when none is waiting. Never blocks. Raises LinkClosed."""
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
