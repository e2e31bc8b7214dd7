"""A Unix socket that a group may use: made where a killed service may have left one, and reached through a crowd."""

import grp
import os
import socket
import stat
import struct
from pathlib import Path


def listening(path: Path, group: str, backlog: int) -> socket.socket:
    """Mode 0660, of the group if one is named. Raises OSError, and LookupError where there is no such group."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    try:
        _remove_socket(path)
        listener.bind(str(path))
        path.chmod(0o660)
        if group:
            os.chown(path, -1, grp.getgrnam(group).gr_gid)
        listener.listen(backlog)
    except (OSError, LookupError):
        listener.close()
        raise
    return listener


def connected(path: Path, timeout_s: float) -> socket.socket:
    """Raises OSError. Blocks, so that the kernel keeps the place in the queue where a crowd waits to be accepted."""
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


def _remove_socket(path: Path) -> None:
    """What a killed service left. Raises OSError; what is no socket is not ours to remove."""
    try:
        if not stat.S_ISSOCK(path.lstat().st_mode):
            raise FileExistsError(17, "there is another file of that name")
        path.unlink()
    except FileNotFoundError:
        pass
