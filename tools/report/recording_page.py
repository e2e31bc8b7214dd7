"""Writes the page of one recording: what was shown, what was not, and which motion would have shown it."""

import html
from collections.abc import Sequence
from math import isfinite
from pathlib import Path

import cv2
import numpy as np

from probewatch.appliance.core.quality.check_fields import limits_fields, point_fields
from probewatch.appliance.core.quality.gesture import gestures
from probewatch.appliance.core.quality.report import Change, LineReport, spells
from probewatch.appliance.core.registration.pyramid import Bits
from probewatch.appliance.types import PARAMETERS, Check, State, VerdictKind
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import GreyImage
from probewatch.tools.report.page import picture, section, table, text, write_page
from probewatch.tools.report.svg import Plot
from probewatch.tools.report.trace import Curve, Trace
from probewatch.tools.shared.point_text import point_text
from probewatch.tools.shared.profile_text import profile_text
from probewatch.tools.shared.rerun import Comparison
from probewatch.tools.shared.subject import Subject

_KINDS = {
    State.MONITORING: "good",
    State.WARNING: "warn",
    State.HALT: "bad",
    State.RECALIBRATION_REQUESTED: "bad",
    State.DEVICE_LOST: "bad",
    State.INTERNAL_FAULT: "bad",
}
"""Colours of the alarm; every other state is one of waiting."""
_KINDS_BY_NAME = {state.value: kind for state, kind in _KINDS.items()}
_ARROW_LEAST_PX, _ARROW_TIMES = 30, 10
"""A motion from one picture to the next is a pixel or so: it is drawn with at least this length, px, and at least this
factor.
"""
_NAMES_WIDE = 150
"""Units of a drawing: width of the longest name, rotation-elevational, in letters of 12; more narrows the bars."""
_NAME_HIGH = 190
"""Units of a drawing: height at which a name and its unit fit upright beside it in letters of 12 units; less cuts."""
_NAMES = ("polarity", "latency", *PARAMETERS)
"""Names in the order in which they are drawn."""
_VERDICTS = {VerdictKind.OK: "good", VerdictKind.FAULT: "bad", VerdictKind.NOT_VERIFIED: "wait"}


def write_recording_page(
    path: Path,
    subject: Subject,
    name: str,
    trace: Trace,
    report: LineReport,
    changes: Sequence[Change],
    comparison: Comparison | None,
    damage: str,
) -> None:
    """Writes the page. Raises ConfigurationError where it cannot be written."""
    verdict = report.verdict
    fault = f" · {verdict.fault}" if verdict.fault else ""
    title = f"SPOILED: {name}" if subject.spoiled else name
    parts = [
        f"<h1>{html.escape(title)}</h1>",
        *([text(subject.spoiled, "bad")] if subject.spoiled else []),
        text(f"{verdict.kind.value}{fault}: {verdict.reason}", f"verdict {_VERDICTS[verdict.kind]}"),
        text(
            f"{report.frames} pictures, {report.poses} poses, {report.paired} paired; {trace.duration_s:.1f} s", "note"
        ),
    ]
    parts.append(text(profile_text(limits_fields(report.limits)), "note"))
    parts.append(text(point_text(point_fields(verdict.t_ns, verdict.point, report.limits.region)), "note"))
    if damage:
        parts.append(text(f"The file is damaged: {damage}", "bad"))
    if comparison is not None:
        parts.append(text(comparison.sentence, "note" if comparison.exact else "bad"))
    if report.proposal is not None:
        parts.append(section("Proposed, not applied", *(text(clause) for clause in report.proposal.text.split("; "))))
    parts += [
        section("State", _states(changes, trace.duration_s)),
        *_live(comparison, trace.duration_s),
        section("What was missing", _missing(trace, report)),
        section("Coverage", _coverage(trace)),
        section("Path of the picture and of the tracker", *_paths(trace)),
        section("Parameters", *_curves(trace.curves, trace.duration_s), _checks(report.checks)),
    ]
    if trace.first is not None:
        parts.append(section("First picture", _first(*trace.first)))
    parts.append(section("What this is of", table(("", ""), subject.rows())))
    write_page(path, f"probewatch: {title}", parts)


def _states(changes: Sequence[Change], duration_s: float) -> str:
    plot = Plot((0, max(duration_s, 1e-3)), (0, 1), "s", "", height=90)
    for change, end_s in spells(changes, duration_s):
        kind = _KINDS.get(change.state, "wait")
        plot.block(change.t_s, end_s, 0.05, 0.95, kind, f"{change.t_s:.1f} s {change.state.value}: {change.reason}")
    rows = [(f"{change.t_s:.2f}", change.state.value, change.fault or "–", change.reason) for change in changes]
    return plot.svg("states over time") + table(("s", "state", "fault", "reason"), rows)


def _live(comparison: Comparison | None, duration_s: float) -> list[str]:
    """Returns the section of a black box; none for any other recording."""
    return [] if comparison is None else [section("State as reported live", _live_states(comparison, duration_s))]


