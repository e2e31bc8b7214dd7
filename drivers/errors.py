"""Defines the errors of all packages. Each names what is wrong, where, and what to do; the exit codes are those of
sysexits.h.

Errors quote what devices and files send, so their texts are made printable here.
"""

import errno
import os

from probewatch.drivers.printable import LONGEST_TEXT, printable

CORRECT_PATH = "Correct the path: `probewatch devices` lists what is connected"
"""Remedy for a path that leads to something other than the device named."""
EXHAUSTED = (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ENOBUFS)
"""Error numbers of a kernel that has run out of descriptors or memory; a second later there may be some again."""


class ProbewatchError(Exception):
    """Serves as the base class of all errors. what: the fault in one clause. where: file, key, URL or device. remedy:
    what the technician does next.
    """

    exit_code = 70

    def __init__(self, what: str, where: str = "", remedy: str = "") -> None:
        self.what, self.where, self.remedy = (printable(text, LONGEST_TEXT) for text in (what, where, remedy))
        super().__init__(self.what, self.where, self.remedy)

    @property
    def advice(self) -> str:
        """Returns what is wrong and what to do, without the place, for a context in which the reader knows it."""
        stop = "" if self.what.endswith("?") else "."
        return f"{self.what}{stop} {self.remedy}" if self.remedy else self.what

    def __str__(self) -> str:
        return f"{self.where}: {self.advice}" if self.where else self.advice


class ConfigurationError(ProbewatchError):
    """Reports that the configuration, the calibration file or a URL cannot be used: a restart does not help, a
    correction does.
    """

    exit_code = 78


class RecordingError(ProbewatchError):
    """Reports a recording that is damaged, or of a kind that cannot be read."""

    exit_code = 65


class DeviceLost(ProbewatchError):  # noqa: N818  a state of the device, as operators say it
    """Reports a device that is absent, busy, unplugged or silent. Its owner closes and reopens it with backoff."""

    exit_code = 69


class TooBusy(ProbewatchError):  # noqa: N818  a state of the machine, as operators say it
    """Reports that this machine was too busy to decide; the same may succeed on one that is less busy."""

    exit_code = 75


class ProtocolError(ProbewatchError):
    """Reports bytes from a device that break its protocol; the whole reply is refused."""

    exit_code = 76


def cannot_listen(error: object, where: str, remedy: str) -> ConfigurationError:
    """Returns the error for an address on which a server cannot listen: it is taken, not one of this computer, or no
    address at all.
    """
    return ConfigurationError(f"cannot listen there ({system_words(error)})", where, remedy)


def system_words(error: object) -> str:
    """Returns the system's message for an error, without its number.

    Errors of name resolution have negative numbers, and those of TLS have numbers of their own, which os.strerror does
    not know; they carry their own message.
    """
    of_tls = type(error).__module__ == "ssl"  # without loading ssl, which few commands need
    number = 0 if of_tls else getattr(error, "errno", None) or 0
    said = os.strerror(number) if number > 0 else getattr(error, "strerror", None) or str(error)
    said = said.partition(" (while attempting")[0]  # Python adds this where the address is invalid
    return said[:1].lower() + said[1:]
