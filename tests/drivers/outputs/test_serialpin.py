"""A serial port's control line as an output: its URL and its refusals. Pseudo-terminals have no control lines, so what
the lines do is shown on the kernel's own port in tests/cart.
"""

from pathlib import Path

import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError, DeviceLost
from probewatch.drivers.registry import open_output
from probewatch.drivers.twins.pty_line import PtyLine

CLOCK = HostClock()


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("", "pin= is not a line"),
        ("?pin=cts", "pin=cts is not a line that can be driven"),
        ("?pin=rts&sense=rts", "sense=rts is not a line that can be read"),
        ("?pin=rts&active=low", "unknown option 'active'"),
        ("?pin=rts&heartbeat=0", "heartbeat=0 is not a rate"),
    ],
)
def test_a_url_that_can_never_work_is_refused(query: str, words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        open_output(f"serialpin:/dev/ttyUSB0{query}", CLOCK)


def test_an_absent_port_is_lost() -> None:
    with pytest.raises(DeviceLost, match="no such serial port"):
        open_output("serialpin:/dev/no-such-port?pin=rts", CLOCK)


def test_a_port_without_control_lines_is_lost_not_taken_for_safe(tmp_path: Path) -> None:
    with PtyLine(tmp_path / "port", CLOCK), pytest.raises(DeviceLost, match="control line failed"):
        open_output(f"serialpin:{tmp_path}/port?pin=rts", CLOCK)
