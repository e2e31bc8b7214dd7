"""Measures how often healthy scanning raises a sign, a choice or a named fault, and how near the sequential test comes
to one.

`python -m probewatch.tools.development.false_alarms` writes docs/false-alarms.json, which docs/evidence.md shows. There
are paths without pictures: the session's own path with the errors of a registration goes straight into `Evidence`, at
the cadence of the line, and its verdicts to the supervisor. What needs pictures, such as the slip watches, is left out.
"""

import json
import os
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from itertools import product
from math import sqrt
from pathlib import Path

import click
import numpy as np

from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.evidence import Evidence
from probewatch.appliance.core.quality.judgement import judge
from probewatch.appliance.core.quality.solution_schedule import solve_every_ns
from probewatch.appliance.limits import Limits
from probewatch.appliance.supervision.supervisor import TICK_NS, Durations, Inputs, Supervisor
from probewatch.appliance.types import Fault, Motion, MotionKind, State, VerdictKind
from probewatch.drivers.rigid import Array, rigid, rotation_from_vector
from probewatch.drivers.samples import Stamp
from probewatch.tools.development.false_alarm_pages import FIGURES
from probewatch.tools.shared.interruption import said_when_interrupted
from probewatch.tools.shared.terminal import progress_bar
from probewatch.tools.study.hand import PROGRAMS
from probewatch.tools.study.plan import tracker_of
from probewatch.tools.study.samples import POSE_HZ, frame_times, stamp_ns
from probewatch.tools.study.session import FPS, TISSUES, Session, picture_path
from probewatch.tools.study.summary import Row
from probewatch.tools.study.table import COMMIT, StudyTable, code_digest
from probewatch.tools.study.workers import results

KEPT = Path("results/false-alarms")
KEYS = ("session", "tissue", "noise", "seed", "duration_s")
NOISES = ("gaussian", "t5", "ar1")
"""Noises of the tracker, all with the standard deviations of `tracker_of`: white; Student's with five degrees of
freedom; and one that is correlated from reading to reading."""
_COUNTS = ("signs", "withdrawn", "choices", "faults", "warnings", "halts")
LENGTH_S = 180.0
"""Seconds of each session: two minutes after what it takes to be verified first. Longer shows more of a long
examination, and less of different hands."""
_ALIKE = 0.9
"""Correlation of one reading, at 60 Hz, with the next: a filter of 160 ms in the tracker. Not measured on one."""
_PICTURE_PX, _WALK_MM, _WALK_DEG = 0.02, 0.01, 0.02
"""Error of one registered picture, and of its chain per √s, as measured on rendered pictures
(tests/support/motions.py)."""
BLOCK_S = 30.0
"""Seconds of a block whose largest log likelihood ratio is kept: three windows of the test, so that neighbours share
little motion."""


@dataclass(frozen=True)
class Quiet:
    """Represents one session in which nothing is wrong."""

    session: Session
    noise: str

    @property
    def key(self) -> tuple[str, ...]:
        """Returns the value of each of KEYS."""
        one = self.session
        return one.name, one.tissue, self.noise, str(one.seed), f"{one.duration_s:g}"

    def rows(self) -> list[Row]:
        """Plays it and returns its row."""
        return [dict(zip(KEYS, self.key, strict=True)) | Played(self).row()]


