"""`make docs` writes docs/coverage.md and docs/evidence.md, with their pictures, from docs/evidence.json. Pure."""

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import cycle
from math import sqrt
from pathlib import Path
from statistics import mean, median, stdev

from scipy.stats import t as student

from appliance.core.parameters import MEASURED
from appliance.limits import NAMED_NATS, WITHDRAWN_NATS
from appliance.types import Fault
from tools.development.evidence_figures import SOON_S, Figures, Found, Healthy, Origin
from tools.development.false_alarm_pages import false_alarm_lines
from tools.development.markdown import shared_aside, table
from tools.report.svg import Plot, alone
from tools.study.bound import FALSE_ALARM_H
from tools.study.hazard import CREEP_S, FAULTS, HIDDEN_S, ONSET_S, Hazard, Manner
from tools.study.samples import DEFAULT, WITHOUT_OFFSETS
from tools.study.session import TISSUES
from tools.study.summary import Share, false_rate_per_hour

_SENSITIVITY = f"""Sudden and creeping hazards begin at {ONSET_S:g} s, creeping ones grow for {CREEP_S:g} s, unseen
ones happen while nothing is in sight for {HIDDEN_S:g} s. *Named*: rightly, as the first FAULT. *Delay*: until the
FAULT, median (range). *Bound*: the least mean delay of any test with one false alarm in {FALSE_ALARM_H:g} h, for this
motion and noise (Kullback and Leibler, `tools/study/bound.py`); none where the change is seen to happen, or has no
size. *Open*: median time until the contact was open for good. *OK beyond*: runs with an OK at twice the limit at any
time after the onset, also before it was found.
"""

DOCS = Path(__file__).parents[2] / "docs"
DATA = DOCS / "evidence.json"
_ROW, _FRAME = 22, 50
"""Height of one line of a drawing, and of its axis, units of the drawing: labels of 12 units do not touch."""
_MOST_DELAY_S = 10.0
"""Of the drawing of delays; what is later is drawn at the edge."""

_COVERAGE = """# Coverage: how often is healthy scanning verified?

`make coverage-page` measures and writes this page; `make docs` writes it from `docs/evidence.json`. The figure is the
share of a session of simulated healthy scanning ([study.md](study.md)) with the contact closed.

To repeat a row: `{command}`.
"""
_EVIDENCE = """# Evidence: what is found, how soon, and how often it alarms for nothing

`make evidence` (short) or `make evidence-full` measures and writes this page; `make docs` writes it from
`docs/evidence.json`. Everything is simulated ([study.md](study.md#what-it-cannot-tell) says what that cannot tell).
Intervals are 95 %: of shares those of Clopper and Pearson, of rates Poisson's. **Few runs make wide intervals: read the
intervals, not the shares.**

To repeat a row: `{command}`; `--seeds` and `--draws` as many as its highest.
"""


def read_figures() -> Figures:
    """What was last measured."""
    return Figures.parse(json.loads(DATA.read_text(encoding="utf-8")))


def pages(figures: Figures) -> dict[Path, str]:
    """File → text of everything that is written from the figures."""
    return {
        DOCS / "coverage.md": _coverage(figures.healthy),
        DOCS / "evidence.md": _evidence(figures),
        DOCS / "pictures" / "coverage.svg": _coverage_picture(figures.healthy),
        DOCS / "pictures" / "sensitivity.svg": _sensitivity_picture(figures.found),
        DOCS / "pictures" / "delay.svg": _delay_picture(figures.found),
        DOCS / "pictures" / "roc.svg": _roc_picture(figures),
    }


def command(hazards: str = "") -> str:
    """That does the runs of a row again."""
    return (
        "probewatch study --sessions S --tissues T --noise-mm N --asked A --duration D --seeds K"
        f"{' --hazards H' if hazards else ''}"
    )


