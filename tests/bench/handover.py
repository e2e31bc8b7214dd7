"""What a frame costs between the driver's buffer and the estimator, and when the estimator holds it.

`python -m tests.bench.handover` measures this alone. Pictures written are counted as memory that Python and NumPy
allocate on each hop, and what reaches the ring; delays are from before the hand-over until the other process has the
pixels in memory of its own, three ways in turn: woken by the ring's pipe, the same ring looked at every 4 ms, and
multiprocessing.Pipe, which blocks its writer where nobody reads.
"""

import os
import random
import subprocess
import sys
import time
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pytest

from probewatch.appliance.limits import Limits
from probewatch.appliance.service.estimator.process_host import EstimatorHost
from probewatch.appliance.service.estimator.ring import FRAMES, Ring
from probewatch.appliance.supervision.device_health import Timeouts
from probewatch.appliance.types import Calibration
from probewatch.drivers.samples import Frame, GreyImage, Stamp
from tests.bench.receiver import METHODS, PIPED
from tests.support.frame_walk import HOPS, copies, walk
from tests.support.polling import until
from tests.support.simulated_v4l2 import noise

SIZES_PX = ((640, 480), (1920, 1080))
_WHO = {
    "read": "V4l2Video._own: driver's buffer → cut and turned",
    "put": "ring._pack_into: → shared memory",
    "take": "Ring._copy: → the estimator's memory",
}
_WALKS, _DELAYS, _IDLE_S = 60, 300, 3.0
_PAUSE_S = (0.003, 0.009)
"""Between two pictures: longer than any method takes, and in no step with the 4 ms."""


def measure() -> dict[str, Any]:
    """Tables "hops", "delays" and "idle", and the share of a picture that checksums went over."""
    hops = [_hops(size_px) for size_px in SIZES_PX]
    return {"hops": hops, "checksums": _checksums(), "delays": _delays(), "idle": _idle()}


def _hops(size_px: tuple[int, int]) -> dict[str, Any]:
    """Pictures written and median ms of each hop; copy_ms: of one copy between two arrays."""
    image = noise(*size_px)
    spent: dict[str, list[float]] = {hop: [] for hop in (*HOPS, "copy")}
    with walk("GREY", size_px) as on:
        data, spare = image.tobytes(), np.empty_like(image)
        for _ in range(_WALKS):
            on.driver.send(data)
            begun = time.perf_counter()
            frame = on.read()
            read = time.perf_counter()
            on.put(frame)
            put = time.perf_counter()
            on.take()
            taken = time.perf_counter()
            np.copyto(spare, frame.image)
            steps = np.diff([begun, read, put, taken, time.perf_counter()])
            for hop, step_s in zip(spent, steps, strict=True):
                spent[hop].append(1e3 * step_s)
    written = copies("GREY", image)
    median_ms = {hop: float(np.median(steps)) for hop, steps in spent.items()}
    rows = [{"hop": hop, "who": _WHO[hop], "written": written[hop], "median_ms": median_ms[hop]} for hop in HOPS]
    return {"size_px": list(size_px), "hops": rows, "copy_ms": median_ms["copy"]}


def _checksums() -> float:
    """Bytes that zlib's CRC-32 goes over, as a share of the picture, on its whole walk."""
    image, summed, real = noise(640, 480), [0], zlib.crc32

    def counted(data: bytes, start: int = 0) -> int:
        summed[0] += len(data)
        return real(data, start)

    with pytest.MonkeyPatch.context() as patch, walk("GREY", (640, 480)) as on:
        patch.setattr(zlib, "crc32", counted)
        on.driver.send(image.tobytes())
        on.put(on.read())
        on.take()
    return summed[0] / image.size


class _Sender(Protocol):
    fds: tuple[int, ...]

    def send(self, image: GreyImage) -> None: ...


class _ByRing:
    def __init__(self, opened: ExitStack) -> None:
        self._ring = opened.enter_context(Ring(FRAMES))
        self.fds: tuple[int, ...] = self._ring.fds

    def send(self, image: GreyImage) -> None:
        self._ring.put(Frame(Stamp(0, 0), 0, image))


