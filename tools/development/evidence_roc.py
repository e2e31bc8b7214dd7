"""Makes the section of docs/evidence.md on the ROC of the sequential test, and its drawing. It is pure."""

from itertools import cycle
from statistics import mean

from probewatch.appliance.limits import NAMED_NATS, WITHDRAWN_NATS
from probewatch.appliance.types import Fault
from probewatch.tools.development.evidence_figures import Figures, Found, Healthy, of_fault
from probewatch.tools.development.markdown import table
from probewatch.tools.report.svg import Plot, alone
from probewatch.tools.study.hazard import FAULTS
from probewatch.tools.study.summary import Share

_ROC = """Share of runs in which the log likelihood ratio of the sequential test reached a threshold at any time (with a
hazard: after its onset). *Area*: how often a run with the hazard came higher than a healthy one, ties by half. Left out
is what is seen to happen, the condition that one class alone explains it, and {left} of {all} runs, without a ratio.
"""


def roc_section(figures: Figures) -> list[str]:
    """Returns what the sequential test would show at other thresholds."""
    quiet = _quiet_nats(figures)
    everything: list[Healthy | Found] = [*figures.healthy, *figures.found]
    runs = sum(one.runs for one in everything)
    left = runs - sum(len(one.nats) for one in everything)
    lines = ["## ROC of the sequential test", "", _ROC.format(left=left, all=runs)]
    classes = _class_nats(figures.found)
    if not quiet or not classes:
        return [*lines, "Not measured.", ""]
    rows = [
        (f"`{fault}`", Share(_reached(nats, WITHDRAWN_NATS), len(nats)).brief, _named(nats).brief, _area(nats, quiet))
        for fault, nats in classes.items()
    ]
    rows += [("healthy", Share(_reached(quiet, WITHDRAWN_NATS), len(quiet)).brief, _named(quiet).brief, "–")]
    head = ("", f"reached {WITHDRAWN_NATS:g} nats", f"reached {NAMED_NATS:.1f} nats", "area")
    picture = "![share of runs with a hazard over the share of healthy runs](pictures/roc.svg)"
    return [*lines, picture, "", *table(head, rows)]


def _quiet_nats(figures: Figures) -> list[float]:
    return [nats for one in figures.healthy for nats in one.nats]


def _class_nats(found: list[Found]) -> dict[Fault, list[float]]:
    """Returns the nats of each class that was measured."""
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
"""Colours of the classes; a seventh class would take the first again."""


def roc_picture(figures: Figures) -> str:
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
