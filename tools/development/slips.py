"""Measures how often slips of the marker body are seen, by session and duration, and how often one is seen that is
none.

`python -m probewatch.tools.development.slips` writes docs/slips.json, which docs/evidence.md shows. The pictures of a
session are registered once, without a slip, and that is kept in results/slips. The poses of the tracker, with new noise
and a slip at a random time, are played against it. A slip changes no picture, only when the registration takes another
keyframe.
"""

import json
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from probewatch.appliance.core.detectors.detector import Detector
from probewatch.appliance.core.detectors.marker_slip import MarkerSlip
from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.core.detectors.slow_slip import SLIPS_S, SlowSlip
from probewatch.appliance.core.line import Line
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Check, Fault, VerdictKind
from probewatch.drivers.rigid import Array, interpolate, rigid, rotation_from_vector
from probewatch.drivers.samples import Matrix4, Pose, PoseStatus, Stamp
from probewatch.tools.development.markdown import table
from probewatch.tools.study.hazard import FAULTS
from probewatch.tools.study.plan import tracker_of
from probewatch.tools.study.samples import POSE_HZ, Conditions, rendered, samples, seconds, stamp_ns
from probewatch.tools.study.session import Session
from probewatch.tools.study.summary import Share

ROOT = Path(__file__).parents[2]
FIGURES, KEPT = ROOT / "docs" / "slips.json", ROOT / "results" / "slips"
SESSIONS: tuple[tuple[str, str], ...] = (
    ("hold", "still"),
    ("in-plane", "still"),
    ("in-plane", "breathing"),
    ("gesture", "still"),
    ("elevational-5", "still"),
    ("elevational-10", "still"),
    ("elevational-20", "still"),
)
QUIET: tuple[tuple[str, str], ...] = (*SESSIONS, ("mixed", "still"))
"""Sessions in which it must see nothing; slips are not searched for where the probe is lifted now and then."""
SIZES: Mapping[str, tuple[float, ...]] = {"bend": (3.5, 6.0), "slide": (5.0, 10.0)}
"""deg and mm: a little beyond the limit that is set when nothing is configured, and twice the limit and more."""
AXES = ("lateral", "axial", "elevational")
LASTING_S: Mapping[float, int] = {0.0: 60, 0.5: 18, 5.0: 6}
"""Duration of a slip, s (between two readings, and over as long as each of SlowSlip's two sums) → number of slips of
which each share is made: each axis and sign as often. The slower ones are played for longer and name nothing, so there
are fewer of them. 60 of 60 are more than 94 % (95 %); more narrow it by the root, and take as much longer."""
SOON_S = 0.2
"""Seconds after a slip is complete by when it must be named, as tests/appliance/core/detectors/test_marker_slip.py
asks. Longer would count what the solver finds."""
_LENGTH_S = 60.0
"""Seconds of each session, in which its hand has made all its motions several times. Longer takes proportionally longer
to register."""
_BEFORE_S: Mapping[float, float] = {0.0: 2.0, 0.5: 5.0, 5.0: 30.0}
"""Seconds before a slip of each duration, in which what is usual is learned: SlowSlip takes 20 times as long as its
sum, of which a session of a minute has room for 30 s. Less finds less."""
_DRAWS = 4
"""Noises of the tracker on each session in which nothing slips: half an hour in all. More bounds the false alarms more
tightly, but the pictures are the same ones. Not measured."""
_NO_IMAGE = np.zeros((1, 1), np.uint8)


@dataclass(frozen=True)
class Slip:
    """Represents a slip. kind: one of FAULTS for a marker body. size: deg or mm. Times are s."""

    kind: str
    size: float
    from_s: float
    lasting_s: float

    def at(self, t_s: Array) -> Array:
        """Returns the change, (n, 6) rad and mm."""
        way, axis = self.kind.split("-")
        done = (t_s - self.from_s) / self.lasting_s if self.lasting_s else (t_s >= self.from_s).astype(float)
        change = np.zeros((t_s.size, 6))
        row = AXES.index(axis) + (0 if way == "bend" else 3)
        change[:, row] = np.clip(done, 0, 1) * (np.deg2rad(self.size) if way == "bend" else self.size)
        return change


@dataclass(frozen=True)
class Seen:
    """Holds the counts of one session, way, size and duration, over all axes and both signs: slips tried, named as what
    they are and otherwise within SOON_S, and doubted without a name.
    """

    session: str
    tissue: str
    way: str
    size: float
    lasting_s: float
    tried: int
    named: int
    misnamed: int
    doubted: int


