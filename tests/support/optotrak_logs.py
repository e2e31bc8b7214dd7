"""`python -m tests.support.optotrak_logs`: the regression logs of the simulated Optotrak, and what they decode to."""

import json
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Thread

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.io.byte_log import Direction, read_log
from probewatch.drivers.samples import Pose
from probewatch.drivers.trackers.optotrak.tracker import OptotrakTracker, open_tracker
from tests.support.decoded import decoded
from tests.support.simulated_optotrak import Bench, bench, poses

LOGS = Path(__file__).parents[1] / "data" / "logs"
OPTIONS = {
    "optotrak": {"reference": "2", "deadline_ms": "1000"},
    "optotrak-single": {"mode": "single", "order": "little", "deadline_ms": "1000"},
}
_SCENES = (
    (10, []),
    (5, ["missing"]),
    (5, ["reference-missing"]),
    (10, ["events", "split"]),
    (5, ["marker-drift"]),
    (5, ["counter-jump"]),
    (2, ["error"]),
    (5, []),
)


def record(name: str) -> None:
    """One log and its decoded poses."""
    log = LOGS / f"{name}.log"
    log.unlink(missing_ok=True)
    with bench() as cart, cart.open(**OPTIONS[name], log=str(log)) as tracker:
        found = [pose for number, faults in _SCENES for pose in _scene(cart, tracker, number, faults)]
    lines = [json.dumps(entry) for entry in decoded(found)]
    (LOGS / f"{name}.json").write_text("[\n" + ",\n".join(lines) + "\n]\n")


def _scene(cart: Bench, tracker: OptotrakTracker, number: int, faults: list[str]) -> list[Pose]:
    cart.show(*faults)
    return poses(tracker, number)


@contextmanager
def recorded_server(log: Path) -> Iterator[str]:
    """The server of a log at a free port: it wants to hear what it heard, says what it said, and hangs up."""
    door = socket.create_server(("127.0.0.1", 0))
    thread = Thread(target=_play, args=(door, log))
    thread.start()
    try:
        yield f"127.0.0.1:{door.getsockname()[1]}"
    finally:
        thread.join()
        door.close()


def _play(door: socket.socket, log: Path) -> None:
    line, _ = door.accept()
    with line, suppress(OSError):
        line.settimeout(5)
        for entry in read_log(log):
            if entry.direction is Direction.RECEIVED:
                line.sendall(entry.data)
            elif _heard(line, len(entry.data)) != entry.data:
                return


def _heard(line: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count and (more := line.recv(count - len(data))):
        data += more
    return data


def play(name: str) -> list[object]:
    """What the driver makes of a log now."""
    found = []
    with (
        recorded_server(LOGS / f"{name}.log") as target,
        suppress(DeviceLost),
        open_tracker(target, OPTIONS[name] | {"deadline_ms": "400"}, HostClock()) as tracker,
    ):
        while True:
            pose = tracker.read(1.0)
            found += [] if pose is None else [pose]
    return list(decoded(found))


if __name__ == "__main__":
    for each in OPTIONS:
        record(each)
