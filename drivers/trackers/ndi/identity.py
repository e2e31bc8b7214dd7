"""Identifies the device, and chooses the reply that serves best: BX2 where the device has it, else BX, else TX."""

from dataclasses import dataclass
from enum import Enum

from probewatch.drivers.printable import printable

TEXT_ONLY_TAGS = (
    "AURORA Rev 007",
    "AURORA Rev 008",
    "Polaris Vega 008",
    "Polaris Spectra Rev 006",
    "Polaris Spectra Rev 007",
)
"""Firmware whose BX replies other clients found deficient."""

_FIRST_API_WITH_BX2 = 3
"""Combined API: major number of APIREV, such as G.003.008, from which a device knows BX2."""


class ReplyKind(Enum):
    """Enumerates the tracking commands."""

    BX2 = "bx2"
    BX = "bx"
    TX = "tx"


@dataclass(frozen=True, slots=True)
class Identity:
    """Holds what the device reports about itself; texts are empty where it reports nothing.

    title: such as "Polaris Vicra". characterised: date of the last calibration of the unit. api: such as G.003.008.
    """

    title: str
    serial_number: str
    freeze_tag: str
    characterised: str
    api: str

    @property
    def electromagnetic(self) -> bool:
        """Returns whether it is an Aurora: its error field is an indicator value, and its tools have no markers."""
        return "aurora" in f"{self.title} {self.freeze_tag}".lower()

    @property
    def has_bx2(self) -> bool:
        """Returns whether it has BX2, judged by the revision of its interface."""
        parts = self.api.split(".")
        return len(parts) >= 2 and parts[1].isdecimal() and int(parts[1]) >= _FIRST_API_WITH_BX2

    @property
    def reply(self) -> ReplyKind:
        """Returns the tracking command to use."""
        if self.has_bx2:
            return ReplyKind.BX2
        return ReplyKind.TX if self.freeze_tag in TEXT_ONLY_TAGS else ReplyKind.BX

    def __str__(self) -> str:
        return f"{self.title or 'tracker'} {self.serial_number} ({self.freeze_tag or 'unknown firmware'})"


def identity_of(version: str, api: str) -> Identity:
    """Parses the replies to VER 4 and APIREV, either of which may be empty."""
    first, _, rest = version.partition("\n")
    stated = dict(line.split(":", 1) for line in rest.splitlines() if ":" in line)
    known = {key.strip(): value.strip() for key, value in stated.items()}
    return Identity(
        title=printable(first.removesuffix("Control Firmware").strip()),
        serial_number=printable(known.get("NDI S/N", "")),
        freeze_tag=printable(known.get("Freeze Tag", "")),
        characterised=printable(known.get("Characterization Date", "")),
        api=printable(api),
    )
