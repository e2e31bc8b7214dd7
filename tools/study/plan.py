"""Plans the runs of a study: sessions × tissue × seeds, each with every tracker and hazard that was asked for."""

import itertools
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from probewatch.appliance.limits import Profile
from probewatch.tools.study.hand import ALL
from probewatch.tools.study.hazard import Hazard
from probewatch.tools.study.outcome import run
from probewatch.tools.study.samples import DEFAULT, KEYS, Conditions, Tracker, rendered
from probewatch.tools.study.session import Session

_MOST_RUNS = 4
"""Runs in one task: pictures are rendered once for all of them, and what is done is written down after each task."""


@dataclass(frozen=True)
class Task:
    """Holds runs on the same pictures. folder: where pictures are kept, None for nowhere."""

    runs: tuple[Conditions, ...]
    folder: Path | None

    def rows(self) -> list[dict[str, str]]:
        """Runs them, and returns their rows."""
        return [
            dict(zip(KEYS, one.key, strict=True)) | run(one, rendered(one.session, self.folder)).row()
            for one in self.runs
        ]


def planned(
    sessions: Sequence[str],
    tissues: Sequence[str],
    seeds: int,
    noises_mm: Sequence[float],
    hazards: Sequence[Hazard],
    duration_s: float | None = None,
    asked: str = DEFAULT,
    draws: int = 1,
    profiles: Sequence[Profile] = ("coarse",),
) -> list[Conditions]:
    """Returns every run, those on the same pictures side by side; the first seed of everything first.

    duration_s: that of every session instead of its own. asked: one of ASKED. draws: noises of the tracker on the same
    pictures. profiles: those of the limits, on the same pictures.
    """
    return [
        Conditions(
            Session(name, tissue, seed, duration_s or ALL[name][1]), hazard, tracker_of(noise_mm), asked, draw, profile
        )
        for seed, name, tissue in itertools.product(range(1, seeds + 1), sessions, tissues)
        for noise_mm, draw, hazard, profile in itertools.product(noises_mm, range(1, draws + 1), hazards, profiles)
    ]


def tracker_of(noise_mm: float) -> Tracker:
    """Returns the tracker of a noise. Turns are as much less well measured as places: .02° with .1 mm, an optical
    tracker at 1.5 m.
    """
    return Tracker(noise_mm, 0.2 * noise_mm)


def tasks(runs: Sequence[Conditions], done: Collection[tuple[str, ...]], folder: Path | None) -> Iterator[Task]:
    """Yields the tasks that are left to do."""
    left = [one for one in runs if one.key not in done]
    for _, same in itertools.groupby(left, key=lambda one: one.session):
        alike = list(same)
        for first in range(0, len(alike), _MOST_RUNS):
            yield Task(tuple(alike[first : first + _MOST_RUNS]), folder)
