"""One driver, four trackers: the replies it uses, the tools it takes, what it knows of them, and when it objects."""

from pathlib import Path

import numpy as np
import pytest

from probewatch.drivers.errors import ConfigurationError, DeviceLost
from probewatch.drivers.samples import PoseStatus
from probewatch.drivers.trackers.ndi.identity import ReplyKind, identity_of
from probewatch.drivers.trackers.ndi.tools import parse_information, parse_requested_tool
from probewatch.drivers.trackers.ndi.wire import Command, encode_command
from probewatch.drivers.twins.ndi.combined_api import BUMPED, PTP_LOST, TOO_HOT
from probewatch.drivers.twins.ndi.models import AURORA, MODELS, SPECTRA, VEGA, VICRA, Model
from probewatch.drivers.twins.ndi.tool_definitions import REFERENCE
from tests.support.simulated_ndi import bench, poses, until
from tests.support.stopwatch import Stopwatch

CASES = {
    "vicra": (VICRA, None, {}, ReplyKind.BX),
    "spectra": (SPECTRA, None, {}, ReplyKind.BX),
    "spectra of old": (SPECTRA, "Polaris Spectra Rev 007", {}, ReplyKind.TX),
    "vega": (VEGA, None, {}, ReplyKind.BX2),
    "vega as told": (VEGA, None, {"reply": "bx"}, ReplyKind.BX),
    "aurora": (AURORA, None, {}, ReplyKind.TX),
    "aurora of today": (AURORA, "AURORA Rev 009", {}, ReplyKind.BX),
}


@pytest.mark.parametrize("name", CASES)
def test_every_model_gives_the_poses_it_measures(name: str, tmp_path: Path) -> None:
    model, freeze_tag, options, kind = CASES[name]
    with bench(tmp_path, model, rate=2.0, wired=("probe",) * model.electromagnetic, freeze_tag=freeze_tag) as cart:
        with cart.open(**options) as tracker:
            found = poses(tracker, 15)
            telemetry = tracker.telemetry
        assert telemetry.reply is kind
        assert (telemetry.identity.serial_number, telemetry.refused) == (model.serial_number, 0)
        assert {pose.status for pose in found} <= {PoseStatus.OK, PoseStatus.STALE}
        for pose in found:
            if pose.matrix is not None:
                np.testing.assert_allclose(pose.matrix, cart.true(pose), atol=0.006 if kind is ReplyKind.TX else 1e-3)
                assert pose.rms_mm == pytest.approx(model.fit_mm, abs=1e-6)


def test_frame_numbers_step_as_the_model_counts(tmp_path: Path) -> None:
    for model, step, phase in ((VICRA, 3, 0), (AURORA, 8, 6)):
        with bench(tmp_path, model, wired=("probe",)) as cart, cart.open() as tracker:
            frames = [pose.sequence for pose in poses(tracker, 8) if pose.status is PoseStatus.OK]
        assert {frame % step for frame in frames} == {phase % step}


@pytest.mark.parametrize("name", ["spectra", "vega", "aurora of today"])
def test_poses_relative_to_the_reference_tool(name: str, tmp_path: Path) -> None:
    model, freeze_tag, _, _ = CASES[name]
    wired = ("reference", "probe") if model.electromagnetic else ()
    with bench(tmp_path, model, wired=wired, freeze_tag=freeze_tag) as cart:
        tools = {"probe": "@2", "reference": "@1"} if wired else {"reference": cart.rom("reference")}
        with cart.open(**tools) as tracker:
            pose = until(tracker, PoseStatus.OK)
            assert pose.matrix is not None
            expected = np.linalg.inv(cart.true(pose, "reference")) @ cart.true(pose)
            np.testing.assert_allclose(pose.matrix, expected, atol=1e-3)
            cart.twin.device.ports[cart.handle(REFERENCE)].seen = False
            assert until(tracker, PoseStatus.MISSING).reason.startswith("reference tool: ")


def test_a_wired_reference_beside_a_wireless_probe(tmp_path: Path) -> None:
    with bench(tmp_path, SPECTRA, wired=("reference",)) as cart, cart.open(reference="@1") as tracker:
        pose = until(tracker, PoseStatus.OK)
        expected = np.linalg.inv(cart.true(pose, "reference")) @ cart.true(pose)
        np.testing.assert_allclose(pose.matrix, expected, atol=1e-3)
        assert [one.tool.name for one in tracker.telemetry.tools][1] == "tool on plug 1"