def _coverage(healthy: list[Healthy]) -> str:
    lines = [
        _COVERAGE.format(command=command()),
        "![share of each session with the contact closed](pictures/coverage.svg)",
        "",
    ]
    headings = (
        (DEFAULT, "As shipped: everything is asked for, and the session begins with the gesture"),
        (WITHOUT_OFFSETS, "Offsets not asked for, ordinary motion alone"),
    )
    for asked, text in headings:
        some = [one for one in healthy if one.origin.asked == asked]
        lines += [f"## {text}", ""]
        if not some:
            lines += ["Not measured.", ""]
            continue
        head = ("session, tissue", "closed, %: median", "range", "mean (95 %)", "first closed, s", *_ORIGIN)
        lines += shared_aside(head, [_coverage_row(one) for one in some], _ORIGIN)
    lines += _scores(healthy)
    hours = sum(one.hours for one in healthy)
    lines += [f"{sum(one.runs for one in healthy)} runs, {hours:.2f} h.", *_note()]
    return "\n".join(lines)


_ORIGIN = ("length, tracker", "seeds", "commit")


def _origin(origin: Origin) -> tuple[str, ...]:
    draws = "" if origin.draws == "1" else f", draws {origin.draws}"
    return (
        f"{origin.duration_s} s, {origin.noise_mm} mm",
        f"{origin.seeds}{draws}",
        ", ".join(f"`{one}`" for one in origin.commits),
    )


def _coverage_row(one: Healthy) -> Sequence[str]:
    low, high = 100 * one.closed[0], 100 * one.closed[-1]
    first = f"{median(one.first_s):.1f} ({len(one.first_s)}/{one.runs})" if one.first_s else "never"
    return (
        f"{one.origin.session}, {one.origin.tissue}",
        f"{100 * median(one.closed):.0f}",
        f"{low:.0f}–{high:.0f}",
        _mean(one.closed),
        first,
        *_origin(one.origin),
    )


_SCORES = """## Is the stated sigma honest?

(value − truth) ÷ sigma of every check, once a second: root of the mean square; the last column has the largest. 1 is
honest; less, and sigma is too large. Sigma includes what the model leaves out, which motion does not lessen. Looks of
one window share its motion, and few seeds leave a figure uncertain by a fifth and more.
"""


def _scores(healthy: list[Healthy]) -> list[str]:
    scored = [one for one in healthy if one.scores]
    rows = [
        (f"{one.origin.session}, {one.origin.tissue}", *(_score(one, name) for name in MEASURED), _worst(one))
        for one in scored
    ]
    return [_SCORES, *table(("session, tissue", *MEASURED, "largest"), rows)] if rows else []


def _score(one: Healthy, name: str) -> str:
    score = one.scores.get(name)
    return "–" if score is None else f"{score.rms:.2f}"


def _worst(one: Healthy) -> str:
    """Returns the largest score of all checks, and of which it is."""
    name = max(one.scores, key=lambda name: one.scores[name].worst)
    return f"{one.scores[name].worst:.1f} {name}"


def _mean(shares: list[float]) -> str:
    """Mean with Student's interval, cut to what a share can be."""
    if len(shares) < 2:
        return "one run"
    half = float(student.ppf(0.975, len(shares) - 1)) * stdev(shares) / sqrt(len(shares))
    low, high = max(mean(shares) - half, 0.0), min(mean(shares) + half, 1.0)
    return f"{100 * mean(shares):.0f} ({100 * low:.0f}–{100 * high:.0f})"


def _note() -> list[str]:
    return ["", "Simulated tissue and motion; real tissue is not in it.", ""]


def _evidence(figures: Figures) -> str:
    found = figures.found
    lines = [
        _EVIDENCE.format(command=command("H")),
        *_false_alarms(figures.healthy),
        *false_alarm_lines(),
        "## Sensitivity and delay",
        "",
        _SENSITIVITY,
        *_usually(found),
        "![share of runs in which each hazard was found](pictures/sensitivity.svg)",
        "",
        "![delays of the FAULT and their bounds](pictures/delay.svg)",
        "",
        *(
            line
            for kind in FAULTS
            if (some := [one for one in found if _kind(one) == kind])
            for line in _kind_table(kind, some, _usual(found))
        ),
        *_confusion(found),
        *_roc(figures),
        *_note(),
    ]
    return "\n".join(lines)


def _kind(one: Found) -> str:
    return Hazard.parse(one.hazard).kind


