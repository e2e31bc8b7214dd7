"""Every refusal names what is wrong, where, and what to do; the exit codes are those of sysexits.h.

They quote what devices and files say, so their words are made printable here.
"""

import errno
import os

from probewatch.drivers.printable import LONGEST_TEXT, printable

EXHAUSTED = (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ENOBUFS)
"""What the kernel answers where descriptors or memory have run out, which may be better a second later."""


class ProbewatchError(Exception):
    """what: the fault in one clause. where: file, key, URL or device. remedy: what the technician does next."""

    exit_code = 70

    def __init__(self, what: str, where: str = "", remedy: str = "") -> None:
        self.what, self.where, self.remedy = (printable(text, LONGEST_TEXT) for text in (what, where, remedy))
        super().__init__(self.what, self.where, self.remedy)

    @property
    def advice(self) -> str:
        """What is wrong and what to do, for a place that the reader knows."""
        stop = "" if self.what.endswith("?") else "."
        return f"{self.what}{stop} {self.remedy}" if self.remedy else self.what

    def __str__(self) -> str:
        return f"{self.where}: {self.advice}" if self.where else self.advice


class ConfigurationError(ProbewatchError):
    """The configuration, the calibration file or a URL cannot be used: do not restart, mend it."""

    exit_code = 78


class RecordingError(ProbewatchError):
    """A recording is damaged or is not of a kind that can be read."""

    exit_code = 65


class DeviceLost(ProbewatchError):  # noqa: N818  a state of the device, as operators say it
    """A device is absent, busy, unplugged or silent; the owner closes it and opens it again with backoff."""

    exit_code = 69


class TooBusy(ProbewatchError):  # noqa: N818  a state of the machine, as operators say it
    """This machine was too busy to decide it; the same may succeed on one that is less so."""

    exit_code = 75


class ProtocolError(ProbewatchError):
    """Bytes from a device break its protocol; the whole reply is refused."""

    exit_code = 76


def cannot_listen(error: object, where: str, remedy: str) -> ConfigurationError:
    """The refusal of a server's address that is taken, not this computer's, or none at all."""
    return ConfigurationError(f"cannot listen there ({system_words(error)})", where, remedy)


def system_words(error: object) -> str:
    """The system's message for an error, without its number. Errors of name resolution have negative numbers and those
    of TLS numbers of their own, which os.strerror does not know; they carry their own message.
    """
    of_tls = type(error).__module__ == "ssl"  # without loading ssl, which few commands need
    number = 0 if of_tls else getattr(error, "errno", None) or 0
    said = os.strerror(number) if number > 0 else getattr(error, "strerror", None) or str(error)
    said = said.partition(" (while attempting")[0]  # which Python adds to an address that is none
    return said[:1].lower() + said[1:]