def test_further_tools_are_in_the_telemetry(tmp_path: Path) -> None:
    with bench(tmp_path, VEGA) as cart, cart.open(tools=f"{cart.rom('probe')},{cart.rom('probe')}") as tracker:
        until(tracker, PoseStatus.OK)
        tools = tracker.telemetry.tools
        assert len(tools) == 3
        for one in tools[1:]:
            assert one.status is PoseStatus.OK
            np.testing.assert_allclose(one.matrix[:3, 3], (100, 0, -1500), atol=1e-3)


def test_without_a_wish_the_first_whole_sensor_that_is_no_reference_is_the_probe(tmp_path: Path) -> None:
    with bench(tmp_path, AURORA, wired=("reference", "dual", "probe")) as cart, cart.open() as tracker:
        until(tracker, PoseStatus.OK)
        tools = [one.tool for one in tracker.telemetry.tools]
        assert [tool.name for tool in tools] == [
            "tool on plug 3",
            "tool on plug 1",
            "tool on plug 2a",
            "tool on plug 2b",
        ]
        assert [tool.five_dof for tool in tools] == [False, False, True, True]


def test_half_of_a_dual_tool_is_no_probe(tmp_path: Path) -> None:
    with bench(tmp_path, AURORA, wired=("dual",)) as cart:
        for options in ({}, {"probe": "@1b"}):
            with pytest.raises(ConfigurationError, match="five degrees of freedom"):
                cart.open(**options)


def test_a_tool_that_does_not_say_what_it_is_needs_a_definition(tmp_path: Path) -> None:
    with bench(tmp_path, AURORA, wired=("unprogrammed", "probe")) as cart:
        with cart.open() as tracker:
            assert tracker.telemetry.warnings == (
                "the tool on plug 1 does not say what it is; name its definition with FILE.rom@PLUG",
            )
            assert tracker.telemetry.tools[0].tool.name == "tool on plug 2"
        with cart.open(probe=f"{cart.rom('probe')}@1") as tracker:
            assert until(tracker, PoseStatus.OK).matrix is not None
            assert tracker.telemetry.tools[0].tool.name == "tool on plug 1"


@pytest.mark.parametrize("wired", [("unprogrammed",), ("unprogrammed", "probe")])
def test_a_plugged_tool_without_memory_is_not_told_as_none(tmp_path: Path, wired: tuple[str, ...]) -> None:
    with (
        bench(tmp_path, AURORA, wired=wired) as cart,
        pytest.raises(DeviceLost, match="the tool on plug 1 does not say what it is") as told,
    ):
        cart.open(probe="@1")
    assert "probe=FILE.rom@1" in told.value.remedy


def test_a_plug_without_a_tool_is_named(tmp_path: Path) -> None:
    with bench(tmp_path, AURORA, wired=("probe",)) as cart, pytest.raises(DeviceLost, match="no tool on plug 4"):
        cart.open(probe="@4")


FAULTS = [
    ("out-of-volume", PoseStatus.OUT_OF_VOLUME, "outside"),
    ("partial", PoseStatus.PARTIAL, "partly outside"),
    ("missing", PoseStatus.MISSING, "see"),
    ("interference", PoseStatus.FAULT, "interference"),
    ("bump", PoseStatus.FAULT, "bumped"),
    ("hot", PoseStatus.FAULT, "too hot"),
]


@pytest.mark.parametrize("model", [SPECTRA, VEGA], ids=lambda model: model.name)
@pytest.mark.parametrize(("fault", "status", "word"), FAULTS)
def test_every_objection_of_the_device_takes_the_number_away(
    model: Model, fault: str, status: PoseStatus, word: str, tmp_path: Path
) -> None:
    with bench(tmp_path, model) as cart, cart.open() as tracker:
        until(tracker, PoseStatus.OK)
        cart.faults(fault)
        assert word in until(tracker, status).reason
        cart.faults()
        if fault == "bump":
            seen = {pose.status for pose in poses(tracker, 8)}
            assert PoseStatus.FAULT in seen
            assert seen <= {PoseStatus.FAULT, PoseStatus.STALE}, "stale: this computer paused"
        else:
            assert until(tracker, PoseStatus.OK, limit=400).matrix is not None


@pytest.mark.parametrize("model", [VICRA, VEGA], ids=lambda model: model.name)
def test_a_bump_stands_until_a_person_clears_it(model: Model, tmp_path: Path) -> None:
    with bench(tmp_path, model) as cart:
        with cart.open() as tracker:
            until(tracker, PoseStatus.OK)
            cart.twin.device.raise_alert(BUMPED)
            until(tracker, PoseStatus.FAULT)
        with cart.open() as tracker:
            assert until(tracker, PoseStatus.FAULT).reason == "the position sensor was bumped"
            assert tracker.telemetry.health.bumped
            tracker.clear_bump()
            assert until(tracker, PoseStatus.OK).matrix is not None
            assert not tracker.telemetry.health.bumped


