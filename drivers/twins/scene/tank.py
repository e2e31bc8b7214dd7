"""Models a probe that is taken to a cross-wire in a water tank and back, while the simulated cart runs."""

from collections.abc import Collection
from pathlib import Path

from probewatch.drivers.samples import GreyImage, Matrix4
from probewatch.drivers.twins.scene.world import World, WorldSettings

_LOOK_EVERY_S = 0.05
"""World seconds between two checks of the file, as in drivers.twins.fault_control."""


class PlaceOfWork:
    """Shows a World over tissue; over a cross-wire, tilted by a free hand, while `tank` exists. Otherwise it acts as
    World.
    """

    def __init__(self, tissue: World, tank: Path | None) -> None:
        self._tissue, self._tank = tissue, tank
        self._wires = World(tissue.seed, "freehand", "cross-wire", tissue.settings)
        self._look_s = -1.0
        self._over_tank = False

    @property
    def settings(self) -> WorldSettings:
        return self._tissue.settings

    def frame(self, t_s: float, index: int, active: Collection[str] = ()) -> GreyImage:
        """Returns a picture of the present place; see World.frame."""
        return self._here(t_s).frame(t_s, index, active)

    def measured_pose(self, t_s: float, index: int) -> Matrix4:
        """Returns the pose at the present place; see World.measured_pose."""
        return self._here(t_s).measured_pose(t_s, index)

    def _here(self, t_s: float) -> World:
        if self._tank is not None and not self._look_s <= t_s < self._look_s + _LOOK_EVERY_S:
            self._look_s, self._over_tank = t_s, self._tank.exists()
        return self._wires if self._over_tank else self._tissue
