"""Represents the device as a whole: its system status and alerts as typed values, those that end by themselves and
those that only a person can end.
"""

from dataclasses import dataclass, replace

from probewatch.drivers.trackers.ndi.pose_status import (
    SYSTEM_ALERTS_PENDING,
    SYSTEM_TEMPERATURE,
    StatusReason,
    status_of_system,
)
from probewatch.drivers.trackers.ndi.readings import Snapshot
from probewatch.drivers.trackers.ndi.status_text import BUMPED, HARMLESS_ALERTS, PTP_LOST, alert_text

_BATTERIES = 0x100000 | 0x4000000
_TOO_HOT, _TOO_COLD = 0x20000000, 0x40000000
"""Combined API, Info.Status.Alerts: battery and laser battery; too hot, too cold."""

_LATCHED = BUMPED
_FORGET_NS = 3_000_000_000
"""Age, ns, at which an alert that Info.Status.Alerts does not list is over: three looks. Less ends an alert that BX2
alone reports between two of its reports; more keeps the contact open that long after the cause has gone. Not measured.
"""

_LOOK_AGAIN_NS = 1_000_000_000
"""Time between two requests for the active alerts, ns. Each takes the place of a tracking reply; rarer ones delay the
all-clear.
"""


@dataclass(frozen=True, slots=True)
class Health:
    """Holds the state of the device. alerts: active bits of Info.Status.Alerts; a bump stays active until a person
    clears it, whatever the device reports.

    system_status: that of the last TX or BX reply. strays: markers that belong to no tool in the last detailed reply.
    """

    alerts: int = 0
    system_status: int = 0
    strays: int = 0

    @property
    def bumped(self) -> bool:
        return bool(self.alerts & BUMPED)

    @property
    def too_hot(self) -> bool:
        return bool(self.alerts & _TOO_HOT)

    @property
    def too_cold(self) -> bool:
        return bool(self.alerts & _TOO_COLD)

    @property
    def temperature_wrong(self) -> bool:
        """Returns whether the temperature is outside the range in which the device is accurate."""
        return self.too_hot or self.too_cold or bool(self.system_status & SYSTEM_TEMPERATURE)

    @property
    def battery_low(self) -> bool:
        return bool(self.alerts & _BATTERIES)

    @property
    def clock_unsynchronised(self) -> bool:
        """Returns whether the device's clock has lost its master; times are then bound to the host's clock alone."""
        return bool(self.alerts & PTP_LOST)

    @property
    def status_reason(self) -> StatusReason:
        """Returns whether any pose of this device may be trusted, with the reason."""
        return status_of_system(self.system_status, self.alerts)

    @property
    def warnings(self) -> str:
        """Returns what does not impair the poses but should be known; empty where there is nothing."""
        return alert_text(self.alerts & HARMLESS_ALERTS)


class HealthWatch:
    """Tracks the health of the device, and decides when to ask it for its alerts. health: as of now."""

    def __init__(self, alerts: int, now_ns: int) -> None:
        self.health = Health(alerts)
        self._seen_ns = dict.fromkeys(_bits(alerts), now_ns)
        self._look_ns = now_ns + _LOOK_AGAIN_NS

    def note(self, snapshot: Snapshot, detailed: bool, now_ns: int) -> None:
        """Records what a reply itself reports."""
        strays = snapshot.strays if detailed else self.health.strays
        if (snapshot.system_status, strays) != (self.health.system_status, self.health.strays):
            self.health = replace(self.health, system_status=snapshot.system_status, strays=strays)
        self.note_new(snapshot.alerts, now_ns)

    def note_new(self, alerts: int, now_ns: int) -> None:
        """Records alerts that came up."""
        if alerts:
            self._seen_ns |= dict.fromkeys(_bits(alerts), now_ns)
        if alerts & ~self.health.alerts:
            self.health = replace(self.health, alerts=self.health.alerts | alerts)

    def note_standing(self, alerts: int | None, now_ns: int) -> None:
        """Records what Info.Status.Alerts reports: an alert that it does not list is over once no reply has reported it
        for three seconds, as BX2 alone reports some.

        None: the device does not report them; then all alerts stay active.
        """
        self._look_ns = now_ns + _LOOK_AGAIN_NS
        if alerts is None:
            return
        self.note_new(alerts, now_ns)
        old = {bit for bit, seen_ns in self._seen_ns.items() if now_ns - seen_ns > _FORGET_NS}
        over = {bit for bit in _bits(self.health.alerts) if bit in old and not bit & alerts and not bit & _LATCHED}
        self.health = replace(self.health, alerts=self.health.alerts & ~sum(over))

    def asks_for_new(self) -> bool:
        """Returns whether the system status announces new alerts."""
        return bool(self.health.system_status & SYSTEM_ALERTS_PENDING)

    def asks_for_standing(self, now_ns: int) -> bool:
        """Returns whether an alert is active that may be over by now."""
        return bool(self.health.alerts & ~_LATCHED) and now_ns >= self._look_ns

    def clear_bump(self) -> None:
        """Clears the bump, after a person has checked the position sensor."""
        self.health = replace(self.health, alerts=self.health.alerts & ~_LATCHED)


def _bits(mask: int) -> list[int]:
    return [1 << i for i in range(mask.bit_length()) if mask >> i & 1]