class Played:
    """Plays one session and counts.

    signs: how often something came to speak against the calibration, or for a distorted field; withdrawn: how many of
    those while it was OK. choices, faults: how often `undecided`, and a FAULT of any other name, began. peaks, bent:
    those of each block, of the sequential test and of a distorted field, where they are not 0. Beside them, how often
    the supervisor warned and halted.
    """

    def __init__(self, quiet: Quiet) -> None:
        self._session = quiet.session
        self._evidence = Evidence(quiet.session.reference, Limits(), PathWindow(quiet.session.reference))
        self._supervisor, self._state, self._tick_ns = Supervisor(Durations()), State.SELF_TEST, stamp_ns(0.0)
        self._before: tuple[bool, Fault | None, VerdictKind] = (False, None, VerdictKind.NOT_VERIFIED)
        self._counts = dict.fromkeys(_COUNTS, 0)
        self._names: list[str] = []
        self._peaks, self._bent = np.zeros((2, int(np.ceil(quiet.session.duration_s / BLOCK_S))))
        self._ok_ns = 0
        self._play(quiet.noise)

    def row(self) -> Row:
        """Returns the cells of the table."""
        counts = {name: str(value) for name, value in self._counts.items()}
        peaks, bent = (" ".join(f"{peak:.2f}" for peak in kind if peak > 0) for kind in (self._peaks, self._bent))
        ok_s = f"{self._ok_ns / 1e9:.1f}"
        return counts | {"ok_s": ok_s, "names": " ".join(self._names), "peaks": peaks, "bent": bent}

    def _play(self, noise: str) -> None:
        session, evidence = self._session, self._evidence
        frames_s = frame_times(session)
        poses_s: Array = np.asarray((np.arange(round((session.duration_s + 1) * POSE_HZ)) + 0.5) / POSE_HZ)
        poses, fed = _poses(session, noise, poses_s), 0
        motions = _motions(session, frames_s)
        solve_ns, last_ns = 0, stamp_ns(0.0)
        blind = False
        for t_s, motion in zip(frames_s, motions, strict=True):
            now_ns = stamp_ns(float(t_s))
            while poses_s[fed] <= t_s + 1 / POSE_HZ:
                evidence.window.poses.add(stamp_ns(float(poses_s[fed])), poses[fed])
                fed += 1
            if motion is not None:
                evidence.window.add(motion)
            elif not blind:
                evidence.lose_sight()
            blind = motion is None
            if now_ns - solve_ns >= solve_every_ns(evidence.window.span_ns, not blind):
                solve_ns = now_ns
                evidence.solve(now_ns)
            self._take(now_ns, now_ns - last_ns, float(t_s))
            last_ns = now_ns

    def _take(self, now_ns: int, since_ns: int, t_s: float) -> None:
        evidence, counts = self._evidence, self._counts
        block = int(t_s // BLOCK_S)
        self._peaks[block] = max(self._peaks[block], evidence.nats or 0.0)
        self._bent[block] = max(self._bent[block], evidence.distortion.nats or 0.0)
        verdict = judge(now_ns, evidence.checks(), evidence.status)
        self._ok_ns += since_ns * (verdict.kind is VerdictKind.OK)
        signed, fault, kind = self._before
        now = bool(evidence.status.contradictions), verdict.fault, verdict.kind
        if now[0] and not signed:
            counts["signs"] += 1
            counts["withdrawn"] += kind is VerdictKind.OK
        if verdict.fault is not None and verdict.fault is not fault:
            counts["choices" if verdict.fault is Fault.UNDECIDED else "faults"] += 1
            self._names.append(verdict.fault)
        self._before = now
        while self._tick_ns <= now_ns:
            state = self._supervisor.step(self._tick_ns, Inputs((verdict,), ())).state
            counts["warnings"] += state is State.WARNING and self._state is not State.WARNING
            counts["halts"] += state is State.HALT and self._state is not State.HALT
            self._state, self._tick_ns = state, self._tick_ns + TICK_NS


def _motions(session: Session, t_s: Array) -> Iterator[Motion | None]:
    """Yields the motion of each picture; None while the probe is off the skin. Each touch begins a chain."""
    random = np.random.default_rng((session.seed, 67))
    reference, touches = session.reference, session.touches(t_s)
    signs_mm = np.array(reference.polarity) * reference.scale_mm_per_px
    chain, index = 0, 0
    while index < t_s.size:
        if not touches[index]:
            yield None
            index += 1
            continue
        off = np.flatnonzero(~touches[index:])
        end = index + int(off[0]) if off.size else t_s.size
        chain += 1
        path, turn = picture_path(session.pictures(t_s[index:end]))
        # As the registration reports it: the tissue's displacement in the axes of the latest picture.
        moved = -np.exp(1j * turn) * path
        step = 1 / sqrt(FPS)
        path_mm = np.stack([moved.real, moved.imag], axis=1)
        path_mm += np.cumsum(_WALK_MM * step * random.standard_normal(path_mm.shape), axis=0)
        turn = turn + np.cumsum(np.deg2rad(_WALK_DEG) * step * random.standard_normal(turn.shape))
        path_px = path_mm / signs_mm + _PICTURE_PX * random.standard_normal(path_mm.shape)
        turn = turn * np.prod(reference.polarity)
        for k in range(end - index):
            stamp = Stamp(stamp_ns(float(t_s[index + k])), 100_000)
            yield Motion(
                stamp, index + k, index, MotionKind.PLANAR, np.zeros(2), 0.0, np.eye(3) * 1e-4, 0.95, chain,
                path_px[k], float(turn[k]), True,
            )  # fmt: skip
        index = end


def _poses(session: Session, noise: str, t_s: Array) -> Array:
    """Returns the poses, (n, 4, 4), as the tracker reports them."""
    random = np.random.default_rng((session.seed, 61, NOISES.index(noise)))
    tracker = tracker_of(0.1)
    rows = tracker_noise(noise, t_s.size, random)
    body = rigid(session.reference.rotation, session.reference.offset_mm)
    turn = rotation_from_vector(np.deg2rad(tracker.noise_deg) * rows[:, :3])
    poses = session.sensor(t_s, body) @ rigid(turn, np.zeros((t_s.size, 3)))
    poses[:, :3, 3] += tracker.noise_mm * rows[:, 3:]
    return np.asarray(poses)


def tracker_noise(kind: str, n: int, random: np.random.Generator) -> Array:
    """Returns noise, (n, 6), of standard deviation 1."""
    if kind == "t5":
        return np.asarray(random.standard_t(5, (n, 6)) / sqrt(5 / 3))
    rows = random.standard_normal((n, 6))
    if kind == "ar1":
        fresh = sqrt(1 - _ALIKE**2)
        for k in range(1, n):
            rows[k] = _ALIKE * rows[k - 1] + fresh * rows[k]
    return np.asarray(rows)


def planned(seeds: int) -> list[Quiet]:
    """Returns every session in every tissue under every noise, the first seed of all first."""
    return [Quiet(_session(name, tissue, seed), noise) for seed, name, tissue, noise in _mixture(seeds)]


def _mixture(seeds: int) -> Iterator[tuple[int, str, str, str]]:
    yield from product(range(1, seeds + 1), [f"gesture-{name}" for name in PROGRAMS], TISSUES, NOISES)


def _session(name: str, tissue: str, seed: int) -> Session:
    """Returns a session with a seed that no other measurement uses."""
    return Session(name, tissue, 5000 + seed, LENGTH_S)


_HOURS = {"hours": "duration_s", "ok_h": "ok_s"}
"""Figure → column of s."""


def _total(rows: list[Row]) -> dict[str, float]:
    """Returns the total of all rows of one kind."""
    hours = {name: round(sum(float(row[column]) for row in rows) / 3600, 3) for name, column in _HOURS.items()}
    return {"rows": len(rows), **hours, **{name: sum(int(row[name]) for row in rows) for name in _COUNTS}}


def _highest(rows: list[Row], kind: str) -> list[float]:
    """Returns the peaks of all blocks, the highest first."""
    return sorted((float(peak) for row in rows for peak in row[kind].split()), reverse=True)


def written(rows: list[Row]) -> dict[str, object]:
    """Returns what docs/false-alarms.json keeps."""
    kinds: dict[str, list[Row]] = {}
    for row in rows:
        for name in ("everything", row["tissue"], row["noise"], row["session"].removeprefix("gesture-")):
            kinds.setdefault(name, []).append(row)
    names = sorted({name for row in rows for name in row["names"].split()})
    counted = {name: sum(row["names"].split().count(name) for row in rows) for name in names}
    return {
        "commits": sorted({row[COMMIT] for row in rows}),
        "seeds": len({row["seed"] for row in rows}),
        "totals": {name: _total(own) for name, own in kinds.items()},
        "names": counted,
        **{kind: _highest(rows, kind) for kind in ("peaks", "bent")},
    }


@click.command()
@click.option("--seeds", default=4, show_default=True, type=click.IntRange(1, 10_000), help="of each session")
@click.option("--jobs", default=os.cpu_count() or 1, show_default=True, type=click.IntRange(1, 512), help="processes")
@click.option("--most-minutes", default=1e6, show_default="all", help="end after so long; begun again it goes on there")
def main(seeds: int, jobs: int, most_minutes: float) -> None:
    """Play healthy sessions that were not played yet with this state of the code, and write what came of all."""
    folder = KEPT / code_digest()
    folder.mkdir(parents=True, exist_ok=True)
    table = StudyTable(folder / "rows.csv", KEYS)
    left = [quiet for quiet in planned(seeds) if quiet.key not in table.done]
    begun_again = f"what is played is kept in {table.path}, and begun again it goes on there"
    click.echo(f"false alarms: {len(left)} sessions are left to play; {begun_again}")
    done = results(Quiet.rows, left, jobs, None) if jobs > 1 else (quiet.rows() for quiet in left)
    with (
        said_when_interrupted(f"false alarms, --seeds {seeds}; {begun_again}"),
        progress_bar("session {task.completed:.0f} of {task.total:.0f}") as progress,
        closing(done),
    ):
        bar = progress.add_task("sessions", total=len(left))
        for rows in done:
            table.add(rows)
            progress.advance(bar)
            if (progress.tasks[bar].elapsed or 0.0) > 60 * most_minutes:
                break
    FIGURES.write_text(json.dumps(written(table.rows), indent=1) + "\n", encoding="utf-8")
    click.echo(f"written: {FIGURES}")


if __name__ == "__main__":
    main()