@dataclass(frozen=True)
class Quiet:
    """Holds the counts of one session without a slip: hours played, faults named, doubts."""

    session: str
    tissue: str
    hours: float
    faults: int
    doubts: int


class Look(NamedTuple):
    """Represents what is reported of one picture. doubted: whether what was shown no longer counts."""

    t_s: float
    doubted: bool
    fault: Fault | None


class _Keeper(Detector):
    """Keeps what the line makes of each picture: (3,) moved and likeness, NaN where it was not followed."""

    def __init__(self) -> None:
        self.rows: list[Array] = []

    def see(self, seen: Observation) -> bool:
        moved = np.full(3, np.nan) if seen.moved is None else seen.moved
        self.rows.append(np.r_[seen.t_ns / 1e9, moved, seen.likeness])
        return False

    def checks(self) -> tuple[Check, ...]:
        return ()


class _Registering(Line):
    """Runs the line without the solver, whose findings no slip watch asks for."""

    def _solve(self, t_ns: int, every_ns: int) -> None:
        pass


def registered(session: Session) -> list[Observation]:
    """Returns what the slip watches see of each picture but for its pose."""
    path = KEPT / f"{session.title}.npy"
    if not path.exists():
        line, keeper = _Registering(session.reference, Limits()), _Keeper()
        line._detectors += (keeper,)
        for sample in samples(Conditions(session), rendered(session, None)):
            line.step(sample)
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, np.array(keeper.rows))
    return [
        Observation(
            round(t_s * 1e9), _NO_IMAGE, False, moved=None if np.isnan(x) else np.array([x, y, turn]), likeness=r
        )
        for t_s, x, y, turn, r in np.load(path)
    ]


def _known(moved: Array) -> Array | None:
    return None if np.isnan(moved).any() else moved


class Replay:
    """Replays a session whose pictures were registered once."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self._seen = registered(session)

    def run(self, from_s: float, to_s: float, slip: Slip | None, seed: int) -> Iterator[Look]:
        """Yields what is reported of each picture."""
        poses = deque(self._poses(from_s, to_s, slip, seed))
        limits, reference = Limits(), self.session.reference
        watch = MarkerSlip(limits, reference)
        slow = [SlowSlip(limits, reference, over_s) for over_s in SLIPS_S]
        before = after = poses[0]
        for seen in self._seen:
            if not from_s <= seconds(seen.t_ns) < to_s:
                continue
            while poses and after.stamp.t_ns < seen.t_ns:
                before, after = after, poses.popleft()
                watch.pose(after)
            whole = replace(seen, pose=_between(before, after))
            doubted = [one.see(whole) for one in (watch, *slow)]
            failed = next((one.fault for one in watch.checks() if one.verdict is VerdictKind.FAULT), None)
            yield Look(seconds(seen.t_ns), any(doubted), failed)

    def _poses(self, from_s: float, to_s: float, slip: Slip | None, seed: int) -> Iterator[Pose]:
        t_s = np.arange(round(from_s * POSE_HZ), round(to_s * POSE_HZ)) / POSE_HZ + 0.5 / POSE_HZ
        reference, tracker = self.session.reference, tracker_of(0.1)
        slips = np.zeros((t_s.size, 6)) if slip is None else slip.at(t_s)
        body = rigid(rotation_from_vector(slips[:, :3]) @ reference.rotation, reference.offset_mm + slips[:, 3:])
        random = np.random.default_rng((seed, 67))
        turn = rotation_from_vector(np.deg2rad(tracker.noise_deg) * random.standard_normal((t_s.size, 3)))
        poses = self.session.sensor(t_s, body) @ rigid(turn, np.zeros((t_s.size, 3)))
        poses[:, :3, 3] += tracker.noise_mm * random.standard_normal((t_s.size, 3))
        for k, (time_s, matrix) in enumerate(zip(t_s, poses, strict=True)):
            yield Pose(Stamp(stamp_ns(time_s), 100_000), k, matrix, 0.1, PoseStatus.OK)


def _between(first: Pose, second: Pose) -> Matrix4:
    assert first.matrix is not None
    assert second.matrix is not None
    return np.asarray(interpolate(first.matrix, second.matrix, 0.5))


def tried(replay: Replay, way: str, size: float, lasting_s: float) -> Seen:
    """Tries slips at random times, axis after axis, of either sign."""
    random = np.random.default_rng(int(10 * (size + lasting_s)))
    named = misnamed = doubted = 0
    for seed in range(LASTING_S[lasting_s]):
        slip = Slip(
            f"{way}-{AXES[seed % 3]}",
            float(random.choice([-1, 1])) * size,
            random.uniform(_BEFORE_S[lasting_s] + 1, _LENGTH_S - 1 - lasting_s),
            lasting_s,
        )
        told, doubt = None, False
        for t_s, doubts, fault in replay.run(
            slip.from_s - _BEFORE_S[lasting_s], slip.from_s + lasting_s + SOON_S, slip, seed
        ):
            doubt |= doubts and t_s >= slip.from_s
            told = told or (fault if t_s >= slip.from_s else None)
        named += told is FAULTS[slip.kind]
        misnamed += told is not None and told is not FAULTS[slip.kind]
        doubted += doubt and told is None
    session = replay.session
    return Seen(session.name, session.tissue, way, size, lasting_s, LASTING_S[lasting_s], named, misnamed, doubted)


def quiet(replay: Replay) -> Quiet:
    """Counts false alarms of a session without a slip, under several noises of the tracker."""
    session, faults, doubts = replay.session, 0, 0
    for seed in range(_DRAWS):
        told = list(replay.run(0.0, session.duration_s, None, seed))
        faults += any(fault for _, _, fault in told)
        doubts += sum(doubted for _, doubted, _ in told)
    return Quiet(session.name, session.tissue, _DRAWS * session.duration_s / 3600, faults, doubts)


def slip_page() -> list[str]:
    """Returns lines of Markdown on all slips, sessions together; none where nothing was measured."""
    if not FIGURES.exists():
        return []
    figures = json.loads(FIGURES.read_text(encoding="utf-8"))
    seen = [Seen(**one) for one in figures["seen"]]
    without = [Quiet(**one) for one in figures["quiet"]]
    sessions = ", ".join(dict.fromkeys(one.session for one in seen))
    head = _HEAD.format(soon=SOON_S, sessions=sessions).splitlines()
    return [*head, "", *table(_COLUMNS, _rows(seen)), _quietly(without), ""]


_HEAD = """## Slips of the marker body in view