def _usually(found: list[Found]) -> list[str]:
    """What most rows share, and the intervals of all shares in them, once for all tables."""
    if not found:
        return []
    each = _usual(found)
    most = each[Counter(map(_manner, found)).most_common(1)[0][0]]
    others = [f"{manner}: {', '.join(unlike)}" for manner, own in each.items() if (unlike := _unlike(own, most))]
    shares = {share for one in found for share in (one.share, Share(one.named, one.runs))}
    told = (_text(share) for share in sorted(shares, key=lambda share: (share.n, share.k)))
    usual = "; ".join([", ".join(most), *others])
    return [f"Unless a row says otherwise: {usual}. Intervals: {', '.join(told)}.", ""]


def _manner(one: Found) -> Manner:
    return Hazard.parse(one.hazard).manner


def _unlike(own: tuple[str, ...], usual: tuple[str, ...]) -> list[str]:
    return [mine for mine, other in zip(own, usual, strict=True) if mine != other]


def _text(share: Share) -> str:
    low, high = share.interval
    return f"{share.k}/{share.n} {100 * low:.0f}–{100 * high:.0f} %"


def _conditions(one: Found) -> tuple[str, ...]:
    origin = one.origin
    length, seeds, commits = _origin(origin)
    session = (origin.session, origin.tissue, *length.split(", "))
    return (*session, f"seeds {seeds}", commits)


def _usual(found: list[Found]) -> dict[Manner, tuple[str, ...]]:
    """Returns, for each manner and condition, what most rows have."""
    manners = dict.fromkeys(map(_manner, found))
    alike = {manner: [_conditions(one) for one in found if _manner(one) is manner] for manner in manners}
    return {
        manner: tuple(Counter(each).most_common(1)[0][0] for each in zip(*rows, strict=True))
        for manner, rows in alike.items()
    }


def _kind_table(kind: str, some: list[Found], usual: dict[Manner, tuple[str, ...]]) -> list[str]:
    rows = [_found_row(one, usual[_manner(one)]) for one in some]
    shown = len(_FOUND) if any(row[-1] for row in rows) else len(_FOUND) - 1
    lines = table(_FOUND[:shown], [row[:shown] for row in rows])
    return [f"### {kind}", "", f"Expected: `{FAULTS[kind]}`.", "", *lines]


_FOUND = (
    *("hazard", "FAULT", f"in {SOON_S:g} s", "named", "delay, s", "bound, s", "delay ÷ bound"),
    *("open, s", "OK beyond", "otherwise"),
)


def _found_row(one: Found, usual: tuple[str, ...]) -> Sequence[str]:
    delay = median(one.fault_s) if one.fault_s else None
    bound = one.bound_s
    return (
        f"`{one.hazard}`",
        f"{one.share.k}/{one.runs}",
        f"{one.soon}/{one.runs}",
        f"{one.named}/{one.runs}",
        "–" if delay is None else _with_range(delay, one.fault_s),
        "–" if bound is None else f"{bound:.2f}",
        "–" if bound is None or delay is None or not bound else f"{delay / bound:.1f}",
        f"{median(one.open_s):.2f}" if one.open_s else "–",
        f"{one.gross}/{one.runs}" if Hazard.parse(one.hazard).limited else "–",
        ", ".join(_unlike(_conditions(one), usual)),
    )


def _with_range(middle: float, values: list[float]) -> str:
    """values: in order."""
    low, high = f"{values[0]:.2f}", f"{values[-1]:.2f}"
    return f"{middle:.2f}" if low == high else f"{middle:.2f} ({low}–{high})"


def _false_alarms(healthy: list[Healthy]) -> list[str]:
    head = ("healthy scanning", "hours", "runs", "FAULT", "per hour, under", "WARNINGs", "HALTs", "per hour, under")
    names = dict.fromkeys(one.origin.session for one in healthy)
    sessions = {name: [one for one in healthy if one.origin.session == name] for name in names}
    quiet = [name for name, some in sessions.items() if not any(map(_alarmed, some))]
    groups: dict[str, list[Healthy]] = {"all": healthy}
    groups |= {str(tissue): [one for one in healthy if one.origin.tissue == tissue] for tissue in TISSUES}
    groups |= {name: some for name, some in sessions.items() if name not in quiet}
    rows = [_alarm_row(name, some) for name, some in groups.items()]
    hours = (f"{name} ({sum(one.hours for one in sessions[name]):.2f} h)" for name in quiet)
    none = [f"Sessions without any: {', '.join(hours)}.", ""] if quiet else []
    text = "Runs with a FAULT, and how often the states began."
    return ["## False alarms", "", text, "", *table(head, [row for row in rows if row]), *none]


