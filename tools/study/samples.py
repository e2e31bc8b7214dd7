"""Yields a session with a hazard as the stream of samples that the line of a cart would be given. It is seeded."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from probewatch.appliance.limits import Limits, Profile, RequiredAges
from probewatch.appliance.supervision.timeline import Judging
from probewatch.appliance.types import PARAMETERS
from probewatch.drivers.recordings.metaimage import read_metaimage
from probewatch.drivers.recordings.metaimage_writing import SequenceItem, write_metaimage
from probewatch.drivers.rigid import Array, rigid, rotation_from_vector
from probewatch.drivers.samples import Frame, GreyImage, Pose, PoseStatus, Sample, Stamp
from probewatch.drivers.twins.faults import blank_image
from probewatch.drivers.twins.scene.processing import ProcessingScanner
from probewatch.tools.study.hazard import Hazard
from probewatch.tools.study.place import erring_by_place
from probewatch.tools.study.session import FPS, Session

POSE_HZ = 60.0
"""Pose rate of a Polaris Vega."""
_ORIGIN_NS = 5_000_000_000
"""Origin of the stamps: anything but zero, which would hide a mixed-up origin."""
_STAMP_ERR_NS = 100_000
"""Nanoseconds: bound of V4L2's and a tracker's stamps, as the drivers bound them on a good cart."""
_FIT_MM = 0.1
"""Millimetres: how well the markers fit, as a tracker reports it for a sound body."""


@dataclass(frozen=True)
class Tracker:
    """Describes a tracker's noise. noise_mm, noise_deg: standard deviation per axis of one reading, white."""

    noise_mm: float = 0.1
    noise_deg: float = 0.02


KEYS = ("session", "tissue", "seed", "duration_s", "noise_mm", "draw", "asked", "profile", "hazard")
"""Columns that name a run."""


def _without_offsets() -> Judging:
    """Returns the limits as shipped, but for the offsets, which an ordinary sweep may lack the motion to show."""
    ages_s = {name: 0.0 for name in PARAMETERS if name.startswith("offset")}
    return Judging(Limits(required_age_s=RequiredAges.model_validate(ages_s)))


DEFAULT, WITHOUT_OFFSETS = "everything", "without-offsets"
ASKED = {DEFAULT: Judging(), WITHOUT_OFFSETS: _without_offsets()}
"""Parameters for which the contact asks: all ten, as the configuration is shipped, or all but the offsets."""


@dataclass(frozen=True)
class Conditions:
    """Describes one run of the study. asked: one of ASKED. profile: that of the limits. draw: number of the tracker's
    noise on these pictures, from 1.
    """

    session: Session
    hazard: Hazard = field(default_factory=Hazard)
    tracker: Tracker = field(default_factory=Tracker)
    asked: str = DEFAULT
    draw: int = 1
    profile: Profile = "coarse"

    @property
    def judging(self) -> Judging:
        """Returns how strictly the run is judged."""
        asked = ASKED[self.asked]
        limits = Limits(profile=self.profile, required_age_s=asked.limits.required_age_s)
        return replace(asked, limits=limits)

    @property
    def key(self) -> tuple[str, ...]:
        """Returns what names the run in the table, one for each of KEYS."""
        session = self.session
        length, noise_mm = f"{session.duration_s:g}", f"{self.tracker.noise_mm:g}"
        draw = str(self.draw)
        judged = self.asked, self.profile
        return session.name, session.tissue, str(session.seed), length, noise_mm, draw, *judged, str(self.hazard)


