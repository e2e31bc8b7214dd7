"""Tracks one kind of hazard over time. Pure: time is an argument."""

from dataclasses import dataclass

from probewatch.appliance.types import Fault


@dataclass(slots=True)
class Condition:
    """Represents a condition that is shown, or unconfirmed (neither shown nor disproved), or gone.

    onset_ns: when it was first shown since it was last gone, None while gone. named_ns: since when it has been shown as
    this fault. lifted_ns: when it went.
    """

    fault: Fault | None = None
    reason: str = ""
    shown: bool = False
    onset_ns: int | None = None
    named_ns: int | None = None
    lifted_ns: int | None = None

    @property
    def active(self) -> bool:
        return self.onset_ns is not None

    def show(self, now_ns: int, fault: Fault | None, reason: str) -> None:
        """Records that the condition is shown. fault: None where it is no longer known which one it was."""
        if self.onset_ns is None or fault is not self.fault:
            self.named_ns = now_ns
        self.fault, self.reason, self.shown = fault, reason, True
        self.onset_ns = now_ns if self.onset_ns is None else self.onset_ns

    def mark_unconfirmed(self) -> None:
        self.shown = False

    def lift(self, now_ns: int) -> None:
        if self.active:
            self.lifted_ns = now_ns
        self.onset_ns = None

    def lasts(self, now_ns: int, duration_ns: int) -> bool:
        """Returns whether it is shown now and has been active for duration_ns or longer."""
        return self.shown and self.onset_ns is not None and now_ns - self.onset_ns >= duration_ns

    def names(self, now_ns: int, duration_ns: int) -> bool:
        """Returns whether it is shown now, and as this fault for duration_ns or longer, or from its beginning on."""
        if not self.shown or self.onset_ns is None or self.named_ns is None:
            return False
        return self.named_ns == self.onset_ns or now_ns - self.named_ns >= duration_ns

    def gone(self, now_ns: int, duration_ns: int) -> bool:
        """Returns whether it has been gone for duration_ns or longer."""
        return not self.active and (self.lifted_ns is None or now_ns - self.lifted_ns >= duration_ns)
