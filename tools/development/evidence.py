"""Runs what is left of a plan, and writes docs/evidence.json and the pages from it.

`python -m probewatch.tools.development.evidence PLAN` starts it; `--table FILE` writes them from the rows of a study
that exists.
"""

import json
import os
from collections.abc import Sequence
from pathlib import Path

import click

from probewatch.tools.development.evidence_figures import Figures, figures
from probewatch.tools.development.evidence_pages import DATA, pages, read_figures
from probewatch.tools.development.study_rows import study_rows
from probewatch.tools.shared.terminal import progress_bar
from probewatch.tools.study.hand import GESTURED, PROGRAMS
from probewatch.tools.study.hazard import CREEP_S, ONSET_S, STANDARD, WITHIN, Hazard, Manner
from probewatch.tools.study.plan import Task, planned, tasks
from probewatch.tools.study.samples import KEYS, WITHOUT_OFFSETS, Conditions
from probewatch.tools.study.session import TISSUES
from probewatch.tools.study.summary import Row
from probewatch.tools.study.table import StudyTable, code_digest
from probewatch.tools.study.workers import results

RESULTS = Path("results/evidence")
_NOISES_MM = (0.1,)
"""Millimetres: noise of an optical tracker at 1.5 m."""
_SHORT_S = 30.0
"""Seconds of a session with a hazard in the short form: the hazard begins at 20 s, so delays above 10 s count as not
found. A session with a creeping hazard is longer, so that the hazard lasts as long at its full size."""
_FULL_SEEDS, _FULL_DRAWS = 20, 180
"""20 seeds for each cell of the table; 3,600 times the 17 minutes of all healthy sessions are 1,020 hours. They take
about 200 hours of one processor, at .18 s for a second of a session."""
_FULL_SESSIONS = ("gesture", "in-plane", "elevational-10", "fan", "mixed")
"""One session of each kind of motion; all nine would take twice as long. What the others would add was not measured."""
_SHORT_SIZES = (
    *("bend-lateral=-6", "bend-axial=-6", "bend-elevational=-6"),
    *("slide-lateral=-8", "slide-axial=-8", "slide-elevational=-8"),
    *("scale-lateral=-10", "scale-axial=-10", "depth=-10"),
    *("latency=-120", "latency=450", "flip-lateral", "flip-axial"),
)
"""Twice the limit of each, and the latency of a real recording."""


WORLDS = (
    *("layers", "convex", "ribs-1", "ribs-2", "gas-1", "peel-0.6", "contact-0.6", "needle+half-30+deep"),
    *("half-30+deep", "half-20+deep", "layer-80+deep", "half-30+drag-2+deep", "foam-0.5+deep"),
    *("breath-12-axial", "breath-12-elevational", "breath-8-oblique+half-30+deep", "organ-8-axial+half-30+deep"),
    *("persistence-0.5", "slow", "jpeg-30", "tracker-0.8", "tracker-0.8+half-30+deep"),
)
"""One or two of each kind of `surroundings`, healthy: soft ones with pictures deep enough to be verified."""
_DRAWS = 5
"""Slight errors on the same pictures: with four seeds, more than 500 runs over all worlds."""
_AFTER_S = 8.0
"""Of a session after something has crept in: as long as it took."""
_WORLD_S = 20.0
"""Seconds of a session in one of them: the slowest are verified after 16 s."""


def points_plan(seeds: int) -> list[Conditions]:
    """Slight errors from the start in every world; ones that creep in over still and breathing tissue."""
    start = WITHIN[:_DRAWS]
    creeping = [Hazard.parse(str(one).replace(Manner.START, Manner.CREEPING)) for one in start]
    longer_s = ONSET_S + CREEP_S + _AFTER_S
    return [
        *planned(("gesture-hold",), (*TISSUES, *WORLDS), seeds, _NOISES_MM, start, _WORLD_S),
        *planned(("gesture-hold",), TISSUES, seeds, _NOISES_MM, creeping, longer_s),
    ]


def short_hazards() -> tuple[Hazard, ...]:
    """Returns each size in every manner that it can have, metal, another probe, and the wrong conventions."""
    each = [
        f"{size}@{manner}" for size in _SHORT_SIZES for manner in Manner if "=" in size or manner is not Manner.CREEPING
    ]
    metal = "metal=6@start", "metal=6@creeping"
    others = "exchanged-probe@start", "exchanged-probe@unseen", "poses-inverted@start", "axes-swapped@start"
    return tuple(Hazard.parse(text) for text in (*each, *metal, *others))


