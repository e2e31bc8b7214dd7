"""Provides a Unix socket that a group may use. It can replace one that a killed service has left, be reached through a
crowd, and be read line by line.
"""

import errno
import grp
import math
import os
import socket
import stat
import struct
import time
from collections.abc import Iterable
from pathlib import Path

from probewatch.appliance.service.host.log import get_log

_ACL = "system.posix_acl_access"
_ACL_VERSION = 2
_OWNER, _USER, _GROUP, _MASK, _OTHERS = 0x01, 0x02, 0x04, 0x10, 0x20
_NO_ID = 0xFFFFFFFF
"""Id of entries that name no user. All of these are from <linux/posix_acl_xattr.h> and <linux/posix_acl.h>."""
_READ_BYTES = 1 << 14
"""Bytes requested from the kernel at once; a status has some 20 kB. Not measured."""
_MAY, _MAY_NOT = stat.S_IROTH | stat.S_IWOTH, 0


NO_GROUP = "there is no such group"
"""What is wrong with a group that `listening` does not find."""


def make_group(group: str) -> str:
    """Returns what to do about it."""
    return f"Make it: groupadd --system {group}"


def listening(path: Path, group: str, backlog: int, users: Iterable[int] = ()) -> socket.socket:
    """Returns a listening socket, mode 0660, of the group if one is named, and of these users, by id, whatever group
    they are in.

    Raises OSError, and LookupError where there is no such group.
    """
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    try:
        _remove_socket(path)
        listener.bind(str(path))
        path.chmod(0o660)
        if group:
            os.chown(path, -1, grp.getgrnam(group).gr_gid)
        _admit(path, users)
        listener.listen(backlog)
    except (OSError, LookupError):
        listener.close()
        raise
    return listener


def _admit(path: Path, users: Iterable[int]) -> None:
    """Sets an access control list. On a file system without these, the users need the group, as everybody does."""
    named = [(_USER, _MAY, uid) for uid in sorted(users)]
    if not named:
        return
    entries = [
        (_OWNER, _MAY, _NO_ID), *named, (_GROUP, _MAY, _NO_ID), (_MASK, _MAY, _NO_ID), (_OTHERS, _MAY_NOT, _NO_ID)
    ]  # fmt: skip
    packed = struct.pack("<I", _ACL_VERSION) + b"".join(struct.pack("<HHI", *entry) for entry in entries)
    try:
        os.setxattr(path, _ACL, packed)
    except OSError as error:
        why = error.strerror or str(error)
        get_log().warning("who may look on needs the group of the socket", socket=str(path), why=why)


def connected(path: Path, timeout_s: float) -> socket.socket:
    """Returns a connected socket. Raises OSError. Connecting blocks, so that the kernel keeps the place in the queue
    where a crowd waits to be accepted.
    """
    seconds, fraction = divmod(timeout_s, 1)
    link = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        link.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("@ll", int(seconds), int(fraction * 1e6)))
        link.connect(str(path))
    except OSError:
        link.close()
        raise
    link.settimeout(timeout_s)
    return link


class Lines:
    """Reads what the other end sends, line by line. The deadline is that of a whole line: bytes that trickle in do not
    extend it.

    most_bytes: the longest line.
    """

    def __init__(self, link: socket.socket, most_bytes: int) -> None:
        self._link, self._most_bytes = link, most_bytes
        self._received = bytearray()

    def next(self, timeout_s: float) -> bytes:
        """Returns one line with its end; empty when the connection has ended before it. Leaves another timeout set on
        the socket. Raises TimeoutError, ValueError for a line that is too long, OSError.
        """
        end_s = time.monotonic() + timeout_s
        while b"\n" not in self._received:
            if len(self._received) > self._most_bytes:
                raise ValueError(f"a line is longer than {self._most_bytes} bytes")
            if not (data := received_by(self._link, _READ_BYTES, end_s)):
                return b""
            self._received += data
        line, newline, rest = bytes(self._received).partition(b"\n")
        self._received = bytearray(rest)
        return line + newline


def received_by(link: socket.socket, most_bytes: int, end_s: float) -> bytes:
    """Receives, like recv, until end_s of time.monotonic, which may be inf. What has come by then counts, however late
    this host reads it. Raises OSError, TimeoutError among them.
    """
    link.settimeout(None if end_s == math.inf else max(0.0, end_s - time.monotonic()))
    try:
        return link.recv(most_bytes)
    except BlockingIOError:
        raise TimeoutError(errno.ETIMEDOUT, "no whole answer in time") from None


def _remove_socket(path: Path) -> None:
    """Removes what a killed service left. Raises OSError; a file that is no socket is not ours to remove."""
    try:
        if not stat.S_ISSOCK(path.lstat().st_mode):
            raise FileExistsError(17, "there is another file of that name")
        path.unlink()
    except FileNotFoundError:
        pass
