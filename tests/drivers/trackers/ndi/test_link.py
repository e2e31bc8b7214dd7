"""The line to the tracker on a real pseudo-terminal: what has come counts, however late this host looks at it."""

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.trackers.ndi.link import Link, SilentError
from probewatch.drivers.trackers.ndi.transport import SerialLine
from probewatch.drivers.trackers.ndi.wire import encode_text
from probewatch.drivers.twins.pty_line import PtyLine
from tests.support.polling import until

CLOCK = HostClock()
REPLY = encode_text("OKAY")
AT_ONCE_BAUD = 10**9
TIMEOUT_NS = 200_000_000


@pytest.fixture
def device(tmp_path: Path) -> Iterator[PtyLine]:
    with PtyLine(tmp_path / "tracker", CLOCK) as device:
        yield device


@pytest.fixture
def link(device: PtyLine, tmp_path: Path) -> Iterator[Link]:
    link = Link(SerialLine(str(tmp_path / "tracker")), CLOCK)
    yield link
    link.close()


def say(device: PtyLine, link: Link, data: bytes) -> None:
    """In one piece; returns once it has arrived."""
    device.write(data, AT_ONCE_BAUD, CLOCK.now_ns())
    until(lambda: link._readable(0))


def test_a_reply_that_came_while_this_host_was_busy_is_no_silence(device: PtyLine, link: Link) -> None:
    """Else a host that is short of processor time loses a tracker that has answered every request."""
    say(device, link, REPLY)
    assert link.read_reply(CLOCK.now_ns() - 1) == REPLY
    link._received += REPLY[:3]
    say(device, link, REPLY[3:])
    assert link.read_reply(CLOCK.now_ns() - 1) == REPLY


@pytest.mark.parametrize(("come", "said"), [(b"", "no reply"), (REPLY[:5], "only 5 bytes of a reply")])
def test_what_has_not_come_by_the_deadline_is_silence(device: PtyLine, link: Link, come: bytes, said: str) -> None:
    if come:
        say(device, link, come)
    with pytest.raises(SilentError, match=said):
        link.read_reply(CLOCK.now_ns() - 1)


@pytest.mark.parametrize(
    "wait", [lambda link, end_ns: link.read_reply(end_ns), lambda link, end_ns: link.wait_quiet(50_000_000, end_ns)]
)
def test_a_device_that_never_stops_talking_holds_nobody_up(
    device: PtyLine, link: Link, wait: Callable[[Link, int], object]
) -> None:
    stop = threading.Event()

    def babble() -> None:
        while not stop.wait(0.002):
            device.write(b"x", 921600, CLOCK.now_ns())

    babbler = threading.Thread(target=babble)
    babbler.start()
    began_ns = CLOCK.now_ns()
    try:
        with pytest.raises(SilentError):
            wait(link, began_ns + TIMEOUT_NS)
    finally:
        stop.set()
        babbler.join()
    assert CLOCK.now_ns() - began_ns < 2 * TIMEOUT_NS