def samples(conditions: Conditions, pictures: list[GreyImage]) -> Iterator[Sample]:
    """Yields frames and poses in time order. pictures: those of `rendered`."""
    session, hazard = conditions.session, conditions.hazard
    frames_s = frame_times(session)
    poses_s = np.asarray((np.arange(round(session.duration_s * POSE_HZ)) + 0.5) / POSE_HZ)
    hidden = hazard.hides(frames_s)
    poses, unseen = _poses(conditions, poses_s), hazard.hides(poses_s)
    order = sorted([(t, 0, k) for k, t in enumerate(poses_s)] + [(t, 1, k) for k, t in enumerate(frames_s)])
    for t_s, is_frame, k in order:
        stamp = Stamp(_ORIGIN_NS + round(t_s * 1e9), _STAMP_ERR_NS)
        if is_frame:
            image = blank_image(pictures[k].shape, k) if hidden[k] else hazard.shown(pictures[k], t_s)
            yield Frame(stamp, k, image)
        elif unseen[k]:
            yield Pose(stamp, k, None, np.nan, PoseStatus.MISSING, "not seen")
        else:
            yield Pose(stamp, k, poses[k], _FIT_MM, PoseStatus.OK)


def seconds(t_ns: int) -> float:
    """Returns the time of a session to which a stamp of its samples belongs."""
    return (t_ns - _ORIGIN_NS) / 1e9


def stamp_ns(t_s: float) -> int:
    """Returns the stamp of a time of a session, the inverse of `seconds`."""
    return _ORIGIN_NS + round(t_s * 1e9)


def frame_times(session: Session) -> Array:
    """Returns the times of the pictures, (n,) s."""
    return np.asarray(np.arange(round(session.duration_s * FPS)) / FPS)


@lru_cache(maxsize=1)
def rendered(session: Session, folder: Path | None) -> list[GreyImage]:
    """Returns every picture of the session without a hazard, (h, w) uint8. Those in the folder are read from there; a
    session that is not there is rendered and written to it, as a recording that 3D Slicer and `probewatch replay` read.
    """
    path = None if folder is None else folder / f"{session.title}.igs.mha"
    if path is not None and path.exists():
        return list(read_metaimage(path).pictures())
    t_s = frame_times(session)
    pictures = list(_shown(session, t_s))
    if path is not None:
        poses = session.sensor(t_s, session.world.sensor_to_picture)
        items = (
            SequenceItem(stamp_ns(t), image, {"ProbeToTracker": pose}, k)
            for k, (t, image, pose) in enumerate(zip(t_s, pictures, poses, strict=True))
        )
        path.parent.mkdir(parents=True, exist_ok=True)
        write_metaimage(path, items, session.size_px, compressed=False)
    return pictures


def _shown(session: Session, t_s: Array) -> Iterator[GreyImage]:
    """Yields what the grabber passes on at each time."""
    world, processing = session.world, session.world.surroundings.processing
    scanner, picture = ProcessingScanner(processing), None
    seen = zip(session.pictures(t_s), session.sights(t_s), session.touches(t_s), strict=True)
    for k, (pose, sight, touches) in enumerate(seen):
        if not touches:
            scanner.off()
            picture = None
            yield blank_image(session.size_px[::-1], k)
            continue
        if picture is None or k % processing.repeats == 0:
            plain = scanner.processed(world.plain_at(pose, k, sight))
            picture = scanner.grabbed(world.on_screen(plain))
        yield picture


def _poses(conditions: Conditions, t_s: Array) -> Array:
    """Returns the poses, (n, 4, 4), as the tracker reports them."""
    session, hazard, tracker = conditions.session, conditions.hazard, conditions.tracker
    true_s = t_s - hazard.change(t_s)[:, 8]
    random = np.random.default_rng((session.seed, 61, conditions.draw))
    turn = rotation_from_vector(np.deg2rad(tracker.noise_deg) * random.standard_normal((t_s.size, 3)))
    poses = hazard.measured(session.sensor(true_s, hazard.body(session.reference, t_s)), t_s)
    poses = poses @ rigid(turn, np.zeros((t_s.size, 3)))
    poses[:, :3, 3] += tracker.noise_mm * random.standard_normal((t_s.size, 3))
    return hazard.reported(erring_by_place(poses, session.world.surroundings.tracker_mm, session.seed))