@pytest.mark.parametrize("model", [SPECTRA, VEGA], ids=lambda model: model.name)
def test_alerts_are_typed_telemetry(model: Model, tmp_path: Path) -> None:
    with bench(tmp_path, model) as cart, cart.open() as tracker:
        until(tracker, PoseStatus.OK)
        cart.twin.device.raise_alert(0x100000)
        poses(tracker, 6)
        health = tracker.telemetry.health
        assert (health.battery_low, health.bumped, health.too_hot, health.warnings) == (
            True,
            False,
            False,
            "low battery",
        )
        cart.twin.device.raise_alert(TOO_HOT)
        until(tracker, PoseStatus.FAULT)
        health = tracker.telemetry.health
        assert (health.too_hot, health.temperature_wrong, health.battery_low) == (True, True, True)


def test_vega_reports_nothing_of_a_tool_that_it_does_not_measure(tmp_path: Path) -> None:
    """BX2: staleness is absence, and the word for it is another than for a counter that stands still."""
    with bench(tmp_path, VEGA, rate=1.0) as cart, cart.open() as tracker:
        poses(tracker, 30)
        cart.faults("stale-counter")
        watch = Stopwatch()
        until(tracker, PoseStatus.STALE, reason="nothing new of the tool")
        assert watch.spent_s() < 0.2
        assert tracker.read(0.2) is not None, "word that it is still stale"
        cart.faults()
        assert until(tracker, PoseStatus.OK).matrix is not None


def test_a_clock_that_loses_its_master_starts_the_time_again(tmp_path: Path) -> None:
    with bench(tmp_path, VEGA, rate=1.0) as cart, cart.open() as tracker:
        before = poses(tracker, 90)[-1]
        assert before.stamp.err_ns < 20e6
        cart.faults("clock-step")
        after = until(tracker, PoseStatus.OK)
        while not (tracker.telemetry.clock_restarts and tracker.telemetry.health.clock_unsynchronised):
            after = until(tracker, PoseStatus.OK)
        assert after.stamp.t_ns > before.stamp.t_ns
        assert after.stamp.err_ns > before.stamp.err_ns, "the bound says that little is known of the new time"
        true_ns = cart.clock.origin_ns + cart.twin.device.frame_s(after.sequence) * 1e9
        assert abs(after.stamp.t_ns - true_ns) <= after.stamp.err_ns
        assert cart.twin.device.alerts & PTP_LOST


def test_times_of_bx2_are_those_of_the_device(tmp_path: Path) -> None:
    with bench(tmp_path, VEGA, rate=1.0) as cart, cart.open() as tracker:
        found = [pose for pose in poses(tracker, 120)[60:] if pose.status is PoseStatus.OK]
        errors_ns = [
            abs(p.stamp.t_ns - cart.clock.origin_ns - cart.twin.device.frame_s(p.sequence) * 1e9) for p in found
        ]
        assert np.median(errors_ns) < 2e6
        assert np.mean(np.array(errors_ns) <= [pose.stamp.err_ns for pose in found]) >= 0.95


@pytest.mark.parametrize("name", ["spectra", "spectra of old", "vega"])
def test_marker_geometry_shows_a_marker_that_drifts(name: str, tmp_path: Path) -> None:
    model, freeze_tag, _, _ = CASES[name]
    with bench(tmp_path, model, freeze_tag=freeze_tag) as cart, cart.open() as tracker:
        poses(tracker, 20)
        whole = tracker.telemetry.tools[0].geometry
        assert whole is not None
        assert (whole.markers, whole.loose, whole.bent) == (4, None, False)
        assert whole.rms_mm < 0.01
        cart.faults("marker-drift")
        rms_mm = 0.0
        for _ in range(400):
            pose = tracker.read(1.0)
            rms_mm = pose.rms_mm if pose is not None else rms_mm
            drifted = tracker.telemetry.tools[0].geometry
            assert drifted is not None
            if drifted.loose_mm > 4.5:
                break
        assert drifted.loose == 2
        assert drifted.rms_mm > 1.0
        assert rms_mm > 1.0, "the device's own fit shows it too"


def test_field_distortion_shows_in_the_indicator_before_the_device_objects(tmp_path: Path) -> None:
    with bench(tmp_path, AURORA, rate=2.0, wired=("probe",)) as cart, cart.open() as tracker:
        assert until(tracker, PoseStatus.OK).rms_mm == pytest.approx(0.1)
        cart.faults("em-distortion")
        indicators = []
        while (pose := poses(tracker, 1)[0]).status is not PoseStatus.FAULT:
            indicators.append(pose.rms_mm)
        assert max(indicators) > 1.5
        assert "disturbance" in pose.reason


