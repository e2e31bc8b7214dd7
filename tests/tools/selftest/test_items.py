"""The items of the self-test: what is green, what is red, and what could not be tried."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from rich.console import Console

from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp
from probewatch.drivers.twins.scene.world import World, WorldSettings
from probewatch.tools.selftest import items
from probewatch.tools.selftest.listed import print_items
from tests.support.answering import recorded

NOW = datetime(2026, 11, 23, tzinfo=UTC)
SILENCE_MS = 500.0


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
    assert all(green(items.timing("tracker", good, arrivals, SILENCE_MS)).values())
    holed = [pose for index, pose in enumerate(good) if index % 10]
    assert green(items.timing("tracker", holed, arrivals[: len(holed)], SILENCE_MS))["tracker losses"] is False
    slow = [Pose(Stamp(index * 10**9, 1), index, None, 0.0, PoseStatus.MISSING) for index in range(20)]
    assert green(items.timing("tracker", slow, [0] * 20, SILENCE_MS))["tracker rate"] is False
    vague = [Pose(Stamp(pose.stamp.t_ns, 50_000_000), pose.sequence, None, 0.0, PoseStatus.MISSING) for pose in good]
    assert green(items.timing("tracker", vague, arrivals, SILENCE_MS))["tracker stamps"] is False
    assert green(items.timing("video", [], [], SILENCE_MS)) == {"video rate": False}


@pytest.mark.parametrize(("pause_ms", "wanted"), [(0, True), (450, True), (600, False), (1033, False)])
@pytest.mark.parametrize("counts", [True, False])
def test_a_pause_that_the_service_calls_a_loss_is_not_regular(pause_ms: int, wanted: bool, counts: bool) -> None:
    """The stamps may lie on their straight line none the less, as behind a device that counts what it did not send."""
    step_ns = 16_666_667
    missed = round(pause_ms * 1e6 / step_ns)
    numbers = [index + (missed if index > 60 else 0) for index in range(600)]
    given = [
        Pose(Stamp(number * step_ns, 1), number if counts else 0, None, 0.0, PoseStatus.MISSING) for number in numbers
    ]
    found = items.timing("tracker", given, [0] * len(given), SILENCE_MS)
    regular = next((item for item in found if item.name == "tracker regularity"), None)
    assert (regular is None or regular.green) is wanted
    assert wanted or "ms, at most 500 ms" in regular.what


def test_how_long_a_source_may_be_silent_is_what_the_service_says() -> None:
    status = recorded()
    for check in status["devices"]:
        check["limit"] = 900.0 if check["name"] == "video presence" else check["limit"]
    assert (items.silence_ms(status, "video"), items.silence_ms(status, "tracker")) == (900.0, 500.0)


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


@pytest.mark.parametrize(
    ("origin", "said"),
    [("configuration", "is in force"), ("recalibration", "reference 3 is in force, as was decided later")],
)
def test_it_says_of_the_configured_calibration_whether_it_is_that_or_a_later_one(origin, said) -> None:
    status = recorded(reference=recorded()["reference"] | {"origin": origin, "number": 3})
    assert [item.what for item in items.reference(status, NOW) if item.name == "configured calibration"] == [said]


@pytest.mark.parametrize("synchronised", [True, False, None])
def test_a_clock_before_the_program_was_made_is_wrong(synchronised) -> None:
    assert items.clock(NOW, NOW - timedelta(days=1), synchronised).green
    assert items.clock(NOW, NOW + timedelta(days=1), synchronised).green is False


@pytest.mark.parametrize("seen", [True, False, None])
def test_lamps_are_what_a_person_says(seen) -> None:
    lamp = {"url": "relay:x", "signal": "red"}
    assert items.outputs(recorded(outputs=[lamp]), seen).green is seen
    assert items.outputs(recorded(outputs=[lamp | {"signal": "contact"}]), seen).green is True


def changed(**verdicts: tuple[float, str]) -> list[items.Item]:
    """The items of the recorded devices, of which those with these names have another value and verdict."""
    status = recorded()
    for check in status["devices"]:
        name = check["name"].replace(" ", "_")
        check["value"], check["verdict"] = verdicts.get(name, (check["value"], check["verdict"]))
    return items.devices(status)


def test_of_a_tracker_that_is_lost_nothing_else_is_green() -> None:
    found = green(changed(tracker_presence=(12_759.0, "FAULT")))
    assert found["tracker presence"] is False
    unknown = {name for name, good in found.items() if good is None}
    assert unknown == {"tracker alert", "tracker freshness", "line of sight", "marker fit", "marker geometry"}
    assert None not in green(changed(estimator_presence=(2000.0, "FAULT"))).values()


def test_a_probe_that_the_tracker_does_not_see_has_its_line() -> None:
    found = {item.name: item for item in changed(line_of_sight=(5200.0, "NOT_VERIFIED"))}
    assert (found["line of sight"].green, found["line of sight"].what) == (None, "5200 ms, limit 3000")


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


def test_a_lost_device_has_one_remedy_and_its_url_does_not_make_the_list_as_wide_as_itself(capsys) -> None:
    """Its own was followed by that of every device, and its URL stood where the names are."""
    url = "ndi:/dev/tty0?probe=/etc/probewatch/probe.rom"
    own = "/dev/tty0: no such serial port. Plug the cable in, or correct the path in the configuration"
    lost = [
        item for item in items.devices(recorded(lost={f"tracker {url}": own})) if item.name.startswith("tracker ndi")
    ]
    assert [item.remedy for item in lost] == ["Mend that first, and repeat"]
    print_items(lost, Console(), "en")
    assert f"tracker\t{own}. Mend that first, and repeat\n" in capsys.readouterr().out
    assert items.devices(recorded(lost={"video sim:x": "is gone"}))[-1].remedy == "Mend it, or its cable"


@pytest.mark.parametrize(
    ("bad", "language", "said"),
    [
        (1, "en", "1 of 2 is not green."),
        (1, "de", "1 von 2 ist nicht grün."),
        (2, "en", "2 of 2 are not green."),
        (2, "de", "2 von 2 sind nicht grün."),
    ],
)
def test_one_that_is_not_green_is_told_as_one(
    bad: int, language: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    found = [items.Item("disk", number >= bad, "is there") for number in range(2)]
    print_items(found, Console(), language)
    assert capsys.readouterr().out.splitlines()[-1] == said
