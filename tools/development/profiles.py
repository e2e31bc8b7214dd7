"""Measures what each profile of the limits costs and finds.

`python -m probewatch.tools.development.profiles --table study.csv` writes docs/profiles.json from the rows of
`probewatch study`, and docs/profiles.md from that.
"""

import json
from collections.abc import Iterable, Iterator, Sequence
from math import isfinite, sqrt
from pathlib import Path
from statistics import median
from typing import Any

import click

from probewatch.appliance.core.parameters import CLASSES, MEASURED, QUANTITIES
from probewatch.appliance.limits import PROFILES, Limits
from probewatch.appliance.types import Fault
from probewatch.tools.development.evidence_pages import DOCS
from probewatch.tools.development.markdown import shared_aside, table
from probewatch.tools.development.study_rows import study_rows
from probewatch.tools.study.samples import KEYS
from probewatch.tools.study.summary import Row, Share, false_rate_per_hour, number

DATA, PAGE = DOCS / "profiles.json", DOCS / "profiles.md"
_NAMED_S = 15.0
"""Seconds from the start, by when what is wrong is to be named. The sessions with a hazard may be shorter; then all of
them."""
_CONDITIONS = ("session", "tissue", "noise_mm", "duration_s", "profile", "hazard")
"""Columns that rows of one line of the tables share."""
Figure = dict[str, Any]


def figures(rows: Sequence[Row]) -> list[Figure]:
    """Returns one figure for each set of conditions, in the order of the pages; seeds and commits are in it."""
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in _CONDITIONS), []).append(row)
    order: list[str] = list(PROFILES)
    return [_figure(groups[key]) for key in sorted(groups, key=lambda key: (key[5], *key[:4], order.index(key[4])))]


def _figure(rows: Sequence[Row]) -> Figure:
    errors = {name: _errors(rows, name) for name in MEASURED}
    return {name: rows[0][name] for name in _CONDITIONS} | {
        "seeds": sorted(int(row["seed"]) for row in rows),
        "commits": sorted({row["commit"] for row in rows}),
        "closed": [number(row, "closed") for row in rows],
        "closed_s": [_or_none(number(row, "closed_s")) for row in rows],
        "named_s": [_or_none(number(row, "named_s")) for row in rows],
        "faults": [row["faults"] for row in rows],
        "ok_s": [round(number(row, "ok") * number(row, "duration_s"), 3) for row in rows],
        "minutes": round(sum(number(row, "duration_s") for row in rows) / 60, 3),
        "errors": {name: error for name, error in errors.items() if error is not None},
    }


def _errors(rows: Sequence[Row], name: str) -> float | None:
    """Returns the root of the mean square of value − truth at the looks, in the unit of the check; it is approximate,
    because the sigma is the last one.
    """
    known = [row for row in rows if number(row, f"{name} looks") > 0]
    if not known:
        return None
    squares = [
        number(row, f"{name} squares") / number(row, f"{name} looks") * number(row, f"{name} sigma") ** 2
        for row in known
    ]
    return round(sqrt(sum(squares) / len(squares)), 3)


def page(data: Sequence[Figure]) -> str:
    """Returns docs/profiles.md."""
    healthy = [one for one in data if one["hazard"] == "none"]
    sick = [one for one in data if one["hazard"] != "none"]
    lines = [*_HEAD.splitlines(), "", *_limits(), *_REACH.splitlines(), "", "## What each costs", ""]
    lines += [*_measured(data).splitlines(), "", *_healthy(healthy), *_alarms(healthy), "", "## What each finds", ""]
    lines += [*_found().splitlines(), "", *_sick(sick), "## What fine asks for", "", *_WHY.splitlines(), ""]
    lines += [*_rests(healthy), *_COMMAND.splitlines()]
    return "\n".join(lines).rstrip("\n") + "\n"


def _limits() -> list[str]:
    head = ("profile", "rotation, °", "scale, %", "offset, mm", "latency, ms", "error of a point, mm")
    keys = ("rotation_deg", "scale_percent", "offset_mm", "latency_ms", "point_mm")
    each = {name: Limits(profile=name) for name in PROFILES}
    return table(head, ((f"`{name}`", *(_text(getattr(one, key)) for key in keys)) for name, one in each.items()))


def _measured(data: Sequence[Figure]) -> str:
    commits = ", ".join(f"`{one}`" for one in sorted({commit for one in data for commit in one["commits"]}))
    return f"Simulated, all ten checks required, commit {commits or '–'}; scenes as in [study.md](study.md)."


