"""What docs/alarms.md says of each hazard: its limit, what to do, and what the study has measured."""

from collections.abc import Iterator, Mapping
from statistics import median

from appliance.configuration.config import SupervisorTimes
from appliance.core.parameters import QUANTITIES
from appliance.limits import Limits
from appliance.supervision.alarms import HAZARDS
from appliance.supervision.alarms import Hazard as Row
from appliance.types import Fault
from tools.development.evidence_figures import Figures, Found
from tools.development.evidence_pages import of_fault
from tools.development.markdown import table
from tools.development.slips import slip_page
from tools.study.summary import Share

_LIMITS: Mapping[Fault, tuple[str, ...]] = {
    **{fault: (quantity.limit_key,) for fault, quantity in QUANTITIES.items()},
    Fault.FROZEN_VIDEO: ("frozen_ms",),
    Fault.USER_FREEZE: ("frozen_ms",),
    Fault.VIDEO_LOST: ("video_silence_ms",),
    Fault.MARKER_BODY: ("marker_fit_mm", "marker_shape_mm"),
    Fault.MARKER_BODY_MOVED: ("witness_mm", "witness_deg"),
    Fault.FIELD_DISTORTION: ("field_indicator", "named_nats"),
    Fault.TRACKER_LOST: ("tracker_silence_ms",),
    Fault.TRACKER_STALE: ("tracker_stale_ms",),
    Fault.OUTPUT_FAILED: ("output_silence_ms",),
    Fault.ESTIMATOR_SILENT: ("estimator_silence_ms",),
}
"""Keys of the configuration; what is not here has none: it is seen or not."""
_HEAD = """## Measured

Simulated hazards, all kinds of a class together; [evidence.md](evidence.md) has each kind with its runs, seeds and
commits. A share of few runs says little: read its interval (95 %). What is not listed is not simulated by the study.
"""


def measured(figures: Figures) -> list[str]:
    """Lines of Markdown: what the study has found of each class, and the slips."""
    head = ("class", "when", "FAULT (95 %)", "named rightly first", "delay: median (range)")
    rows = (row for fault in HAZARDS for row in _seen(fault, of_fault(figures.found, fault)))
    return [*_HEAD.splitlines(), "", *table(head, rows), *slip_page()]


def remedies(row: Row) -> str:
    """What the operator does, also once a recalibration is requested."""
    return f"{row.remedy}; once a recalibration is requested: {row.requested}" if row.requested else row.remedy


def limit(fault: Fault) -> str:
    """Keys of the configuration with their defaults."""
    defaults = {**Limits().model_dump(), **SupervisorTimes().model_dump()}
    return ", ".join(f"`{name}` {defaults[name]:.4g}" for name in _LIMITS.get(fault, ())) or "–"


def _seen(fault: Fault, seen: list[Found]) -> Iterator[tuple[str, ...]]:
    """A row for each time at which its kinds happen."""
    for manner in dict.fromkeys(one.hazard.rpartition("@")[2] for one in seen):
        yield f"`{fault}`", *_manner(manner, [one for one in seen if one.hazard.endswith(f"@{manner}")])


def _manner(name: str, seen: list[Found]) -> tuple[str, ...]:
    delays_s = sorted(delay_s for one in seen for delay_s in one.fault_s)
    runs = sum(one.runs for one in seen)
    delay = f"{median(delays_s):.2f} s ({delays_s[0]:.2f} to {delays_s[-1]:.2f})" if delays_s else "–"
    return name, str(Share(len(delays_s), runs)), f"{sum(one.named for one in seen)} of {runs}", delay
