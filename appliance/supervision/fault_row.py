"""Defines what a row of `appliance.supervision.faults` consists of. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from probewatch.appliance.supervision.policy import Policy


class Device(StrEnum):
    """Names the device at fault, unless the fault is of the calibration, in the order in which the page shows them."""

    SCANNER = "Scanner"
    TRACKER = "Tracker"
    CONTACT = "Contact and lamps"
    COMPUTER = "Computer"
    ALARM_LOG = "Alarm log"
    CALIBRATION = "Calibration"


@dataclass(frozen=True, slots=True)
class Texts:
    """Holds the texts of one language. text: what the operator reads. remedy: what to do. requested: what to do instead
    once a recalibration is requested; empty where it never is. checks: name of each check that may report the fault →
    its translation; none in English, as the names are English words.
    """

    text: str = ""
    remedy: str = ""
    requested: str = ""
    checks: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class FaultRow:
    """Describes one class of fault. policy: what it leads to. en, de: its texts.

    device: None where the fault is about the calibration. place: of several faults of one device, the lowest is named
    first; 1 is named alone, because nothing else is known about a device that is gone. limits: keys of the
    configuration, beside those of `QUANTITIES` in appliance.core.parameters; none where the fault is either seen or
    not. overload: a computer short of time shows the fault as well as a device that is gone.
    """

    policy: Policy
    en: Texts
    de: Texts
    device: Device | None = None
    place: int = 0
    limits: tuple[str, ...] = ()
    overload: bool = False

    @property
    def text(self) -> str:
        """Returns the text in English, as reasons and the alarm log have it."""
        return self.en.text

    @property
    def remedy(self) -> str:
        """Returns the remedy in English."""
        return self.en.remedy

    @property
    def requested(self) -> str:
        """Returns the remedy once a recalibration is requested, in English."""
        return self.en.requested

    @property
    def checks(self) -> frozenset[str]:
        """Returns the names of the checks that may report the fault."""
        return frozenset(self.de.checks)

    def translations(self) -> dict[str, str]:
        """Returns the translations: English text, or name of a check → German."""
        texts = {self.en.text: self.de.text, self.en.remedy: self.de.remedy, self.en.requested: self.de.requested}
        return {english: german for english, german in texts.items() if english} | dict(self.de.checks)