def _alarmed(one: Healthy) -> bool:
    return bool(one.faulted or one.warnings or one.halts)


def _alarm_row(name: str, some: list[Healthy]) -> Sequence[str]:
    hours, faulted, halts = (
        sum(one.hours for one in some),
        sum(one.faulted for one in some),
        sum(one.halts for one in some),
    )
    if not hours:
        return ()
    return (
        name,
        f"{hours:.2f}",
        str(sum(one.runs for one in some)),
        str(faulted),
        f"{false_rate_per_hour(faulted, hours):.2g}",
        str(sum(one.warnings for one in some)),
        str(halts),
        f"{false_rate_per_hour(halts, hours):.2g}",
    )


def _confusion(found: list[Found]) -> list[str]:
    """Classes against what was named first."""
    told = sorted({name for one in found for name in one.told if name})
    rows = []
    for fault in dict.fromkeys(FAULTS.values()):
        some = [one for one in found if FAULTS[_kind(one)] is fault]
        counts = [sum(one.told.get(name, 0) for one in some) for name in (*told, "")]
        if sum(counts):
            right = Share(sum(one.named for one in some), sum(counts))
            rows.append((f"`{fault}`", *map(str, counts), str(right)))
    head = ("", *(f"`{name}`" for name in told), "nothing", "right")
    text = "Rows: what it is. Columns: the name that came first."
    return ["## Confusion", "", text, "", *table(head, rows)]


_ROC = """For each threshold: the share of healthy runs, and of runs with a hazard of each class, in which the log
likelihood ratio of the sequential test reached it at any time (with a hazard: after its onset). *Area*: how often a run
with the hazard came higher than a healthy one, ties by half. It is the test's own, without what is seen to happen and
without the condition that one class alone explains it. Without a ratio, and left out: {left} of {all} runs.
"""


def _roc(figures: Figures) -> list[str]:
    """What the sequential test would tell at other thresholds."""
    quiet = _quiet_nats(figures)
    everything: list[Healthy | Found] = [*figures.healthy, *figures.found]
    runs = sum(one.runs for one in everything)
    left = runs - sum(len(one.nats) for one in everything)
    lines = ["## ROC of the sequential test", "", _ROC.format(left=left, all=runs)]
    classes = _class_nats(figures.found)
    if not quiet or not classes:
        return [*lines, "Not measured.", ""]
    rows = [
        (f"`{fault}`", str(Share(_reached(nats, WITHDRAWN_NATS), len(nats))), str(_named(nats)), _area(nats, quiet))
        for fault, nats in classes.items()
    ]
    rows += [("healthy", str(Share(_reached(quiet, WITHDRAWN_NATS), len(quiet))), str(_named(quiet)), "–")]
    head = ("", f"reached {WITHDRAWN_NATS:g} nats", f"reached {NAMED_NATS:.1f} nats", "area")
    picture = "![share of runs with a hazard over the share of healthy runs](pictures/roc.svg)"
    return [*lines, picture, "", *table(head, rows)]


def _quiet_nats(figures: Figures) -> list[float]:
    return [nats for one in figures.healthy for nats in one.nats]


def _class_nats(found: list[Found]) -> dict[Fault, list[float]]:
    """Nats of each class that was measured."""
    each = {fault: [nats for one in of_fault(found, fault) for nats in one.nats] for fault in FAULTS.values()}
    return {fault: nats for fault, nats in each.items() if nats}


def _reached(nats: list[float], level: float) -> int:
    return sum(one >= level for one in nats)


def _named(nats: list[float]) -> Share:
    return Share(_reached(nats, NAMED_NATS), len(nats))


