"""Writes docs/coverage.md and docs/evidence.md, with their pictures, from docs/evidence.json, for `make docs`. It is
pure.
"""

import json
from collections import Counter
from collections.abc import Sequence
from math import sqrt
from pathlib import Path
from statistics import mean, median, stdev

from scipy.stats import t as student

from probewatch.appliance.core.parameters import MEASURED
from probewatch.appliance.types import Fault
from probewatch.tools.development.evidence_figures import SOON_S, Figures, Found, Healthy, Origin, of_fault
from probewatch.tools.development.evidence_pictures import coverage_picture, delay_picture, sensitivity_picture
from probewatch.tools.development.evidence_points import point_lines
from probewatch.tools.development.evidence_roc import roc_picture, roc_section
from probewatch.tools.development.false_alarm_pages import false_alarm_lines
from probewatch.tools.development.markdown import shared_aside, table
from probewatch.tools.development.slips import slip_page
from probewatch.tools.study.bound import FALSE_ALARM_H
from probewatch.tools.study.hazard import CREEP_S, FAULTS, HIDDEN_S, ONSET_S, Hazard, Manner
from probewatch.tools.study.samples import DEFAULT, WITHOUT_OFFSETS
from probewatch.tools.study.session import TISSUES
from probewatch.tools.study.summary import Share, false_rate_per_hour

_SENSITIVITY = f"""Sudden and creeping hazards begin at {ONSET_S:g} s, creeping ones grow for {CREEP_S:g} s, unseen
ones happen while nothing is in sight for {HIDDEN_S:g} s. *Delay*: until the FAULT, median (range). *Bound*: the least
mean delay of any test with one false alarm in {FALSE_ALARM_H:g} h, for this motion and noise (Kullback and Leibler,
`tools/study/bound.py`); none where the change is seen to happen, or has no size. *Open*: median time until the contact
was open for good. *OK beyond*: runs with an OK at twice the limit at any time after the onset, also before it was
found.
"""

DOCS = Path(__file__).parents[2] / "docs"
DATA = DOCS / "evidence.json"
_COVERAGE = """# Coverage: how often is healthy scanning verified?

The share of a session of simulated healthy scanning ([study.md](study.md)) with the contact closed. `make
coverage-page` measures it and writes this page.

To repeat a row: `{command}`.
"""
_EVIDENCE = """# Evidence: what is found, how soon, and how often it alarms for nothing

`make evidence` (short) or `make evidence-full` measures this and writes this page. Everything is simulated
([what that cannot tell](study.md#what-it-cannot-tell)). Intervals are 95 %, of shares by Clopper and Pearson, of rates
Poisson's. **Few runs make wide intervals: read the intervals, not the shares.**

To repeat a row: `{command}`; `--seeds` and `--draws` as many as its highest.
"""


def read_figures() -> Figures:
    """Returns the figures that were last measured."""
    return Figures.parse(json.loads(DATA.read_text(encoding="utf-8")))


def pages(figures: Figures) -> dict[Path, str]:
    """Returns file → text of everything that is written from the figures."""
    return {
        DOCS / "coverage.md": _coverage(figures),
        DOCS / "evidence.md": _evidence(figures),
        DOCS / "pictures" / "coverage.svg": coverage_picture(figures.healthy),
        DOCS / "pictures" / "sensitivity.svg": sensitivity_picture(figures.found),
        DOCS / "pictures" / "delay.svg": delay_picture(figures.found),
        DOCS / "pictures" / "roc.svg": roc_picture(figures),
    }


def command(hazards: str = "") -> str:
    """Returns the command that repeats the runs of a row."""
    return (
        "probewatch study --sessions S --tissues T --noise-mm N --asked A --duration D --seeds K"
        f"{' --hazards H' if hazards else ''}"
    )


def _coverage(figures: Figures) -> str:
    healthy = figures.healthy
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
    lines += point_lines(figures.points)
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

