"""What a row of `appliance.supervision.faults` consists of. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from probewatch.appliance.supervision.policy import Policy


class Device(StrEnum):
    """Whose fault it is where it is not about the calibration, in the order in which the page shows them."""

    SCANNER = "Scanner"
    TRACKER = "Tracker"
    CONTACT = "Contact and lamps"
    COMPUTER = "Computer"
    ALARM_LOG = "Alarm log"
    CALIBRATION = "Calibration"


@dataclass(frozen=True, slots=True)
class Texts:
    """One language. text: what the operator reads. remedy: what to do. requested: what to do instead once a
    recalibration is requested; empty where it never is. checks: name of each check that may report the fault → the same
    translated; none in English, as the names are English words.
    """

    text: str = ""
    remedy: str = ""
    requested: str = ""
    checks: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class FaultRow:
    """One class of fault. policy: what it leads to. en, de: its texts.

    device: None where it is about the calibration. place: of the faults of one device at once, the least is told first;
    1 is alone, as of a device that is gone nothing else is known. limits: keys of the configuration, beside those of
    `QUANTITIES` in appliance.core.parameters; none where it is seen or not. overload: a computer short of time shows it
    as well as a device that is gone.
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
        """In English, as reasons and the alarm log have it."""
        return self.en.text

    @property
    def remedy(self) -> str:
        """In English."""
        return self.en.remedy

    @property
    def requested(self) -> str:
        """In English."""
        return self.en.requested

    @property
    def checks(self) -> frozenset[str]:
        """Names of the checks that may report it."""
        return frozenset(self.de.checks)

    def translations(self) -> dict[str, str]:
        """English text, or name of a check → German."""
        texts = {self.en.text: self.de.text, self.en.remedy: self.de.remedy, self.en.requested: self.de.requested}
        return {english: german for english, german in texts.items() if english} | dict(self.de.checks)
