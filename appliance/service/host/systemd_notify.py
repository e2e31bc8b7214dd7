"""Sends READY=1 and WATCHDOG=1 to the service manager over the datagram socket that it names (sd_notify(3))."""

import os
import socket

from probewatch.drivers.printable import printable


class Notifier:
    """Notifies the service manager, where one listens. Never blocks: a full socket loses the datagram, not the tick."""

    def __init__(self, address: str | None = None) -> None:
        address = os.environ.get("NOTIFY_SOCKET", "") if address is None else address
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._ready = False

    def alive(self, status: str) -> None:
        """Reports that a tick and an output write are complete."""
        first = "" if self._ready else "READY=1\n"
        self._ready = True
        self._send(f"{first}WATCHDOG=1\nSTATUS={printable(status)}")

    def close(self) -> None:
        """Reports that the stop is intended."""
        self._send("STOPPING=1")
        self._socket.close()

    def _send(self, text: str) -> None:
        if self._address:
            try:
                self._socket.sendto(text.encode(), self._address)
            except OSError:
                self._ready = False
