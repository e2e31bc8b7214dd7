"""Opens a TCP connection to a device, within one deadline that covers the name, every address and the handshake."""

import re
import socket
import struct
import threading
import time

from probewatch.drivers.errors import ConfigurationError, DeviceLost

_ADDRESS = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[^\[\]:/\s]+)(?::([0-9]{1,5}))?")
_REFUSED = "Check that the device's server is running and that the port is right"
_UNREACHABLE = "Check the network cable, the address and the firewall"

SEND_S = 0.1
"""Seconds for the other side to accept a request of some hundred bytes. Its buffer takes thousands, so a side that does
not accept is dead; more would hold up the thread beyond the deadline of the device.
"""

_UNACKNOWLEDGED_MS = 500
"""Linux repeats a lost segment after 200 ms and then 400 ms: one repetition fits. Less drops a connection for one lost
packet; more keeps one with a dead peer. The trackers' own deadline comes first.
"""

_RTT, _RTT_AT = struct.Struct("=I"), 68
"""Smoothed round trip in microseconds, tcpi_rtt of struct tcp_info: linux/tcp.h."""


def parse_address(target: str, default_port: int, where: str) -> tuple[str, int]:
    """Parses `host`, `host:port`, `[ipv6]:port` into (host, port). Raises ConfigurationError."""
    found = _ADDRESS.fullmatch(target)
    port = int(found[2] or default_port) if found else 0
    if found is None or not 0 < port < 65536:
        remedy = f"Write host:port, such as 192.168.0.10:{default_port}"
        raise ConfigurationError(f"'{target}' is not an address", where, remedy)
    return found[1].strip("[]"), port


def connect_tcp(host: str, port: int, timeout_s: float) -> socket.socket:
    """Returns an open connection that sends small packets at once and drops a peer that acknowledges nothing for half a
    second.

    timeout_s: wall seconds for everything. Raises DeviceLost that states which of its steps failed.
    """
    where, end_s = f"{host}:{port}", time.monotonic() + timeout_s
    failure: OSError | None = None
    for family, address in _resolve(host, port, timeout_s):
        line = socket.socket(family, socket.SOCK_STREAM)
        try:
            line.settimeout(max(end_s - time.monotonic(), 0.001))
            line.connect(address)
            line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            line.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _UNACKNOWLEDGED_MS)
            return line
        except OSError as error:
            line.close()
            failure = error
    raise _refusal(where, failure) from failure


def round_trip_ns(line: socket.socket) -> int:
    """Returns the round trip that the kernel measured at the start of the connection, without programs at its ends."""
    info = line.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _RTT_AT + _RTT.size)
    (rtt_us,) = _RTT.unpack_from(info, _RTT_AT)
    return int(rtt_us) * 1000


def _resolve(host: str, port: int, timeout_s: float) -> list[tuple[socket.AddressFamily, tuple[object, ...]]]:
    """Returns the addresses of a name. The system's resolver knows no deadline, so it runs in a thread that may be left
    behind when the deadline has passed.
    """
    found: list[tuple[socket.AddressFamily, tuple[object, ...]]] = []
    failed: list[OSError] = []

    def ask() -> None:
        try:
            answers = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
            found.extend((family, address) for family, _, _, _, address in answers)
        except (OSError, UnicodeError) as error:
            failed.append(error if isinstance(error, OSError) else OSError(str(error)))

    asking = threading.Thread(target=ask, name="resolver", daemon=True)
    asking.start()
    asking.join(timeout_s)
    if not found:
        what = "the name is unknown" if failed else f"the name was not resolved within {timeout_s:g} s"
        raise DeviceLost(what, host, "Write the device's IP address in place of its name")
    return list(found)


def _refusal(where: str, error: OSError | None) -> DeviceLost:
    if isinstance(error, ConnectionRefusedError):
        return DeviceLost("nothing listens there (connection refused)", where, _REFUSED)
    if isinstance(error, TimeoutError):
        return DeviceLost("nobody answers", where, _UNREACHABLE)
    reason = (error.strerror or str(error)).lower() if error is not None else "no address"
    return DeviceLost(f"no connection ({reason})", where, _UNREACHABLE)
