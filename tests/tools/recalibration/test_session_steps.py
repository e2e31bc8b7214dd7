"""The steps of a live recalibration beside the scan: latency first, the check at another point."""

import threading
import tomllib
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from probewatch.appliance.service.control.server import ControlRefused
from probewatch.drivers.errors import ProbewatchError
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Sample, Stamp
from probewatch.tools.recalibration.phase import Phase
from tests.support.polling import until
from tests.tools.recalibration.test_session import CHOSEN, SIGNED, SIZE_PX, Bench, scanned, wires, world


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with ExitStack() as running:
        yield Bench(tmp_path, running)


def bottom(frames: int, late_s: float = 0.07) -> Iterator[Sample]:
    """A probe moved up and down over a flat bottom; the poses are late."""

    def depth_mm(t_s: float) -> float:
        return 4 * (2 / np.pi) * np.arcsin(np.sin(np.pi * t_s))

    rows = np.arange(SIZE_PX[1])[:, None]
    for index in range(frames):
        t_s = index / 20
        line = 200 * np.exp(-(((rows - 120 - depth_mm(t_s) / 0.07) / 4) ** 2))
        image = np.broadcast_to(line, SIZE_PX[::-1]).astype(np.uint8)
        yield Frame(Stamp(round(t_s * 1e9), 40_000), index, image)
        for half in range(3):
            pose_s = t_s + (half + 0.5) / 60
            pose = np.eye(4)
            pose[:3, 3] = 0.0, -depth_mm(pose_s - late_s), 100.0
            yield Pose(Stamp(round(pose_s * 1e9), 40_000), 3 * index + half, pose, 0.1, PoseStatus.OK)


@pytest.mark.thorough
def test_the_latency_is_measured_first_and_the_scan_counts_with_it(bench: Bench) -> None:
    bench.session.begin(replace(CHOSEN, latency=True, water_c=48.0))
    assert bench.session.phase is Phase.LATENCY
    with pytest.raises(ControlRefused, match="does not show how late"):
        bench.session.take_latency(measured=True)
    with pytest.raises(ControlRefused):
        bench.session.finish()
    bench.feed(bottom(160))
    found = until(lambda: (told := bench.fields["latency"]) and told["pictures"] >= 150 and told["latency_ms"] and told)
    assert abs(found["latency_ms"] - 70) < 4 * found["sigma_ms"] + 5
    bench.session.take_latency(measured=True)
    assert (bench.session.phase, bench.fields["latency"]) == (Phase.SCANNING, None)
    with pytest.raises(ControlRefused):
        bench.session.take_latency(measured=False)


def test_a_latency_that_is_not_wanted_is_left_to_the_scan(bench: Bench) -> None:
    bench.session.begin(replace(CHOSEN, latency=True))
    bench.session.take_latency(measured=False)
    assert bench.session.phase is Phase.SCANNING
    bench.session.reject()
    assert bench.service.asked == ["begin-recalibration", "abort-recalibration"]


def elsewhere(first: int, frames: int, shift_mm: float) -> Iterator[Sample]:
    """The tank was moved: the same pictures, the probe at another place of the room."""
    seen = world()
    seen.tissue_to_tracker[:3, 3] += shift_mm
    return scanned(seen, range(first, first + frames))


@pytest.mark.thorough
def test_a_check_at_another_point_closes_the_procedure(bench: Bench) -> None:
    """At the same point it is refused, elsewhere it passes and is on file; what stands beside is told in sigmas."""
    parked, moved = threading.Event(), threading.Event()

    def samples() -> Iterator[Sample]:
        yield from wires(600)
        yield from elsewhere(600, 160, 0.0)
        parked.set()
        moved.wait(60)
        yield from elsewhere(760, 160, 15.0)

    bench.feed(samples())
    bench.session.begin(replace(CHOSEN, water_c=48.0))
    until(lambda: (scan := bench.fields["scan"]) and scan["result"] and not scan["refusals"], 60, 0.1)
    with pytest.raises(ControlRefused):
        bench.session.check()
    bench.session.finish()
    scan = bench.fields["scan"]
    assert "1540 m/s" in scan["sound"]
    in_force = {one["name"]: one["others"]["in force"]["sigmas"] for one in scan["compared"]}
    assert len(in_force) == 8
    assert max(map(abs, in_force.values())) < 4
    for point in ((float("nan"), 0.0, 0.0), (1e6, 0.0, 0.0)):
        with pytest.raises(ControlRefused, match="three numbers"):
            bench.session.check(point)
    bench.session.check()
    until(lambda: "from where the scan was made" in bench.fields["scan"]["check"]["why"], 60, 0.1)
    bench.session.end_check()
    with pytest.raises(ProbewatchError, match="from where the scan was made"):
        bench.session.accept(replace(SIGNED, unchecked=""))
    until(parked.is_set, 60)
    bench.session.check()
    moved.set()
    until(lambda: bench.fields["scan"]["check"]["why"] == "", 60, 0.1, lambda: bench.fields["scan"]["check"])
    bench.session.end_check()
    assert bench.fields["scan"]["check"]["error_mm"] < 0.5
    bench.session.accept(replace(SIGNED, unchecked=""))
    said = tomllib.loads(bench.service.taken.decode())["provenance"]
    assert "views put another point within 0." in said["check"]
    assert "1540 m/s" in said["sound"]