def _area(nats: list[float], quiet: list[float]) -> str:
    pairs = [(one > other) + 0.5 * (one == other) for one in nats for other in quiet]
    return f"{mean(pairs):.3f}"


_CURVES = ("a", "b", "bad", "mark", "c", "d")
"""Colours of the classes; a seventh would take the first again."""


def _roc_picture(figures: Figures) -> str:
    quiet, classes = _quiet_nats(figures), _class_nats(figures.found)
    plot = Plot((0, 100), (0, 100), "% of healthy runs", "% of runs with the hazard", 300)
    # The longest name first: at the right edge there is room for a short one.
    for kind, fault in zip(cycle(_CURVES), sorted(classes, key=len, reverse=True), strict=False):
        levels = sorted({*classes[fault], *quiet}, reverse=True)
        xs, ys = ([_percent(nats, level) for level in levels] for nats in (quiet, classes[fault]))
        plot.line([0.0, *xs], [0.0, *ys], kind, str(fault))
    return alone(plot.svg("ROC of the sequential test, a line for each class of hazard"))


def _percent(nats: list[float], level: float) -> float:
    return 100 * _reached(nats, level) / len(nats) if nats else 0.0


def of_fault(found: list[Found], fault: Fault) -> list[Found]:
    """Those whose name ought to be this one."""
    return [one for one in found if FAULTS[_kind(one)] is fault]


def _coverage_picture(healthy: list[Healthy]) -> str:
    bars = [
        (f"{one.origin.session}, {one.origin.tissue}, {one.origin.asked}", [100 * share for share in one.closed],
         "b" if one.origin.tissue == "breathing" else "a")
        for one in healthy
    ]  # fmt: skip
    plot = Plot(
        (0, 100),
        (0, max(len(bars), 1)),
        "% of the session; bar: median, marks: runs; blue: still, orange: breathing",
        "",
        _height(bars),
    )
    for row, (name, shares, kind) in enumerate(bars):
        y = len(bars) - row
        plot.block(0, median(shares), y - 0.9, y - 0.1, kind, name)
        _marks(plot, shares, y, 0.3)
        plot.word(0, y - 0.6, name)
    return alone(plot.svg("share of each session with the contact closed"))


def _sensitivity_picture(found: list[Found]) -> str:
    plot = Plot(
        (0, 100),
        (0, max(len(found), 1)),
        "% of runs with a FAULT; bar: share, marks: 95 % interval",
        "",
        _height(found),
    )
    for row, one in enumerate(found):
        y = len(found) - row
        plot.block(0, 100 * len(one.fault_s) / one.runs, y - 0.9, y - 0.1, "a", one.hazard)
        _marks(plot, [100 * edge for edge in one.share.interval], y, 0.3)
        plot.word(0, y - 0.6, f"{one.hazard}, {one.origin.session}")
    return alone(plot.svg("share of runs in which each hazard was found"))


def _delay_picture(found: list[Found]) -> str:
    seen = [one for one in found if one.fault_s]
    label = f"delay of the FAULT, s, later than {_MOST_DELAY_S:g} at the edge; bar: median, marks: runs, red: bound"
    plot = Plot((0, _MOST_DELAY_S), (0, max(len(seen), 1)), label, "", _height(seen))
    for row, one in enumerate(seen):
        y = len(seen) - row
        plot.block(0, median(one.fault_s), y - 0.9, y - 0.1, "a", one.hazard)
        _marks(plot, one.fault_s, y, 0.02)
        if one.bound_s is not None:
            plot.block(one.bound_s, one.bound_s + 0.04, y - 1, y, "bad", f"bound {one.bound_s:.2f} s")
        plot.word(0, y - 0.6, f"{one.hazard}, {one.origin.session}")
    return alone(plot.svg("delays of the FAULT and their bounds"))


def _marks(plot: Plot, places: Iterable[float], y: float, wide: float) -> None:
    for x in places:
        plot.block(x, x + wide, y - 0.75, y - 0.25, "mark", f"{x:.3g}")


def _height(rows: Sequence[object]) -> int:
    return _ROW * len(rows) + _FRAME
