"""The items of the self-test: what is green, what is red, and what could not be tried."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from drivers.samples import Frame, Pose, PoseStatus, Stamp
from drivers.twins.scene.world import World, WorldSettings
from tests.support.answering import recorded
from tools.selftest import items

NOW = datetime(2026, 11, 23, tzinfo=UTC)


def poses(number: int = 300, noise_mm: float = 0.05, drift_mm: float = 0.0, seen: bool = True) -> list[Pose]:
    random = np.random.default_rng(1)
    found = []
    for index in range(number):
        matrix = np.eye(4)
        matrix[:3, 3] = random.normal([drift_mm * index / number, 0, 0], noise_mm)
        status = PoseStatus.OK if seen else PoseStatus.MISSING
        found.append(Pose(Stamp(index * 16_666_667, 1_000_000), index, matrix if seen else None, 0.1, status))
    return found


def green(found: list[items.Item]) -> dict[str, bool | None]:
    return {item.name: item.green for item in found}


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        (poses(), True),
        (poses(noise_mm=2.0), False),
        (poses(drift_mm=20.0), None),
        (poses(seen=False), None),
        ([], None),
    ],
)
def test_noise_is_told_of_a_probe_at_rest_alone(given, wanted) -> None:
    found = items.noise(given)
    assert found.green is wanted
    assert bool(found.remedy) is (wanted is not True)


def test_rates_losses_and_times() -> None:
    good = poses(120)
    arrivals = [pose.stamp.t_ns + 5_000_000 for pose in good]
    assert all(green(items.timing("tracker", good, arrivals)).values())
    holed = [pose for index, pose in enumerate(good) if index % 10]
    assert green(items.timing("tracker", holed, arrivals[: len(holed)]))["tracker losses"] is False
    slow = [Pose(Stamp(index * 10**9, 1), index, None, 0.0, PoseStatus.MISSING) for index in range(20)]
    assert green(items.timing("tracker", slow, [0] * 20))["tracker rate"] is False
    vague = [Pose(Stamp(pose.stamp.t_ns, 50_000_000), pose.sequence, None, 0.0, PoseStatus.MISSING) for pose in good]
    assert green(items.timing("tracker", vague, arrivals))["tracker stamps"] is False
    assert green(items.timing("video", [], [])) == {"video rate": False}


def test_the_overlay_is_learnt_from_motion_alone() -> None:
    world = World(1, settings=WorldSettings(320, 240))
    moving = [Frame(Stamp(index, 0), index, world.frame(index / 15, index)) for index in range(60)]
    assert items.overlay(moving).green is True
    still = [Frame(Stamp(index, 0), index, world.frame(0.0, 0)) for index in range(30)]
    assert items.overlay(still).green is None
    assert items.overlay([]).green is None


def test_the_recorded_status_is_green_and_each_thing_that_is_wrong_is_red() -> None:
    good = recorded()
    found = [*items.service(good), *items.devices(good), *items.disk(good), *items.reference(good, NOW)]
    assert [item for item in found if item.green is False] == []

    def named(name: str, **fields: object) -> bool | None:
        status = recorded(**fields)
        parts = [*items.service(status), *items.devices(status), *items.disk(status), *items.reference(status, NOW)]
        return green(parts)[name]

    assert named("service", state="device lost") is False
    assert named("latched alarm", latched="halt") is False
    assert named("video sim:x", lost={"video sim:x": "is gone"}) is False
    log = good["log"]
    assert named("alarm log", log=log | {"failing": "disk full"}) is False
    assert named("disk", log=log | {"free_bytes": 10}) is False
    assert named("disk", log=log | {"free_bytes": None}) is None
    assert named("reference", reference=None, reference_waits="no picture yet") is False
    assert named("reference", reference=good["reference"] | {"verified_utc": None}) is False
    late, early = ((NOW + timedelta(days=days)).isoformat() for days in (-1, 1))
    assert named("reference due", reference_due_utc=late) is False
    assert named("reference due", reference_due_utc=early) is True
    assert named("configured calibration", calibration_changed="was changed") is False


@pytest.mark.parametrize("synchronised", [True, False, None])
def test_a_clock_before_the_program_was_made_is_wrong(synchronised) -> None:
    assert items.clock(NOW, NOW - timedelta(days=1), synchronised).green
    assert items.clock(NOW, NOW + timedelta(days=1), synchronised).green is False


@pytest.mark.parametrize("seen", [True, False, None])
def test_lamps_are_what_a_person_says(seen) -> None:
    lamp = {"url": "relay:x", "signal": "red"}
    assert items.outputs(recorded(outputs=[lamp]), seen).green is seen
    assert items.outputs(recorded(outputs=[lamp | {"signal": "contact"}]), seen).green is True


def test_a_part_that_is_within_its_limit_again_is_red_and_says_why() -> None:
    busy = {
        "name": "processor time",
        "fault": "overloaded",
        "verdict": "FAULT",
        "ratio": 0.4,
        "value": 0.4,
        "limit": 1.0,
        "unit": "",
    }
    (one,) = items.devices({**recorded(), "devices": [busy], "lost": {}, "remarks": []})[:1]
    assert (one.green, one.remedy) == (False, "Wait some seconds, and test again")
    assert "was beyond its limit, and is within it again" in one.what
    (one,) = items.devices({**recorded(), "devices": [{**busy, "ratio": 1.4, "value": 1.4}], "lost": {}})[:1]
    assert one.what == "1.4, limit 1"


@pytest.mark.parametrize(("known", "said"), [(True, "halt, acknowledged"), (False, "halt, not acknowledged")])
def test_a_latched_alarm_says_whether_a_person_knows_of_it(known: bool, said: str) -> None:
    told = items.service({**recorded(), "latched": "halt", "acknowledged": known})
    assert [one.what for one in told if one.name == "latched alarm"] == [said]


def test_a_value_beyond_its_limit_is_told_in_figures_that_a_person_reads() -> None:
    silent = {"name": "tracker presence", "fault": "device-lost", "verdict": "FAULT", "ratio": 42.9}
    silent |= {"value": 21433.813635, "limit": 500.0, "unit": "ms"}
    (one,) = items.devices({**recorded(), "devices": [silent], "lost": {}})[:1]
    assert one.what == "21434 ms, limit 500"