def _live_states(comparison: Comparison, duration_s: float) -> str:
    """Returns the plot and table of the states that were reported live, on the same axis."""
    plot = Plot((0, max(duration_s, 1e-3)), (0, 1), "s", "", height=90)
    ends_s = [*(one.t_ns / 1e9 for one in comparison.told[1:]), duration_s]
    for one, end_s in zip(comparison.told, ends_s, strict=False):
        begins_s, kind = max(one.t_ns / 1e9, 0.0), _KINDS_BY_NAME.get(one.state, "wait")
        if end_s > begins_s:
            plot.block(begins_s, end_s, 0.05, 0.95, kind, f"{begins_s:.1f} s {one.state}: {one.reason}")
    rows = [(f"{one.t_ns / 1e9:.2f}", one.state, one.fault or "–", one.reason) for one in comparison.told]
    if not rows:
        return text("The box holds no state.")
    return plot.svg("states as reported live over time") + table(("s", "state", "fault", "reason"), rows)


def _missing(trace: Trace, report: LineReport) -> str:
    shown = {name for name, curve in trace.curves.items() if any(curve.shown)}
    lacking = [name for name in report.missing if name not in shown]
    if not lacking:
        return text("Nothing: every required parameter was shown at some time.", "good")
    return table(
        ("not shown", "the motion that shows it"),
        [(f"!{name}", "; ".join(one.value for one in gestures([name]))) for name in lacking],
    )


def _coverage(trace: Trace) -> str:
    names = [name for name in _NAMES if name in trace.curves]
    across, rows_high = (0, max(trace.duration_s, 1e-3)), (0, max(len(names), 1))
    plot = Plot(across, rows_high, "s", "", height=40 + 22 * len(names), left=_NAMES_WIDE)
    rows = []
    for place, name in enumerate(names):
        curve, low = trace.curves[name], len(names) - 1 - place
        for start_s, end_s in _spells(curve):
            plot.block(start_s, end_s, low + 0.15, low + 0.85, "good", f"{name} shown {start_s:.1f} … {end_s:.1f} s")
        plot.row(low + 0.5, name)
        rows.append((name, f"{100 * sum(curve.shown) / max(len(curve.shown), 1):.0f} %"))
    return plot.svg("when each parameter was shown") + table(("parameter", "of the time shown"), rows)


def _spells(curve: Curve) -> list[tuple[float, float]]:
    spells: list[tuple[float, float]] = []
    begun: float | None = None
    for t_s, shown in zip(curve.t_s, curve.shown, strict=True):
        if shown and begun is None:
            begun = t_s
        elif not shown and begun is not None:
            spells.append((begun, t_s))
            begun = None
    return [*spells, (begun, curve.t_s[-1])] if begun is not None else spells


def _paths(trace: Trace) -> list[str]:
    paths = trace.paths
    if not paths.t_s:
        return [text("No picture was followed.", "note")]
    plots = [text("Both should lie on one another; the difference is what the calibration is judged by.", "note")]
    for column, axis in enumerate(("lateral", "axial")):
        by_picture = [way[column] for way in paths.picture]
        by_tracker = [way[column] for way in paths.tracker]
        finite = [value for value in (*by_picture, *by_tracker) if isfinite(value)]
        span = (min(finite, default=0.0), max(finite, default=0.0))
        plot = Plot((0, max(trace.duration_s, 1e-3)), span, "s", f"{axis}, mm")
        plot.line(paths.t_s, by_picture, "a", "picture")
        plot.line(paths.t_s, by_tracker, "b", "tracker")
        plots.append(plot.svg(f"{axis} path of picture and tracker, mm"))
    return plots


def _curves(curves: dict[str, Curve], duration_s: float) -> list[str]:
    plots = []
    for name in _NAMES:
        curve = curves.get(name)
        if curve is None or not any(map(isfinite, curve.value)) or name == "polarity":
            continue
        plot = Plot(
            (0, max(duration_s, 1e-3)), (-2 * curve.limit, 2 * curve.limit), "s", f"{name}, {curve.unit}", _NAME_HIGH
        )
        pairs = list(zip(curve.value, curve.sigma, strict=True))
        plot.band(curve.t_s, [v - s for v, s in pairs], [v + s for v, s in pairs], "a")
        plot.line(curve.t_s, curve.value, "a")
        plot.level(curve.limit)
        plot.level(-curve.limit)
        plots.append(plot.svg(f"{name} with its sigma and its limits over time"))
    return plots


def _checks(checks: Sequence[Check]) -> str:
    rows = []
    for check in checks:
        mark = {VerdictKind.OK: "+", VerdictKind.FAULT: "!"}.get(check.verdict, "")
        known = isfinite(check.value)
        value = f"{check.value:.3g} ± {check.sigma:.2g} {check.unit}" if known else "–"
        rows.append((check.name, value, f"{check.limit:g} {check.unit}", f"{mark}{check.verdict.value}"))
    return table(("check", "value ± 1σ", "limit", "verdict"), rows)


def _first(image: GreyImage, mask: Bits, u_px: Array) -> str:
    """Returns the first picture: what never moves is tinted; an arrow shows where the tissue went."""
    colour = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    colour[~mask] = (0.5 * colour[~mask] + np.array([0, 60, 127])).astype(np.uint8)
    height, width = image.shape
    length = float(np.hypot(*u_px))
    times = max(_ARROW_TIMES, _ARROW_LEAST_PX / length) if length > 0 else 0.0
    end = (round(width / 2 + float(u_px[0]) * times), round(height / 2 + float(u_px[1]) * times))
    cv2.arrowedLine(colour, (width // 2, height // 2), end, (80, 200, 255), 2, cv2.LINE_AA)
    moved = f"the tissue moved by {length:.1f} px, drawn {times:.0f} times as long"
    note = f"Tinted: taken for text and rulers. Arrow: {moved}."
    return picture(np.asarray(colour, np.uint8), "first picture with mask and motion") + text(note, "note")
