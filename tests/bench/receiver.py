"""`-m tests.bench.receiver METHOD REPLY FD…`: the process at the other end, for tests.bench.handover.

It answers each picture that it holds, and first that it is ready, with its CLOCK_MONOTONIC in ns, 8 bytes.
"""

import os
import select
import signal
import sys
import time
from collections.abc import Callable
from multiprocessing.connection import Connection

import numpy as np

from probewatch.appliance.service.estimator.ring import FRAMES, Ring, RingFds
from probewatch.appliance.service.host.child_process import end_with_parent

WOKEN, POLLED, PIPED = "ring, woken", "ring, looked at every 4 ms", "multiprocessing.Pipe"
METHODS = (WOKEN, POLLED, PIPED)
_POLL_S = 0.004
"""An eighth of a picture at 30 Hz, for 250 wake-ups a second."""


def _answer(reply: int) -> None:
    os.write(reply, time.monotonic_ns().to_bytes(8, "little"))


def _woken(reply: int, fds: list[int]) -> None:
    with Ring(FRAMES, RingFds(*fds)) as ring:
        waiting = select.poll()
        waiting.register(ring, select.POLLIN)
        while True:
            waiting.poll()
            for _ in ring.take()[0]:
                _answer(reply)


def _polled(reply: int, fds: list[int]) -> None:
    with Ring(FRAMES, RingFds(*fds)) as ring:
        while True:
            for _ in ring.take()[0]:
                _answer(reply)
            select.select([], [], [], _POLL_S)


def _piped(reply: int, fds: list[int]) -> None:
    with Connection(fds[0]) as pipe:
        while True:
            np.frombuffer(pipe.recv_bytes(), np.uint8)
            _answer(reply)


_WORK: dict[str, Callable[[int, list[int]], None]] = {WOKEN: _woken, POLLED: _polled, PIPED: _piped}


def main() -> None:
    end_with_parent(signal.SIGKILL)
    reply, *fds = (int(argument) for argument in sys.argv[2:])
    _answer(reply)
    _WORK[sys.argv[1]](reply, fds)


if __name__ == "__main__":
    main()
