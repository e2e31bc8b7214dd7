"""Simulated trackers as processes, and pose files for them whose every pose is known."""

import csv
import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from probewatch.drivers.samples import Matrix4
from probewatch.tools.simulators.run_with_parent import with_parent

TETHER = with_parent()
"""Gives a simulator the priority of a simulated cart's devices: a cart in a test beside it would otherwise keep it from
answering for longer than the 0.2 s that public clients allow."""
PROBEWATCH = [sys.executable, "-c", "from probewatch.tools.cli import main; main()"]

Place = Callable[[float], tuple[NDArray[np.float64], NDArray[np.float64]]]
"""Seconds → (quaternion, scalar first; position in mm)."""


def probe_place(t_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A hand that goes to and fro; positions on the grid of TX, 0.01 mm."""
    position = np.round([40 * np.sin(0.7 * t_s), 25 * np.cos(0.4 * t_s), -1500 + 10 * np.sin(0.2 * t_s)], 2)
    x, y, z, w = Rotation.from_rotvec([0.3 * np.sin(0.5 * t_s), 0.4, 0.2 * np.cos(0.3 * t_s)]).as_quat()
    return np.array([w, x, y, z]), position


def reference_place(t_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A tool that lies still."""
    return np.array([0.5, 0.5, -0.5, 0.5]), np.array([-120.25, 64.5, -1700.75])


def matrix_of(place: tuple[NDArray[np.float64], NDArray[np.float64]]) -> Matrix4:
    """(4, 4) tool → tracker."""
    (w, x, y, z), position = place
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat([x, y, z, w]).as_matrix()
    matrix[:3, 3] = position
    return matrix


def write_poses(path: Path, times_s: Sequence[float], **places: Place) -> Path:
    """A pose file with the given tools at the given times."""
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["t_s", "tool", "q0", "qx", "qy", "qz", "x_mm", "y_mm", "z_mm"])
        for tool, place in places.items():
            for t_s in times_s:
                q, position = place(t_s)
                writer.writerow([repr(float(t_s)), tool, *map(repr, q.tolist()), *map(repr, position.tolist())])
    return path


@dataclass
class Simulated:
    """A running simulator. control: write a JSON list of faults here."""

    url: str
    control: Path
    process: subprocess.Popen[str]

    def faults(self, *names: str) -> None:
        """Exactly these faults are on from the next look of the simulator on."""
        fresh = self.control.with_suffix(".new")
        fresh.write_text(json.dumps(names))
        fresh.replace(self.control)


@contextmanager
def simulated_ndi(folder: Path, *arguments: str) -> Iterator[Simulated]:
    """`probewatch simulate ndi` with these arguments and a control file; stopped politely at the end."""
    control = folder / "faults.json"
    command = [*TETHER, *PROBEWATCH, "simulate", "ndi", "--control", str(control), *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield Simulated(json.loads(process.stdout.readline())["url"], control, process)
            process.terminate()
            assert process.wait(5) == 0
        finally:
            process.kill()
