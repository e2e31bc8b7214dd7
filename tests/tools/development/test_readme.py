"""The table of the README has the figures of the last study."""

import re
from statistics import median

from probewatch.tools.development.evidence_pages import read_figures
from probewatch.tools.development.hazards import ROOT

KINDS = {
    "picture mirrored": ("flip-lateral", "flip-axial"),
    "depth or zoom changed by 10 %": ("depth=-10",),
    "picture stretched along one axis by 10 %": ("scale-lateral=-10", "scale-axial=-10"),
    "marker body bent by 6°": ("bend-lateral=-6", "bend-axial=-6", "bend-elevational=-6"),
    "marker body slid by 8 mm": ("slide-lateral=-8", "slide-axial=-8", "slide-elevational=-8"),
    "tracker late by 450 ms, early by 120 ms": ("latency=-120", "latency=450"),
    "another probe": ("exchanged-probe",),
    "poses in another convention": ("poses-inverted", "axes-swapped"),
    "metal that displaces poses by 6 mm": ("metal=6",),
}
"""Row of the table → what the study calls it."""


def told(delay_s: float) -> str:
    """Below a tenth of a second one digit, above ten seconds three."""
    return f"{delay_s:.{1 if delay_s < 0.1 else 2 if delay_s < 10 else 3}g}"


def cell(kinds: tuple[str, ...], manner: str) -> str:
    """Medians of the kinds, from the least to the largest, and a run that took more than twice as long as any."""
    found = {one.hazard: one.fault_s for one in read_figures().found}
    delays_s = [found[f"{kind}@{manner}"] for kind in kinds if found.get(f"{kind}@{manner}")]
    if not delays_s:
        return "–"
    medians = sorted({told(median(one)) for one in delays_s}, key=float)
    late = [told(one) for some in delays_s for one in some if one > 2 * max(median(some) for some in delays_s)]
    return f"{' to '.join((medians[0], *medians[1:][-1:]))} s{''.join(f', one run {one} s' for one in late)}"


def test_the_delays_of_the_readme_are_those_of_the_study() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    rows = {row[0]: row[2:] for line in re.findall(r"^\| (.*) \|$", text, re.M) if len(row := line.split(" | ")) == 4}
    assert {name: rows.get(name) for name in KINDS} == {
        name: [cell(kinds, "sudden"), cell(kinds, "start")] for name, kinds in KINDS.items()
    }
