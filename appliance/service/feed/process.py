"""Runs the feed's process, which process_host starts: `-m probewatch.appliance.service.feed.process USERS FD…`."""

import os
import signal
import socket
import sys
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

from probewatch.appliance.service.estimator.ring import FRAMES, Ring
from probewatch.appliance.service.estimator.tap import NOTHING, Subscription, TapFds
from probewatch.appliance.service.feed.server import FeedServer
from probewatch.appliance.service.host.child_process import end_with_parent

_NICER = 15
"""Steps of nice(2) below the service: viewers wait for the line."""
_FIRST_KILLED = 500
"""oom_score_adj, as for the viewers outside: when memory runs out, this process is killed before the service."""


def main(arguments: list[str]) -> None:
    """Runs the process.

    arguments: ids of users who are shown no pictures, separated by commas; the descriptors of the listener and of the
    tap.
    """
    users, listener_fd, *tap = arguments
    end_with_parent(signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(OSError):
        os.nice(_NICER)
        Path("/proc/self/oom_score_adj").write_text(str(_FIRST_KILLED))
    fds = TapFds.of([int(number) for number in tap])
    without_pictures = frozenset(int(uid) for uid in users.split(",") if uid)
    subscription = Subscription(fds.subscription)
    with (
        socket.socket(fileno=int(listener_fd)) as listener,
        socket.socket(fileno=fds.packets) as packets,
        Ring(FRAMES, fds.frames) as frames,
    ):
        server = FeedServer(listener, packets, frames, subscription, without_pictures, version("probewatch"))
        try:
            server.run()
        finally:
            server.close()
            subscription.want(NOTHING)


if __name__ == "__main__":
    main(sys.argv[1:])
