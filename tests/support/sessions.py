"""Sessions of the simulated world as a stream of samples in time order, without devices and without waiting."""

from collections.abc import Iterator
from functools import cache
from hashlib import sha256

from probewatch.appliance.limits import Limits, RequiredAges
from probewatch.drivers.samples import Frame, GreyImage, Matrix4, Pose, PoseStatus, Sample, Stamp
from probewatch.drivers.twins.faults import Schedule, frozen_image, pose_time_s, spoil_pose
from probewatch.drivers.twins.scene.sight import Sight
from probewatch.drivers.twins.scene.world import World, WorldSettings
from tests.support.kept_pictures import folder_of, picture

ORIGIN_NS = 5_000_000_000
SWEPT = Limits(
    required_age_s=RequiredAges.model_validate({f"offset-{axis}": 0.0 for axis in ("lateral", "axial", "elevational")})
)
"""Asks for what an ordinary sweep shows, as a configuration may: for tests that are of something else."""


class KeptWorld(World):
    """Renders each picture once, for all tests of all processes: two thirds of what a session costs are its pictures.

    Faults and drawings come on top of what is kept, so that sessions with different faults share it too.
    """

    def __init__(self, seed: int, program: str, scene: str, settings: WorldSettings) -> None:
        super().__init__(seed, program, scene, settings)
        self._folder = folder_of(f"{seed} {program} {scene} {settings}")
        self._kept: dict[str, GreyImage] = {}

    def plain_at(self, picture_pose: Matrix4, index: int, sight: Sight | None = None) -> GreyImage:
        """Of rigid tissue; what is seen otherwise is rendered anew each time."""
        if sight is not None:
            return super().plain_at(picture_pose, index, sight)
        name = sha256(picture_pose.tobytes() + str(index).encode()).hexdigest()[:24]
        if name not in self._kept:
            size_px = self.settings.width_px, self.settings.height_px
            self._kept[name] = picture(self._folder / name, size_px, lambda: World.plain_at(self, picture_pose, index))
        return self._kept[name]


@cache
def kept(seed: int, program: str = "sweep", scene: str = "tissue", *, settings: WorldSettings) -> KeptWorld:
    """The one world of this seed, program, scene and settings in this process."""
    return KeptWorld(seed, program, scene, settings)


def session(
    world: World, duration_s: float, schedule: Schedule | None = None, fps: float = 30.0, pose_hz: float = 60.0
) -> Iterator[Sample]:
    """Frames and poses of `duration_s`, poses half a period off the frames; faults are applied on the way."""
    plan = schedule or Schedule.parse("[]")
    frame_times = [(k / fps, "frame", k) for k in range(round(duration_s * fps))]
    pose_times = [((k + 0.5) / pose_hz, "pose", k) for k in range(round(duration_s * pose_hz))]
    image = None
    for t_s, kind, index in sorted(frame_times + pose_times):
        active = plan.active(t_s)
        stamp = Stamp(ORIGIN_NS + round(t_s * 1e9), 100_000)
        if kind == "pose":
            measured = world.measured_pose(pose_time_s(t_s, active), index)
            yield Pose(stamp, index, spoil_pose(measured, active), 0.1, PoseStatus.OK)
        else:
            if image is None or not active & {"freeze-video", "user-freeze"}:
                image = world.frame(t_s, index, active)
            yield Frame(stamp, index, frozen_image(image) if "user-freeze" in active else image)
