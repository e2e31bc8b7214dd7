"""Represents an open V4L2 node: one file descriptor, requests on it, and what refusals mean to a technician."""

import errno
import fcntl
import os
from ctypes import Structure, c_int
from pathlib import Path

from probewatch.drivers.errors import DeviceLost

_CABLE = "Check the grabber's plug"
_WORDS = {
    errno.EBUSY: ("the video device is in use by another program", "Close that program, then try again"),
    errno.ENODEV: ("the video device was unplugged", _CABLE),
    errno.ENXIO: ("the video device was unplugged", _CABLE),
    errno.EIO: ("the video device reports an error", "Plug the grabber in again"),
    errno.ENOENT: ("no such video device", f"{_CABLE}, or correct the path; `probewatch devices` lists what is there"),
    errno.EACCES: ("no permission to open the video device", "Add this user to the group 'video', then log in again"),
    errno.ENOTTY: ("is not a video device", "`probewatch devices` lists what is there"),
    errno.ENOLINK: ("no signal at the video input", "Check the cable from the scanner and that it is switched on"),
    errno.ENOLCK: ("the video signal is not steady", "Check the cable from the scanner"),
    errno.ERANGE: ("the video signal is out of the grabber's range", "Choose another output resolution on the scanner"),
    errno.ENOSPC: ("the bus has no room for this picture size and rate", "Choose a smaller size= or rate="),
}
_WORDS[errno.EPERM] = _WORDS[errno.EACCES]


class Node:
    """Holds an open node; its descriptor does not block. Raises DeviceLost when the node cannot be opened."""

    def __init__(self, path: str) -> None:
        self.where = f"v4l2:{path}"
        try:
            if not Path(path).is_char_device():
                raise OSError(errno.ENOTTY if Path(path).exists() else errno.ENOENT, path)
            self.fd = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise self.lost(error, "cannot be opened") from error

    def close(self) -> None:
        """Releases the device; the kernel stops a stream that still runs."""
        os.close(self.fd)

    def ask(self, request: int, argument: "Structure | c_int") -> None:
        """Makes one ioctl, repeated when a signal interrupts it; the argument is filled in place. Raises OSError."""
        while True:
            try:
                fcntl.ioctl(self.fd, request, argument)
            except InterruptedError:
                continue
            return

    def must(self, request: int, argument: "Structure | c_int", doing: str) -> None:
        """Makes one ioctl; raises DeviceLost for what the kernel refuses. doing: what was tried, for refusals without a
        meaning of their own.
        """
        try:
            self.ask(request, argument)
        except OSError as error:
            raise self.lost(error, doing) from error

    def allows(self, request: int, argument: "Structure | c_int") -> bool:
        """Makes one ioctl; returns False where the driver does not know this request or has nothing to report."""
        try:
            self.ask(request, argument)
        except OSError as error:
            if error.errno == errno.ENODEV:
                raise self.lost(error, "was asked") from error
            return False
        return True

    def lost(self, error: OSError, doing: str) -> DeviceLost:
        """Returns the error that states what a refusal means."""
        what, remedy = _WORDS.get(error.errno or 0, (f"{doing} ({error.strerror})", _CABLE))
        return DeviceLost(what, self.where, remedy)
