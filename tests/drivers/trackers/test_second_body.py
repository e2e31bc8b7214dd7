"""`witness=` of each tracker against its twin: the second body comes with the first, of one measurement, or not."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from probewatch.drivers.device_api import TrackerSource
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.openigtlink.options import parse_target
from probewatch.drivers.openigtlink.source import open_tracker as open_igtl
from probewatch.drivers.rigid import angle_from_rotation, seen_from
from probewatch.drivers.samples import Matrix4, Pose, PoseStatus, Stamp
from probewatch.drivers.trackers.ndi.options import parse_options as ndi_options
from probewatch.drivers.trackers.ndi.tracker import NdiTracker
from probewatch.drivers.trackers.optotrak.tracker import parse_options as optotrak_options
from probewatch.drivers.trackers.witness import WitnessSight
from probewatch.drivers.twins.faults import BEND_DEG
from probewatch.drivers.twins.ndi.models import AURORA, SPECTRA, VEGA
from probewatch.drivers.twins.ndi.tool_definitions import make_rom
from probewatch.drivers.twins.optotrak.first_principles import Device
from probewatch.drivers.twins.scene.world import World
from probewatch.drivers.twins.tool_motion import WITNESS_MM, world_motion
from tests.support import simulated_igtl, simulated_ndi, simulated_optotrak

Show = Callable[..., None]
MOTION = world_motion(World(2))


@contextmanager
def optotrak(_folder: Path, reference: bool) -> Iterator[tuple[TrackerSource, Show]]:
    options = {"reference": "2"} if reference else {}
    device = Device(MOTION, bodies=3)
    with simulated_optotrak.bench(device=device) as cart, cart.open(witness="3", **options) as tracker:
        yield tracker, cart.show


@contextmanager
def igtl(_folder: Path, reference: bool) -> Iterator[tuple[TrackerSource, Show]]:
    with (
        simulated_igtl.bench() as cart,
        open_igtl(cart.target, {"witness": "Witness", "deadline_ms": "1000"}, cart.clock) as tracker,
    ):
        yield tracker, cart.show


@contextmanager
def ndi(folder: Path, reference: bool, model: Any = SPECTRA, **bench: Any) -> Iterator[tuple[TrackerSource, Show]]:
    (folder / "second.rom").write_bytes(make_rom(second=True))
    with simulated_ndi.bench(folder, model, **bench) as cart:
        cart.twin.device._pose_at = MOTION
        options = {"reference": cart.rom("reference")} if reference else {}
        with cart.open(**{"witness": str(folder / "second.rom")} | options) as tracker:
            yield tracker, cart.faults


def vega(folder: Path, reference: bool) -> Any:
    return ndi(folder, reference, VEGA)


def until(tracker: TrackerSource, wanted: Callable[[Pose], bool], limit: int = 300) -> Pose:
    for _ in range(limit):
        pose = tracker.read(1.0)
        if pose is not None and pose.status is PoseStatus.OK and wanted(pose):
            return pose
    raise AssertionError("no such pose came")


def relative_pose(pose: Pose) -> Matrix4:
    assert pose.matrix is not None
    assert pose.witness is not None
    return seen_from(pose.matrix, pose.witness)


def bent_deg(pose: Pose) -> float:
    return float(np.degrees(angle_from_rotation(relative_pose(pose)[:3, :3])))


KINDS = {"ndi": ndi, "vega": vega, "optotrak": optotrak, "igtl": igtl}


# The OpenIGTLink twin sends no reference: test_tracker.py has a server that does.
CARTS = [(kind, reference) for kind in KINDS for reference in (False, True) if (kind, reference) != ("igtl", True)]


@pytest.mark.parametrize(("kind", "reference"), CARTS)
def test_the_second_body_comes_with_the_first_and_its_bend_shows(kind: str, reference: bool, tmp_path: Path) -> None:
    with KINDS[kind](tmp_path, reference) as (tracker, show):
        healthy = until(tracker, lambda pose: pose.witness is not None)
        assert np.abs(relative_pose(healthy)[:3, 3] - WITNESS_MM).max() < 3.0
        assert bent_deg(healthy) < 2.0
        show("bend-witness")
        bent = until(tracker, lambda pose: pose.witness is not None and bent_deg(pose) > 3.0)
        assert bent_deg(bent) == pytest.approx(BEND_DEG, abs=2.0)
        show("witness-missing")
        hidden = until(tracker, lambda pose: pose.witness is None)
        assert hidden.matrix is not None
        show()
        until(tracker, lambda pose: pose.witness is not None and bent_deg(pose) < 2.0)
        assert any("second on the probe" in tool for tool in tracker.describe().tools) or kind in ("ndi", "vega")


@pytest.mark.parametrize("kind", ["ndi", "optotrak"])
def test_the_bend_of_the_first_shows_against_the_second(kind: str, tmp_path: Path) -> None:
    with KINDS[kind](tmp_path, False) as (tracker, show):
        until(tracker, lambda pose: pose.witness is not None)
        show("bend-marker")
        until(tracker, lambda pose: pose.witness is not None and bent_deg(pose) > 3.0)


def test_without_the_option_there_is_none() -> None:
    with simulated_optotrak.bench(device=Device(MOTION, bodies=3)) as cart, cart.open() as tracker:
        assert until(tracker, lambda pose: True).witness is None


def test_a_wired_sensor_may_be_the_witness(tmp_path: Path) -> None:
    with simulated_ndi.bench(tmp_path, AURORA, wired=("probe", "probe")) as cart:
        cart.twin.device._pose_at = MOTION
        with cart.open(probe="@1", witness="@2") as tracker:
            until(tracker, lambda pose: pose.witness is not None)


def test_one_tool_is_no_reference_for_itself(tmp_path: Path) -> None:
    """Both were read, and the probe never moved."""
    for name in ("probe", "same"):
        (tmp_path / f"{name}.rom").write_bytes(make_rom())
    rom, same = str(tmp_path / "probe.rom"), str(tmp_path / "same.rom")
    for probe, reference in (("@1", "@1"), (rom, rom), (rom, same)):
        with pytest.raises(ConfigurationError, match=f"reference={reference} is the same tool as probe={probe}"):
            ndi_options({"probe": probe, "reference": reference}, "ndi:x")
    assert ndi_options({"probe": "@1", "reference": "@2"}, "ndi:x").reference is not None


def test_one_tool_is_no_witness_for_itself(tmp_path: Path) -> None:
    for name in ("probe", "same"):
        (tmp_path / f"{name}.rom").write_bytes(make_rom())
    rom, same = str(tmp_path / "probe.rom"), str(tmp_path / "same.rom")
    for options in ({"probe": "@1", "witness": "@1"}, {"probe": rom, "witness": rom}, {"probe": rom, "witness": same}):
        with pytest.raises(ConfigurationError, match="is the same tool as probe"):
            ndi_options(options, "ndi:x")
    for options in ({"probe": "@1", "reference": "@1"}, {"probe": rom, "reference": same}):
        with pytest.raises(ConfigurationError, match=f"reference={options['reference']} is the same tool as probe"):
            ndi_options(options, "ndi:x")
    with pytest.raises(ConfigurationError, match="is the same tool as reference"):
        ndi_options({"probe": "@1", "reference": "@2", "witness": "@2"}, "ndi:x")
    with pytest.raises(ConfigurationError, match="a witness or further tools need a probe"):
        ndi_options({"witness": "@2"}, "ndi:x")
    assert ndi_options({"probe": f"{rom}@1", "witness": f"{rom}@2"}, "ndi:x").witness is not None
    with pytest.raises(ConfigurationError, match="rigid body 1, which is the probe's or the reference already"):
        optotrak_options({"witness": "1"}, "optotrak://x")
    with pytest.raises(ConfigurationError, match="the witness is the transform ProbeToTracker"):
        parse_target("x", {"witness": "Probe"})


def test_one_that_is_not_seen_is_told() -> None:
    sight = WitnessSight("tool 0B", 0)
    probe, witness = np.eye(4), np.diag([1.0, 1.0, 1.0, 1.0])
    assert sight.remarks(4_000_000_000) == ()
    assert "(tool 0B) was not seen yet" in sight.remarks(6_000_000_000)[0]
    assert sight.take(6_000_000_000, probe, None) is None
    assert sight.take(7_000_000_000, probe, witness) is witness
    assert sight.remarks(11_000_000_000) == ()
    assert "was not seen for 13 s" in sight.remarks(20_000_000_000)[0]


def test_a_second_body_that_stands_still_while_the_first_moves_is_not_seen() -> None:
    sight = WitnessSight("x", 0)
    first, moved, witness = np.eye(4), np.diag([1.0, 1.0, 1.0, 1.0]), np.eye(4) * 1.0
    moved[0, 3] = 1.0
    assert sight.take(1, first, witness) is not None
    assert sight.take(2, first, witness) is not None
    assert sight.take(3, moved, witness.copy()) is None


def test_a_second_body_measured_at_another_time_than_the_first_is_not_seen(tmp_path: Path) -> None:
    with ndi(tmp_path, False) as (tracker, _):
        assert isinstance(tracker, NdiTracker)
        pose = until(tracker, lambda pose: pose.witness is not None)
        assembly, handle = tracker._assembly, tracker._assembly._witness.handle
        reading = assembly.readings[handle]
        fine, later = (PoseStatus.OK, ""), pose.stamp.t_ns + 1_000_000_000
        assert assembly.new_pose(Stamp(later, 0), fine).witness is not None
        assembly.readings[handle] = replace(reading, tick=reading.tick - 1)
        assert assembly.new_pose(Stamp(later + 1, 0), fine).witness is None