The slip watches alone (`python -m probewatch.tools.development.slips`): slips about or along each axis, either sign, at
random times of one minute of each session ({sessions}; seed 1, 0.1 mm, 60 poses a second). *Named*: the right FAULT
within {soon:g} s after the slip was complete. *Withdrawn*: nothing is named, but everything must be shown again. Slower
slips are not named, since moving tissue looks the same; slips out of the plane are not seen."""
_COLUMNS = ("slip, tissue", *("one reading" if one == 0 else f"over {one:g} s" for one in LASTING_S))


def _rows(seen: list[Seen]) -> Iterator[tuple[str, ...]]:
    """Yields a row of each size and tissue: for each duration, how many of how many were named, named otherwise,
    withdrawn.
    """
    for way, size, tissue in dict.fromkeys((one.way, one.size, one.tissue) for one in seen):
        same = [one for one in seen if (one.way, one.size, one.tissue) == (way, size, tissue)]
        cells = (_cell([one for one in same if one.lasting_s == lasting_s]) for lasting_s in LASTING_S)
        yield f"{way} {size:g}{'°' if way == 'bend' else ' mm'}, {tissue}", *cells


def _cell(same: list[Seen]) -> str:
    """Returns the cell of all sessions together."""
    tried, named = sum(one.tried for one in same), sum(one.named for one in same)
    misnamed, doubted = sum(one.misnamed for one in same), sum(one.doubted for one in same)
    if not tried:
        return "–"
    told = [f"{Share(named, tried).brief} named"] if named else []
    told += [f"{k}/{tried} {what}" for k, what in ((misnamed, "named otherwise"), (doubted, "withdrawn")) if k]
    return "; ".join(told) or f"nothing of {tried}"


def _quietly(without: list[Quiet]) -> str:
    """Returns one sentence on the sessions in which nothing slipped."""
    hours = sum(one.hours for one in without)
    faults, doubts = sum(one.faults for one in without), sum(one.doubts for one in without)
    return f"Without a slip: {faults} FAULTs and {doubts} withdrawals in {hours:.2f} h of these sessions."


def main() -> None:
    """Measures every session and writes the figures down after each, so that what was measured is not lost."""
    seen, without = list[Seen](), list[Quiet]()
    for name, tissue in QUIET:
        replay = Replay(Session(name, tissue, 1, _LENGTH_S))
        without.append(quiet(replay))
        if (name, tissue) in SESSIONS:
            seen += [
                tried(replay, way, size, lasting_s)
                for way, sizes in SIZES.items()
                for size in sizes
                for lasting_s in LASTING_S
            ]
        figures = {"seen": [asdict(one) for one in seen], "quiet": [asdict(one) for one in without]}
        FIGURES.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
        print(f"{name}, {tissue}: done", flush=True)


if __name__ == "__main__":
    main()