def _healthy(data: Sequence[Figure]) -> list[str]:
    """Returns a row for each session, tissue and tracker, a column for each profile."""
    own = [name for name in PROFILES if any(one["profile"] == name for one in data)]
    head = ("session", "tissue", "tracker", *(f"`{name}`" for name in own))
    rows: dict[tuple[str, str, str], dict[str, str]] = {}
    for one in data:
        place = (f"{one['session']}, {one['duration_s']} s", one["tissue"], f"{one['noise_mm']} mm")
        rows.setdefault(place, {})[one["profile"]] = _healthy_cell(one)
    return [
        _CELLS,
        "",
        *table(head, ((*place, *(cells.get(name, "–") for name in own)) for place, cells in rows.items())),
    ]


def _healthy_cell(one: Figure) -> str:
    closed_s = [s for s in one["closed_s"] if s is not None]
    percent = [100 * share for share in one["closed"]]
    told = Share(len(closed_s), len(percent)).brief
    return f"{told}; {_spread(closed_s, 1)} s; {_spread(percent, 0)} %" if closed_s else told


def _alarms(data: Sequence[Figure]) -> Iterator[str]:
    for name in PROFILES:
        own = [one for one in data if one["profile"] == name]
        if own:
            faults, minutes = sum(bool(f) for one in own for f in one["faults"]), sum(one["minutes"] for one in own)
            most = false_rate_per_hour(faults, minutes / 60)
            yield f"- `{name}`: {faults} FAULTs in {minutes:.1f} min without a fault (under {most:.0f} an hour, 95 %)."


def _found() -> str:
    turn, shift = (3 * QUANTITIES[fault].left_out_rigid for fault in (Fault.ROTATION, Fault.OFFSET))
    each = ((name, Limits(profile=name)) for name in PROFILES)
    least = ", ".join(
        f"{one.rotation_deg + turn:g}° and {one.offset_mm + shift:g} mm for `{name}`" for name, one in each
    )
    return _FOUND.format(turn=turn, shift=shift, least=least)


def _sick(data: Sequence[Figure]) -> list[str]:
    head = ("wrong from the start", "profile", "named rightly", "after, s", "OK or closed at any time")
    return shared_aside(head, (_sick_cells(one) for one in data), head[-1:])


def _sick_cells(one: Figure) -> Sequence[str]:
    named = [s for s in one["named_s"] if s is not None and s <= _NAMED_S]
    passed = sum(ok > 0 or closed > 0 for ok, closed in zip(one["ok_s"], one["closed"], strict=True))
    n = len(one["seeds"])
    return one["hazard"], f"`{one['profile']}`", Share(len(named), n).brief, _spread(named, 1), Share(passed, n).brief


def _rests(data: Sequence[Figure]) -> list[str]:
    """Returns the rows of the table of errors: RMS of each estimate, then what is added to each sigma, and the limits
    of `fine`.
    """
    fine = Limits(profile="fine")
    places = list(dict.fromkeys((one["session"], one["tissue"], one["noise_mm"]) for one in data))
    kinds = {fault: QUANTITIES[fault] for fault in CLASSES}
    head = ("RMS error, of the worst axis", *(f"{fault}, {kind.unit}" for fault, kind in kinds.items()))
    rows: list[Sequence[str]] = [_rest_cells(data, place) for place in places]
    rows.append(
        (
            "**added to every sigma, rigid tissue; the least of a latency**",
            *(f"{kind.left_out_rigid:g}" for kind in kinds.values()),
        )
    )
    rows.append(
        (
            "**added to every sigma, any other; the least of a latency**",
            *(f"{kind.left_out:g}" for kind in kinds.values()),
        )
    )
    rows.append(("**limit of `fine`**", *(f"{kind.limit(fine):g}" for kind in kinds.values())))
    return table(head, rows)


def _rest_cells(data: Sequence[Figure], place: tuple[str, str, str]) -> Sequence[str]:
    """Returns one row: the largest error of each class."""
    own = next(one for one in data if (one["session"], one["tissue"], one["noise_mm"]) == place)
    session, tissue, noise_mm = place
    worst: dict[Fault, float] = {}
    for name, fault in zip(MEASURED, CLASSES, strict=True):
        if name in own["errors"]:
            worst[fault] = max(worst.get(fault, 0.0), own["errors"][name])
    errors = (f"{worst[fault]:.2g}" if fault in worst else "–" for fault in dict.fromkeys(CLASSES))
    return f"{session}, {tissue}, {noise_mm} mm", *errors


