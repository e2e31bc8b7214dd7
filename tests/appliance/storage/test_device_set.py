"""What a device set says of its devices is told, with what is to be done; of what it does not say nothing is."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from probewatch.appliance.storage.calibration_file import read_calibration
from probewatch.appliance.storage.device_set import clip_px, not_kept, remarks
from probewatch.tools.commands.calibration import command
from tests.support.recordings import plus_file

_SET = """<PlusConfiguration version="2.9">
  <DataCollection>
    <DeviceSet Name="made up" Description="d"/>
    <Device Id="TrackerDevice" Type="PolarisTracker" {tracker}/>
    <Device Id="Grabber" Type="WinProbe" {device}>
      <DataSources><DataSource Type="Video" Id="Video" {source}/></DataSources>
    </Device>
  </DataCollection>
  <VolumeReconstruction ClipRectangleOrigin="0 0" ClipRectangleSize="820 616"/>
  <CoordinateDefinitions>
    <Transform From="Image" To="Probe" Matrix="0 0.08 0 12.7 -0.08 0 0 50.8 0 0 0.08 -0.5 0 0 0 1"/>
  </CoordinateDefinitions>
</PlusConfiguration>
"""
CLIP = 'ClipRectangleOrigin="100 20" ClipRectangleSize="640 480"'


def device_set(tracker: str = "", device: str = "", source: str = "") -> bytes:
    return _SET.format(tracker=tracker, device=device, source=source).encode()


@pytest.mark.parametrize(("device", "source"), [(CLIP, ""), ("", CLIP), (CLIP, CLIP), ("", f"{CLIP[:-1]} 1{CLIP[-1]}")])
def test_the_part_that_plus_cuts_out_is_told_with_the_option_that_cuts_it_here(device: str, source: str) -> None:
    content = device_set(device=device, source=source)
    assert clip_px(content) == (100, 20, 640, 480)
    (told,) = remarks(content, (640, 480))
    assert "'Grabber'" in told
    assert "crop=100,20,640,480" in told
    assert "were given" not in told
    assert "and 1920 x 1080 were given" in remarks(content, (1920, 1080))[0]


@pytest.mark.parametrize("offset", ["-0.0553", "0.12", "1e-1"])
def test_an_offset_of_times_is_told_with_what_is_to_be_done(offset: str) -> None:
    (told,) = remarks(device_set(tracker=f'LocalTimeOffsetSec="{offset}"'))
    for part in (f"{float(offset):g} s", "'TrackerDevice'", "probewatch latency", "latency_ms"):
        assert part in told


@pytest.mark.parametrize(
    "content",
    [
        device_set(),
        device_set('LocalTimeOffsetSec="0.0"', 'ClipRectangleOrigin="0 0" ClipRectangleSize="0 0"'),
        device_set('LocalTimeOffsetSec="soon"', 'ClipRectangleSize="-1 -1"', 'ClipRectangleSize="all"'),
        b'format = "probewatch-calibration"',
        b"<PlusConfiguration",
        b"",
    ],
)
def test_nothing_is_told_of_what_is_not_said(content: bytes) -> None:
    assert (remarks(content), clip_px(content)) == ((), None)


def test_the_clip_of_a_segmentation_is_none_of_the_pictures() -> None:
    assert remarks(plus_file("PlusDeviceSet_fCal_Sim_VolumeReconstruction.xml").read_bytes()) == ()


@pytest.mark.parametrize("stored", ["MN", "UF", "UN", "una"])
def test_a_picture_that_plus_turns_is_told_with_the_option_that_turns_it_here(stored: str) -> None:
    (told,) = remarks(device_set(source=f'PortUsImageOrientation="{stored}"'))
    assert f"'Grabber' from {stored[:2].upper()} to MF" in told
    assert f"orientation={stored[:2].upper()} in the URL" in told
    assert remarks(device_set(source='PortUsImageOrientation="MFA"')) == ()


def test_import_tells_in_one_line_what_of_the_transforms_is_not_kept(tmp_path: Path) -> None:
    file, output = plus_file("PlusDeviceSet_fCal_Sim_VolumeReconstruction.xml"), tmp_path / "probe.toml"
    done = CliRunner().invoke(command, ["import", str(file), "--image-size", "820", "616", "--output", str(output)])
    (said,) = done.stderr.splitlines()
    assert said.startswith("not kept of what the file says: Error 0.571604 and Date 010214_115636 (Image to Probe), ")
    assert not_kept(device_set()) == not_kept(b"<PlusConfiguration") == ()
    many = "".join(f'<Transform From="A{n}" To="B" Date="{n}"/>' for n in range(9)).encode()
    (said,) = not_kept(device_set().replace(b"<Transform", many + b"<Transform"))
    assert said.endswith("Date 5 (A5 to B), 3 more")


def test_import_takes_the_size_that_plus_cuts_out_and_tells_both(tmp_path: Path) -> None:
    file, output = tmp_path / "set.xml", tmp_path / "probe.toml"
    file.write_bytes(device_set('LocalTimeOffsetSec="-0.05"', source=CLIP))
    done = CliRunner().invoke(command, ["import", str(file), "--output", str(output)])
    assert (done.exit_code, done.stdout) == (0, f"written: {output}\n")
    assert read_calibration(output).image_size_px == (640, 480)
    assert "crop=100,20,640,480" in done.stderr
    assert "LocalTimeOffsetSec = -0.05 s" in done.stderr


def test_import_asks_for_the_size_where_nothing_says_it(tmp_path: Path) -> None:
    file, output = tmp_path / "set.xml", tmp_path / "probe.toml"
    file.write_bytes(device_set())
    done = CliRunner().invoke(command, ["import", str(file), "--output", str(output)])
    assert (done.exit_code, output.exists()) == (2, False)
    assert "--image-size" in done.stderr
