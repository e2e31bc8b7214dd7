"""A section of docs/alarms.md for each hazard: what watches, its limit, what is known of being seen, what to do.

Made from the detectors' own words, the configuration's defaults, the policy and what the study has measured.
"""

import ast
from collections.abc import Mapping
from pathlib import Path
from statistics import median

from appliance.configuration.config import SupervisorTimes
from appliance.core.parameters import QUANTITIES
from appliance.limits import Limits
from appliance.supervision.alarms import HAZARDS
from appliance.supervision.alarms import Hazard as Row
from appliance.types import Fault
from tools.development.evidence_figures import Figures, Found
from tools.development.evidence_pages import of_fault
from tools.development.hazards import ROOT, found_by
from tools.development.markdown import table
from tools.development.slips import slip_pages
from tools.study.hazard import FAULTS, Hazard
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


def hazard_pages(figures: Figures) -> list[str]:
    """Lines of Markdown."""
    lines = [
        "## Each hazard",
        "",
        "What is said of being seen is measured with simulated hazards ([evidence.md](evidence.md) has every run, its",
        "seeds and commit). A share of few runs says little: its interval does.",
        "",
    ]
    for fault, row in HAZARDS.items():
        seen = of_fault(figures.found, fault)
        lines += [
            f"### {fault}",
            "",
            f"**{row.text}.** What to do: {remedies(row)}. What it leads to: [policy](#policy).",
            "",
            *(f"- Watched by `{file}`: {_opening(ROOT / file)}" for file in found_by()[fault]),
            f"- Limit: {_limit(fault)}",
            f"- Probability to see it, and delay: {_note(fault, seen)}",
            "",
            *(_seen(seen) if seen else ()),
            *slip_pages(fault),
        ]
    return lines


def remedies(row: Row) -> str:
    """What the operator does, also once a recalibration is requested."""
    return f"{row.remedy}; once a recalibration is requested: {row.requested}" if row.requested else row.remedy


def _opening(file: Path) -> str:
    """The first sentences of its docstring."""
    told = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    return " ".join(told.split("\n\n")[0].split())


def _limit(fault: Fault) -> str:
    defaults = {**Limits().model_dump(), **SupervisorTimes().model_dump()}
    told = [f"`{name}`, {defaults[name]:g} unless configured" for name in _LIMITS.get(fault, ())]
    return "; ".join(told) + "." if told else "none to set: it is there or not."


def _note(fault: Fault, seen: list[Found]) -> str:
    if seen:
        return "see the table."
    return (
        "not measured in the last study."
        if fault in FAULTS.values()
        else "not measured; the study does not simulate it."
    )


def _seen(seen: list[Found]) -> list[str]:
    """All kinds together, by when they happen, with links to each kind's own runs."""
    head = ("when", "FAULT (95 %)", "named rightly first", "delay: median (range)")
    manners = dict.fromkeys(one.hazard.rpartition("@")[2] for one in seen)
    rows = [_manner(name, [one for one in seen if one.hazard.endswith(f"@{name}")]) for name in manners]
    kinds = dict.fromkeys(Hazard.parse(one.hazard).kind for one in seen)
    links = ", ".join(f"[{kind}](evidence.md#{kind})" for kind in kinds)
    return [*table(head, rows), f"Each kind by itself, with sessions, seeds and commits: {links}.", ""]


def _manner(name: str, seen: list[Found]) -> tuple[str, ...]:
    delays_s = sorted(delay_s for one in seen for delay_s in one.fault_s)
    runs = sum(one.runs for one in seen)
    delay = f"{median(delays_s):.2f} s ({delays_s[0]:.2f} to {delays_s[-1]:.2f})" if delays_s else "–"
    return name, str(Share(len(delays_s), runs)), f"{sum(one.named for one in seen)} of {runs}", delay