def test_the_second_host_is_told_that_another_one_commands(tmp_path: Path) -> None:
    with bench(tmp_path, VEGA) as cart, cart.open() as tracker:
        until(tracker, PoseStatus.OK)
        with pytest.raises(DeviceLost, match="another computer holds the tracker"):
            cart.open()
        assert until(tracker, PoseStatus.OK).matrix is not None


def test_a_device_that_refuses_bx_is_asked_by_tx(tmp_path: Path) -> None:
    with bench(tmp_path, SPECTRA) as cart:
        del cart.twin.device._commands["BX"]
        with cart.open() as tracker:
            assert until(tracker, PoseStatus.OK).matrix is not None
            assert tracker.telemetry.reply is ReplyKind.TX
            assert tracker.telemetry.warnings[0].startswith("BX: the tracker answered ERROR01")


def test_a_device_without_marker_details_still_tracks(tmp_path: Path) -> None:
    with bench(tmp_path, SPECTRA) as cart:
        whole = cart.twin.device.answer
        refusing = encode_command(Command("BX", "180B"))
        cart.twin.device.answer = (  # type: ignore[method-assign]
            lambda line, *rest: b"ERROR23CA42\r" if line == refusing else whole(line, *rest)
        )
        with cart.open() as tracker:
            assert {pose.status for pose in poses(tracker, 20)} <= {PoseStatus.OK, PoseStatus.STALE}
            assert tracker.telemetry.tools[0].geometry is None


@pytest.mark.parametrize(
    ("tag", "api", "kind"),
    [
        ("Polaris Vicra Rev 007.000", "G.001.006", ReplyKind.BX),
        ("Polaris Vega 008", "G.002.004", ReplyKind.TX),
        ("Polaris Vega 014", "G.003.008", ReplyKind.BX2),
        ("AURORA Rev 007", "D.001.007", ReplyKind.TX),
        ("AURORA Rev 012", "D.003.001", ReplyKind.BX2),
        ("", "", ReplyKind.BX),
        ("nonsense", "G.x", ReplyKind.BX),
    ],
)
def test_firmware_decides_on_the_reply(tag: str, api: str, kind: ReplyKind) -> None:
    identity = identity_of(f"Something Control Firmware\nFreeze Tag: {tag}\n", api)
    assert identity.reply is kind
    assert identity.electromagnetic == tag.startswith("AURORA")


def test_identity_of_a_real_aurora() -> None:
    version = (
        "Aurora Control Firmware\nNDI S/N: D4-04652\nCharacterization Date: 2016-12-21\n"
        "Freeze Tag: AURORA Rev 008\nFreeze Date: 2013-07-25\n(C) Northern Digital Inc.\n"
    )
    identity = identity_of(version, "")
    assert (identity.title, identity.serial_number) == ("Aurora", "D4-04652")
    assert (identity.freeze_tag, identity.characterised) == ("AURORA Rev 008", "2016-12-21")
    assert str(identity) == "Aurora D4-04652 (AURORA Rev 008)"


def test_tool_information() -> None:
    text = "01000000NDI         00135A7B2C131" + "8700449".ljust(20) + "SCU-0   100301"
    found = parse_information(text)
    assert found is not None
    assert (found.main_type, found.manufacturer, found.serial_number) == (1, "NDI", "35A7B2C1")
    assert (found.part_number, found.wireless, found.socket, found.channel) == ("8700449", False, 3, 1)
    assert (found.is_reference, found.priority) == (True, "S")
    assert parse_information("UNOCCUPIED") is None


def test_tool_information_that_is_not_understood_does_not_stop_the_watch(tmp_path: Path) -> None:
    with bench(tmp_path, SPECTRA) as cart:
        cart.twin.device.handles._phinf = lambda arguments: "02000000NDI"  # type: ignore[method-assign]
        with cart.open() as tracker:
            assert until(tracker, PoseStatus.OK).matrix is not None
            assert "PHINF answered '02000000NDI'" in tracker.telemetry.warnings[0]


@pytest.mark.parametrize("text", ["", "@", "@0", "@x", "@2c", "a@b@c"])
def test_a_wish_that_names_no_tool_is_refused(text: str) -> None:
    with pytest.raises(ConfigurationError):
        parse_requested_tool(text, "ndi:x")


def test_all_models_are_simulated() -> None:
    assert sorted(MODELS) == ["aurora", "polaris-spectra", "polaris-vicra", "vega"]