def _spread(values: Iterable[float], digits: int) -> str:
    """Returns the median of the values, and their least and most where they differ."""
    known = [value for value in values if isfinite(value)]
    if not known:
        return "–"
    least, most = f"{min(known):.{digits}f}", f"{max(known):.{digits}f}"
    return least if least == most else f"{median(known):.{digits}f} ({least}–{most})"


def _text(value: float | None) -> str:
    return "–" if value is None else f"{value:g}"


def _or_none(value: float) -> float | None:
    return value if isfinite(value) else None


def read_figures() -> list[Figure]:
    """Returns the figures of docs/profiles.json."""
    return list(json.loads(DATA.read_text(encoding="utf-8")))


@click.command()
@click.option("--table", "path", required=True, type=click.Path(path_type=Path, exists=True, dir_okay=False))
def main(path: Path) -> None:
    """Write docs/profiles.json and docs/profiles.md from the rows of a study."""
    data = figures(study_rows(path, {*KEYS, "commit"}, "--profiles"))
    DATA.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(page(data), encoding="utf-8")


_HEAD = """# Profiles: how far off the calibration may be

For clinical engineers. `[limits] profile` sets five limits at once; a limit that the file gives replaces the profile's.
`probewatch check`, `probewatch status`, the page and the replay report name the profile and the limits that differ. A
tighter profile lets less error pass and keeps the contact open for longer. After a change by `probewatch reload` motion
must show everything again."""
_REACH = """Limits are of a change **against the reference**. Errors of the reference ([crosswire.md](crosswire.md))
and errors of the tracker that are alike everywhere ([trackers.md](trackers.md)) come on top.

| tracker | profile |
|---|---|
| optical, 0.1 mm of noise, rigid tissue or phantom | `coarse`, `clinical`; `fine` by a gesture of 10 s |
| the same, 0.25 mm | `coarse`, `clinical` |
| optical, tissue that gives way as a patient's | `coarse`; see below before relying on `clinical` |
| electromagnetic | not tried; one that errs by place is rarely verified by `coarse` ([16](known-anomalies.md)) |
| any other | `fine`: none |"""
_FOUND = """Motion names only what is beyond its limit by three standard deviations, at least {turn:g}° and
{shift:g} mm: from {least} on.
What lies between that and the limit keeps the contact open, once motion shows it. A slip in view is seen by its leap,
from the limit on ([evidence.md](evidence.md#slips-of-the-marker-body-in-view)). Gesture on rigid tissue, tracker of
0.1 mm, by the end of the session."""
_WHY = """An OK needs three standard deviations of room, and each includes what the model of the motion leaves out
([method.md](method.md), section 10). In tissue that was shown to be rigid little is left out, and motion for ten
seconds brings sigma down to the third of 1° that `fine` asks for. In any other tissue 0.5 mm are added to each sigma
of an offset, so 1.5 mm of the 1.5 mm of `fine`: it is never verified there, and `probewatch check` says so.

Tissue counts as rigid that follows a press by as much as a scale may be wrong, 5 % at most. What the gesture shows of
that share widens the sigma of the axial scale, so `fine` and `clinical` are hardly verified over foam: put the phantom
on a rigid table. In tissue that may give way motion names rotation, scale and offset from the limits of `coarse` on,
whatever the profile."""
_CELLS = "Runs in which the contact closed (95 %); when it first did; share of the session. Medians (least–most)."
_COMMAND = """Written by `python -m probewatch.tools.development.profiles --table study.csv` from rows of `probewatch
study`:

```
probewatch study --sessions gesture-hold --tissues rigid,half-30+deep --seeds 3 --duration 20 --noise-mm .1,.25 \\
  --profiles coarse,clinical,fine
probewatch study --sessions gesture --tissues rigid --seeds 6 --duration 16 --profiles fine
probewatch study --sessions gesture-mixed --tissues rigid --seeds 2 --duration 48 --profiles coarse,clinical
probewatch study --sessions gesture --tissues rigid --seeds 3 --duration 12 --profiles clinical,fine \\
  --hazards slide-lateral=2@start,bend-axial=1.5@start,slide-lateral=4@start,bend-axial=2.5@start
```

and likewise for the other lines."""


if __name__ == "__main__":
    main()
