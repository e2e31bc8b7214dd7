"""States what a recording lacks, where a live cart would report a device as silent. Pure."""

from bisect import bisect_left
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from math import inf

from probewatch.appliance.core.quality.report import Change
from probewatch.appliance.supervision.device_health import Timeouts
from probewatch.appliance.types import Fault
from probewatch.drivers.samples import Frame, Sample

_LACKING = {Fault.VIDEO_LOST: "no picture", Fault.TRACKER_LOST: "no reading of the tracker"}
_NEITHER = "neither picture nor reading of the tracker"
_REMEDY = "record again, or cut it there"


@dataclass(frozen=True, slots=True)
class _Gap:
    """Represents a time without a sample of one device, ns of the recording's clock."""

    from_ns: int
    until_ns: int

    def is_shared(self, others: Sequence["_Gap"]) -> bool:
        """Returns whether the other device lacks samples for most of it as well."""
        shared_ns = sum(min(self.until_ns, one.until_ns) - max(self.from_ns, one.from_ns) for one in others)
        return 2 * shared_ns > self.until_ns - self.from_ns


def _between(gaps: Sequence[_Gap], began_ns: float, end_ns: float, patience_ns: int = 0) -> Sequence[_Gap]:
    """Returns the gaps that are not over before began_ns and have lasted longer than patience_ns at end_ns."""
    first = bisect_left(gaps, began_ns, key=lambda gap: gap.until_ns)
    return gaps[first : bisect_left(gaps, end_ns - patience_ns, key=lambda gap: gap.from_ns)]


class RecordedGaps:
    """Records for how long each device has no sample, and states that in place of the live text.

    origin_ns: time from which seconds are counted. injected: faults of devices that were lost on purpose, so that what
    is lacking at the end is reported as a live cart would report it.
    """

    def __init__(self, origin_ns: int, timeouts: Timeouts, injected: Collection[Fault] = ()) -> None:
        self._origin_ns, self._injected = origin_ns, frozenset(injected)
        self._patience_ns = {Fault.VIDEO_LOST: timeouts.video_ns, Fault.TRACKER_LOST: timeouts.tracker_ns}
        self._last_ns: dict[Fault, int] = {}
        self._gaps: dict[Fault, list[_Gap]] = {fault: [] for fault in _LACKING}

    def note(self, sample: Sample) -> None:
        """Takes the next sample, in time order; a reading without a pose counts."""
        self._note(Fault.VIDEO_LOST if isinstance(sample, Frame) else Fault.TRACKER_LOST, sample.stamp.t_ns)

    def finish(self, end_ns: int) -> None:
        """Counts as gaps what is lacking at the end, but for the devices that were lost on purpose."""
        for fault in _LACKING.keys() - self._injected:
            self._note(fault, end_ns)

    def told(self, changes: Sequence[Change]) -> list[Change]:
        """Returns the changes; those of a silent device state what the recording lacks in the meantime."""
        told: list[Change] = []
        alike = [(fault, list(group)) for fault, group in groupby(changes, key=lambda change: change.fault)]
        for index, (fault, group) in enumerate(alike):
            end_s = alike[index + 1][1][0].t_s if index + 1 < len(alike) else inf
            reason = "" if fault not in _LACKING else self._reason(fault, group[0].t_s, end_s)
            told += [replace(change, reason=reason) for change in group] if reason else group
        return told

    def _note(self, fault: Fault, t_ns: int) -> None:
        gap = _Gap(self._last_ns.get(fault, t_ns), t_ns)
        if gap.until_ns - gap.from_ns > self._patience_ns[fault]:
            self._gaps[fault].append(gap)
        self._last_ns[fault] = t_ns

    def _reason(self, fault: Fault, began_s: float, end_s: float) -> str:
        """Returns what is lacking between these times, s since the origin; empty where nothing is."""
        began_ns, end_ns = (self._origin_ns + seconds * 1e9 for seconds in (began_s, end_s))
        gaps = _between(self._gaps[fault], began_ns, end_ns, self._patience_ns[fault])
        if not gaps or (fault in self._injected and end_s == inf):
            return ""
        (other,) = _LACKING.keys() - {fault}
        both = all(gap.is_shared(_between(self._gaps[other], gap.from_ns, gap.until_ns)) for gap in gaps)
        lacking = _NEITHER if both else _LACKING[fault]
        from_s = (gaps[0].from_ns - self._origin_ns) / 1e9
        longest_s = max(gap.until_ns - gap.from_ns for gap in gaps) / 1e9
        if len(gaps) == 1:
            return f"The recording has {lacking} for {longest_s:.1f} s from {from_s:.2f} s on: {_REMEDY}"
        until_s = (gaps[-1].until_ns - self._origin_ns) / 1e9
        where = f"in {len(gaps)} gaps from {from_s:.2f} to {until_s:.2f} s, the longest of {longest_s:.1f} s"
        return f"The recording has {lacking} {where}: {_REMEDY}"