class _ByPipe:
    def __init__(self, opened: ExitStack) -> None:
        theirs: Connection
        self._ours, theirs = Pipe()
        self.fds: tuple[int, ...] = (opened.enter_context(theirs).fileno(),)
        opened.enter_context(self._ours)

    def send(self, image: GreyImage) -> None:
        self._ours.send_bytes(image.ravel().data)


class _Receiver:
    """A sender and the process at its other end."""

    def __init__(self, method: str, opened: ExitStack) -> None:
        self._sender: _Sender = _ByPipe(opened) if method == PIPED else _ByRing(opened)
        reply, theirs = os.pipe()
        fds = (theirs, *self._sender.fds)
        command = [sys.executable, "-m", "tests.bench.receiver", method, *map(str, fds)]
        self._process = subprocess.Popen(command, pass_fds=fds)
        os.close(theirs)
        self._reply = opened.enter_context(os.fdopen(reply, "rb", buffering=0))
        opened.callback(self._end)
        self._reply.read(8)

    @property
    def pid(self) -> int:
        return self._process.pid

    def delay_ms(self, image: GreyImage) -> float:
        """From before the hand-over until the other process holds the picture."""
        begun_ns = time.monotonic_ns()
        self._sender.send(image)
        return (int.from_bytes(self._reply.read(8), "little") - begun_ns) / 1e6

    def _end(self) -> None:
        self._process.kill()
        self._process.wait()


@contextmanager
def _receivers() -> Iterator[dict[str, _Receiver]]:
    with ExitStack() as opened:
        yield {method: _Receiver(method, opened) for method in METHODS}


def _delays() -> list[dict[str, Any]]:
    """Quantiles of the delay, ms; the methods take turns."""
    image, pauses = noise(640, 480), random.Random(5)
    with _receivers() as receivers:
        found: dict[str, list[float]] = {method: [] for method in receivers}
        for _ in range(_DELAYS):
            for method, receiver in receivers.items():
                time.sleep(pauses.uniform(*_PAUSE_S))
                found[method].append(receiver.delay_ms(image))
    quantiles = {"p50_ms": 50, "p90_ms": 90, "p99_ms": 99, "max_ms": 100}
    return [
        {"method": method, **{name: float(np.percentile(delays, at)) for name, at in quantiles.items()}}
        for method, delays in found.items()
    ]


def _idle() -> list[dict[str, Any]]:
    """Processor time and switches a second of the estimator without samples, and of the receivers beside it."""
    reference = Calibration(np.eye(3), (1, 1), np.array([0.1, 0.1]), np.zeros(3), (640, 480))
    host = EstimatorHost(reference, Limits(), Timeouts().stale_ns)
    try:
        with _receivers() as receivers:
            until(lambda: host.poll()[0], 60)
            assert host.pid is not None
            pids = {"estimator": host.pid, **{f"receiver: {method}": one.pid for method, one in receivers.items()}}
            before = {name: _spent(pid) for name, pid in pids.items()}
            end_s = time.monotonic() + _IDLE_S
            while time.monotonic() < end_s:
                host.wait(0.05)
                host.poll()
            after = {name: _spent(pid) for name, pid in pids.items()}
    finally:
        host.close()
    rates = {name: np.subtract(after[name], before[name]) / _IDLE_S for name in pids}
    return [{"process": name, "ms_per_s": float(ms), "switches_per_s": float(n)} for name, (ms, n) in rates.items()]


def _spent(pid: int) -> tuple[float, int]:
    """(ms on a processor, voluntary switches) of its main thread since its start."""
    on_processor_ns = int(Path(f"/proc/{pid}/schedstat").read_text().split()[0])
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    switches = next(line for line in lines if line.startswith("voluntary_ctxt_switches"))
    return on_processor_ns / 1e6, int(switches.split()[1])


if __name__ == "__main__":
    # Its peers are installed for the whole bench alone.
    from tests.bench import report

    report.show_handover(measure())