(value − truth) ÷ sigma of every check in every world (number of its sessions), once a second: root of the mean square,
median (least–most); then the largest. 1 is honest; less, and sigma is too large. Sigma includes what the model leaves
out, which motion does not lessen. Few seeds leave a figure uncertain by a fifth and more. `scores` of
`docs/evidence.json` has each session.
"""


def _scores(healthy: list[Healthy]) -> list[str]:
    scored = [one for one in healthy if one.scores]
    worlds = {tissue: [one for one in scored if one.origin.tissue == tissue] for tissue in _worlds(scored)}
    rows = [(f"{tissue} ({len(some)})", *(_score(name, some) for name in MEASURED)) for tissue, some in worlds.items()]
    return [_SCORES, *table(("world", *MEASURED), rows)] if worlds else []


def _worlds(scored: list[Healthy]) -> list[str]:
    """Returns the tissues, those with most sessions first."""
    return [tissue for tissue, _ in Counter(one.origin.tissue for one in scored).most_common()]


def _score(name: str, sessions: list[Healthy]) -> str:
    """Returns the cell of one check in one world, whose sessions these are."""
    scores = [one.scores[name] for one in sessions if name in one.scores]
    if not scores:
        return "–"
    rms = sorted(score.rms for score in scores)
    return f"{_with_range(median(rms), rms)}; {max(score.worst for score in scores):.1f}"


def _mean(shares: list[float]) -> str:
    """Returns the mean with Student's interval, cut to what a share can be."""
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
            for fault in dict.fromkeys(FAULTS.values())
            if (some := of_fault(found, fault))
            for line in _class_table(fault, some, _usual(found))
        ),
        *slip_page(),
        *_confusion(found),
        *roc_section(figures),
        *_note(),
    ]
    return "\n".join(lines)


def _usually(found: list[Found]) -> list[str]:
    """Returns what most rows share, and the intervals of all shares in them, once for all tables."""
    if not found:
        return []
    each = _usual(found)
    most = each[Counter(map(_manner, found)).most_common(1)[0][0]]
    others = [f"{manner}: {', '.join(unlike)}" for manner, own in each.items() if (unlike := _unlike(own, most))]
    shares = {share for one in found for share in (one.share, *(Share(k, one.runs) for k in (one.soon, one.named)))}
    told = (_text(share) for share in sorted(shares, key=lambda share: (share.n, share.k)))
    usual = "; ".join([", ".join(most), *others])
    named = f"every FAULT came in {SOON_S:g} s and its first name was right"
    return [f"Unless a row says otherwise: {usual}; {named}. Intervals: {', '.join(told)}.", ""]


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


def _class_table(fault: Fault, some: list[Found], usual: dict[Manner, tuple[str, ...]]) -> list[str]:
    order = list(FAULTS)
    rows = [_found_row(one, usual[_manner(one)]) for one in sorted(some, key=lambda one: order.index(one.kind))]
    shown = len(_FOUND) if any(row[-1] for row in rows) else len(_FOUND) - 1
    return [f"### {fault}", "", *table(_FOUND[:shown], [row[:shown] for row in rows])]


_FOUND = ("hazard", "FAULT", "delay, s", "bound, s", "open, s", "OK beyond", "otherwise")


def _found_row(one: Found, usual: tuple[str, ...]) -> Sequence[str]:
    delay = median(one.fault_s) if one.fault_s else None
    bound = one.bound_s
    faults = len(one.fault_s)
    counted = ((one.soon, f"in {SOON_S:g} s"), (one.named, "rightly"))
    otherwise = [f"{number}/{one.runs} {what}" for number, what in counted if number != faults]
    return (
        f"`{one.hazard}`",
        f"{one.share.k}/{one.runs}",
        "–" if delay is None else _with_range(delay, one.fault_s),
        "–" if bound is None else f"{bound:.2f}",
        f"{median(one.open_s):.2f}" if one.open_s else "–",
        f"{one.gross}/{one.runs}" if Hazard.parse(one.hazard).limited else "–",
        ", ".join([*otherwise, *_unlike(_conditions(one), usual)]),
    )


def _with_range(middle: float, values: list[float]) -> str:
    """Returns the middle value with the range of the values. values: in order."""
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
    without = "all" if len(quiet) == len(sessions) else ", ".join(quiet)
    none = [f"Sessions without any: {without}.", ""] if quiet else []
    text = "Runs with a FAULT, and how often the states began, in the sessions of [coverage.md](coverage.md)."
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
    """Returns how often each class was named first as what it is, and as what else."""
    rows = []
    for fault in dict.fromkeys(FAULTS.values()):
        some = of_fault(found, fault)
        named = sum((Counter(one.told) for one in some), Counter[str]())
        others = [f"{number} {f'`{name}`' if name else 'nothing'}" for name, number in named.items() if name != fault]
        if named.total():
            right = Share(sum(one.named for one in some), named.total())
            rows.append((f"`{fault}`", right.brief, ", ".join(others)))
    return ["## First names", "", *table(("what it is", "named rightly first", "otherwise"), rows)]