def coverage_plan(seeds: int) -> list[Conditions]:
    """Returns every session of ordinary scanning, without the offsets being asked for, and after a gesture with
    everything.
    """
    begun = tuple(name for name in GESTURED if name != "gesture")
    alone = planned(tuple(PROGRAMS), TISSUES, seeds, _NOISES_MM, [Hazard()], asked=WITHOUT_OFFSETS)
    return alone + planned(begun, TISSUES, seeds, _NOISES_MM, [Hazard()])


def worlds_plan(seeds: int) -> list[Conditions]:
    """Returns a healthy cart in every kind of world: a gesture, then a hold."""
    return planned(("gesture-hold",), WORLDS, seeds, _NOISES_MM, [Hazard()], _WORLD_S)


def short_plan(seeds: int) -> list[Conditions]:
    """Returns large hazards with a motion that shows everything, and one seed of healthy scanning."""
    healthy = planned(tuple(PROGRAMS), TISSUES, 1, _NOISES_MM, [Hazard()], asked=WITHOUT_OFFSETS)
    creeping = [one for one in short_hazards() if one.manner is Manner.CREEPING]
    others = [one for one in short_hazards() if one.manner is not Manner.CREEPING]
    return [
        *planned(("gesture",), ("still",), seeds, _NOISES_MM, others, _SHORT_S),
        *planned(("gesture",), ("still",), seeds, _NOISES_MM, creeping, _SHORT_S + CREEP_S),
        *healthy,
    ]


def full_plan(seeds: int) -> list[Conditions]:
    """Returns each standard hazard with motions of every kind, and a thousand hours of healthy scanning."""
    sick = [one for one in STANDARD if one.kind != "none"]
    healthy = planned(tuple(PROGRAMS), TISSUES, seeds, _NOISES_MM, [Hazard()], asked=WITHOUT_OFFSETS, draws=_FULL_DRAWS)
    return planned(_FULL_SESSIONS, TISSUES, seeds, _NOISES_MM, sick, 60.0, asked=WITHOUT_OFFSETS) + healthy


PLANS = {
    "coverage": (coverage_plan, 1),
    "worlds": (worlds_plan, 2),
    "points": (points_plan, 4),
    "short": (short_plan, 2),
    "full": (full_plan, _FULL_SEEDS),
}
"""Name → runs for a number of seeds, and the usual number."""


@click.command()
@click.argument("plan", type=click.Choice(list(PLANS)), required=False)
@click.option(
    "--table", type=click.Path(path_type=Path, exists=True, dir_okay=False), help="rows of a study to write from"
)
@click.option("--seeds", type=click.IntRange(1, 10_000), help="instead of the plan's")
@click.option(
    "--jobs", default=os.cpu_count() or 1, show_default=True, type=click.IntRange(1, 512), help="processes here"
)
@click.option("--scheduler", help="an existing Dask cluster instead: tcp://HOST:PORT")
@click.option("--motions", type=click.Path(path_type=Path, file_okay=False), help="keep rendered sessions here")
def main(
    plan: str | None, table: Path | None, seeds: int | None, jobs: int, scheduler: str | None, motions: Path | None
) -> None:
    """Measure, and write the pages on it. What is done is not done again while the code is the same."""
    if (plan is None) == (table is None):
        raise click.UsageError("give a PLAN or a --table")
    if table is not None:
        rows = study_rows(table, {*KEYS, "commit"} - {"profile"})
        write([row for row in rows if row.get("profile", "coarse") == "coarse"])
    elif plan is not None:
        runs, usual = PLANS[plan]
        write(measured(runs(seeds or usual), jobs, scheduler, motions))


def measured(runs: Sequence[Conditions], jobs: int, scheduler: str | None, motions: Path | None) -> list[Row]:
    """Returns the rows of these runs and of all others that are done already. Raises ConfigurationError and
    DeviceLost.
    """
    folder = RESULTS / code_digest()
    folder.mkdir(parents=True, exist_ok=True)
    study = StudyTable(folder / "study.csv", KEYS)
    left = list(tasks(runs, study.done, None if motions is None else motions.absolute()))
    with progress_bar("run {task.completed:.0f} of {task.total:.0f}") as progress:
        bar = progress.add_task("evidence", total=sum(len(task.runs) for task in left))
        for rows in results(Task.rows, left, jobs, scheduler):
            study.add(rows)
            progress.advance(bar, len(rows))
    return study.rows


def write(rows: Sequence[Row]) -> None:
    """Writes the figures of these rows and the pages; figures that the rows do not cover stay as they were measured."""
    before = read_figures() if DATA.exists() else Figures([], [])
    now = before.updated(figures(rows))
    DATA.write_text(json.dumps(now.plain(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    for path, text in pages(now).items():
        path.write_text(text, encoding="utf-8")
        click.echo(f"written: {path}")


if __name__ == "__main__":
    main()
