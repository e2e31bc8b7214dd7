"""`probewatch recalibrate`: refusals in one line, the file it writes, and what it asks of a service."""

import hashlib
import io
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from probewatch.appliance.service.control.server import ControlRefused, Peer
from probewatch.appliance.storage.calibration_file import read_calibration, write_calibration
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe, image_to_probe
from probewatch.drivers.recordings.metaimage_writing import SequenceItem, write_metaimage
from probewatch.drivers.twins.scene.world import World, WorldSettings
from tests.support import stores
from tests.support.answering import Answers
from tests.support.answers import Answer, answered
from tests.support.stores import configuration, log, settled

pytestmark = [pytest.mark.thorough, pytest.mark.usefixtures("log")]
__all__ = ["log"]

SIZE_PX = (320, 240)
START_NS = 7_000_000_000
PROPOSAL = {"text": "hardly", "confirm": False, "sha256": "new"}
PERIOD_NS = 1_000_000_000 // 30
TRUE_OFFSET_MM = np.array([11.0, 62.0, 14.0])


def world(seed: int, program: str = "freehand") -> World:
    return World(seed, program, "cross-wire", WorldSettings(*SIZE_PX))


def record(path: Path, seen: World, pictures: int) -> Path:
    """A PLUS sequence in which each picture carries its own pose."""
    items = []
    for index in range(pictures):
        t_s = index / 30
        pose = seen.measured_pose(t_s, index)
        items.append(SequenceItem(START_NS + index * PERIOD_NS, seen.frame(t_s, index), {"ProbeToTracker": pose}))
    write_metaimage(path, items, SIZE_PX)
    return path


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("scan") / "scan.igs.mha", world(3), 330)


def calibration_file(folder: Path, *shift_mm: float, size_px: tuple[int, int] = SIZE_PX) -> Path:
    true = calibration_from_image_to_probe(world(1).image_to_probe, SIZE_PX)
    moved = replace(true, offset_mm=true.offset_mm + np.array(shift_mm), image_size_px=size_px)
    file = folder / "probe.toml"
    write_calibration(file, moved, {"who": "a test"})
    return file


def recalibrated(*arguments: object) -> Answer:
    return answered("recalibrate", *arguments)


def test_a_recorded_scan_becomes_a_calibration_with_provenance(tmp_path, scan) -> None:
    old = calibration_file(tmp_path, 0, 0, -6)
    new = tmp_path / "new.toml"
    shown = recalibrated("--recording", scan, "--calibration", old, "--output", new)
    assert shown.returncode == 0
    assert "330 pictures" in shown.stdout
    assert "tilt spread: 1" in shown.stdout
    file = tomllib.loads(new.read_text())
    said = file["provenance"]
    assert said["previous_sha256"] == hashlib.sha256(old.read_bytes()).hexdigest()
    assert (said["previous_file"], said["input"]) == (str(old), str(scan))
    assert said["views"].endswith("used, 0 rejected")
    value, sigma, before = (float(said["solved"].split()[index].rstrip(",")) for index in (2, 4, 7))
    assert before == pytest.approx(8.0)
    assert abs(value - 14) < 2.5 * sigma < 0.5
    offset_mm = read_calibration(new).offset_mm
    np.testing.assert_allclose(offset_mm[:2], TRUE_OFFSET_MM[:2], atol=1e-9)
    assert offset_mm[2] == pytest.approx(value, abs=1e-4)


def test_a_slid_marker_is_noticed_and_then_solved(tmp_path, scan) -> None:
    old = calibration_file(tmp_path, 5, -6, 4)
    new = tmp_path / "new.toml"
    arguments = ("--recording", scan, "--calibration", old, "--output", new)
    assert "--solve offset" in refusal(65, *arguments)
    assert not new.exists()
    assert recalibrated(*arguments, "--solve", "offset").returncode == 0
    np.testing.assert_allclose(read_calibration(new).offset_mm, TRUE_OFFSET_MM, atol=0.5)


def test_the_new_name_is_dated_and_an_existing_file_is_spared(tmp_path, scan) -> None:
    old = calibration_file(tmp_path, 0, 0, -6)
    before = old.read_bytes()
    arguments = ("--recording", scan, "--calibration", old)
    assert "probe.toml: exists already. Give --output another name" in refusal(78, *arguments, "--output", old)
    assert old.read_bytes() == before
    assert recalibrated(*arguments).returncode == 0
    (dated,) = tmp_path.glob("probe-20*Z.toml")
    assert recalibrated(*arguments, "--output", old, "--force").returncode == 0
    np.testing.assert_array_equal(read_calibration(old).offset_mm, read_calibration(dated).offset_mm)


def refusal(code: int, *arguments: object) -> str:
    shown = recalibrated(*arguments)
    assert shown.returncode == code
    assert "Traceback" not in shown.stderr
    return shown.stderr


@pytest.mark.parametrize(
    ("program", "pictures", "says"),
    [
        ("still", 30, "no passage through the crossing was found"),
        ("freehand", 120, "usable views of the crossing, 8 are needed"),
    ],
)
def test_a_scan_without_enough_passages_is_refused(tmp_path, program, pictures, says) -> None:
    recording = record(tmp_path / "scan.igs.mha", world(1, program), pictures)
    old = calibration_file(tmp_path, 0, 0, 0)
    error = refusal(65, "--recording", recording, "--calibration", old)
    assert error.count("\n") == 1
    assert says in error
    assert list(tmp_path.glob("probe-*")) == []


def test_a_sigma_that_the_scan_does_not_reach_is_refused(tmp_path, scan) -> None:
    old = calibration_file(tmp_path, 0, 0, 0)
    error = refusal(65, "--recording", scan, "--calibration", old, "--sigma-mm", 0.01)
    assert "± 0.01 mm is asked (ζ needs" in error
    assert list(tmp_path.glob("probe-*")) == []


def test_what_cannot_be_meant_is_refused(tmp_path, scan) -> None:
    old = calibration_file(tmp_path, 0, 0, 0)
    other = calibration_file(tmp_path / "..", 0, 0, 0, size_px=(640, 480))
    cases = [
        (2, "either --recording FILE or --simulated", ()),
        (2, "either --recording FILE or --simulated", ("--simulated", "--recording", scan)),
        (2, "give the calibration in force", ("--recording", scan)),
        (65, "nothere.mha", ("--recording", "nothere.mha", "--calibration", old)),
        (78, "none.toml", ("--recording", scan, "--calibration", tmp_path / "none.toml")),
        (78, "(320, 240)", ("--recording", scan, "--calibration", other)),
        (78, "folder that exists", ("--recording", scan, "--calibration", old, "--output", tmp_path / "no" / "x.toml")),
        (78, "none.toml", ("--simulated", "--config", tmp_path / "none.toml")),
        (69, "no service answers", ("--recording", scan, "--calibration", old, "--socket", tmp_path / "control")),
    ]
    for code, says, arguments in cases:
        assert says in refusal(code, *arguments), arguments


def test_a_device_set_is_recalibrated_too(tmp_path, scan) -> None:
    """It does not state the size of its pictures; the scan does."""
    before = read_calibration(calibration_file(tmp_path, 0, 0, -6))
    matrix = " ".join(repr(float(number)) for number in image_to_probe(before).ravel())
    transform = f'<Transform From="Image" To="Probe" Matrix="{matrix}"/>'
    device_set = tmp_path / "set.xml"
    device_set.write_text(f"<P><CoordinateDefinitions>{transform}</CoordinateDefinitions></P>")
    assert recalibrated("--recording", scan, "--calibration", device_set).returncode == 0
    (dated,) = tmp_path.glob("set-20*Z.toml")
    after = read_calibration(dated)
    assert after.image_size_px == SIZE_PX
    np.testing.assert_allclose(after.offset_mm, TRUE_OFFSET_MM, atol=0.5)


def test_a_simulated_scan_marks_its_calibration(tmp_path) -> None:
    new = tmp_path / "new.toml"
    answer = recalibrated("--simulated", "--duration", 11, "--output", new)
    assert answer.returncode == 0
    assert read_calibration(new).simulated
    assert answer.stderr.startswith("looking at simulated world, seed 1: 880 pictures and poses\n"), "no bar in a pipe"


class Scripted(Answers):
    """A control socket that grants everything but `declined`, and after the end of the scan is in `state`.

    asked: all requests but those for the status.
    """

    def __init__(self, path: Path, state: str, declined: str = "", simulated: tuple[str, ...] = ()) -> None:
        super().__init__(path)
        self.asked: list[str] = []
        self._state, self._declined, self._simulated = state, declined, simulated

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        if do != "status":
            self.asked.append(do)
        if do == self._declined:
            raise ControlRefused("not possible while halt")
        status = {"state": self._state, "reason": "scripted", "simulated": [*self._simulated]}
        return {"status": status, "proposal": PROPOSAL}


class GoesBack(Scripted):
    """As one behind a latched halt that, after one status of the new reference, has lost a device and gone back."""

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        if do == "end-recalibration":
            self._state = "recalibrating"
        answer = super()._answer(do, request, who)
        number, file = (3, "/srv/new.toml") if self._state == "recalibrating" else (2, "/srv/old.toml")
        answer["status"]["reference"] = {"number": number, "file": file, "sha256": "00" * 32}
        if do == "status" and self.asked[-1:] == ["end-recalibration"]:
            self._state = "halt"
        return answer


def test_a_service_that_has_gone_back_is_no_halt_of_the_new_one(tmp_path, scan) -> None:
    """The reason of the halt before was told of the new calibration, with a remedy that cannot help."""
    old = calibration_file(tmp_path, 0, 0, 1)
    arguments = ("--recording", scan, "--calibration", old, "--socket", tmp_path / "control", "--wait", 5)
    with GoesBack(tmp_path / "control", "halt"):
        said = refusal(69, *arguments)
    assert "a device was lost before the new calibration was verified, and the one before is in force" in said
    assert "probewatch calibration use /srv/new.toml" in said
    assert "scripted" not in said


@pytest.mark.parametrize(
    ("state", "code", "says"),
    [
        ("recalibrating", 75, "not verified within 1 s: scripted. The contact stays open"),
        ("device lost", 69, "a device was lost before the new calibration was verified: scripted. The old one is"),
        ("warning", 75, "not verified, the service is in state warning: scripted"),
        ("monitoring", 0, ""),
    ],
)
def test_the_end_is_what_the_service_says(tmp_path, scan, state, code, says) -> None:
    old = calibration_file(tmp_path, 0, 0, 1)
    arguments = ("--recording", scan, "--calibration", old, "--socket", tmp_path / "control", "--wait", 1)
    with Scripted(tmp_path / "control", state) as service:
        assert says in refusal(code, *arguments)
    assert service.asked[:3] == ["begin-recalibration", "propose-calibration", "end-recalibration"]
    assert "abort-recalibration" not in service.asked


@pytest.mark.parametrize(
    ("declined", "asked"),
    [
        ("begin-recalibration", ["begin-recalibration"]),
        (
            "end-recalibration",
            ["begin-recalibration", "propose-calibration", "end-recalibration", "abort-recalibration"],
        ),
    ],
)
def test_a_service_that_declines_is_left_as_it_was(tmp_path, scan, declined, asked) -> None:
    old = calibration_file(tmp_path, 0, 0, 1)
    arguments = ("--recording", scan, "--calibration", old, "--socket", tmp_path / "control")
    with Scripted(tmp_path / "control", "halt", declined) as service:
        assert "not possible while halt" in refusal(75, *arguments)
    assert service.asked == asked


def test_a_scan_begins_with_what_is_in_force_not_with_the_configured_file(tmp_path, scan) -> None:
    (tmp_path / "of").mkdir()
    calibration_file(tmp_path, 0, 0, -6)
    now = calibration_file(tmp_path / "of", 0, 0, -2)
    config = configuration(tmp_path, more=f'control.socket = "{tmp_path}/control"\n')
    references = stores.started(config)
    references.take(references.from_content(now.read_bytes(), str(now)), "recalibration")
    settled(references)
    new = tmp_path / "new.toml"
    with Scripted(tmp_path / "control", "monitoring"):
        named = ("--config", tmp_path / "probewatch.toml", "--output", new)
        assert recalibrated("--recording", scan, *named).returncode == 0
    assert tomllib.loads(new.read_text())["provenance"]["previous_file"] == str(now)


def test_a_simulated_scan_is_not_even_begun_on_real_devices(tmp_path) -> None:
    arguments = ("--simulated", "--duration", 600, "--output", tmp_path / "new.toml", "--socket", tmp_path / "control")
    with Scripted(tmp_path / "control", "monitoring") as service:
        assert "watches real devices" in refusal(78, *arguments)
    assert service.asked == []


def test_a_far_calibration_is_written_stated_and_not_taken_without_a_person(monkeypatch, tmp_path, scan) -> None:
    old, new = calibration_file(tmp_path, 0, 0, 1), tmp_path / "new.toml"
    arguments = ("--recording", scan, "--calibration", old, "--socket", tmp_path / "control", "--output", new)
    monkeypatch.setitem(PROPOSAL, "confirm", True)
    monkeypatch.setattr("sys.stdin", io.StringIO())
    with Scripted(tmp_path / "control", "monitoring") as service:
        shown = recalibrated(*arguments)
        assert shown.returncode == 75
        assert "against the reference in force: hardly" in shown.stdout
        assert f"Give --yes to accept it; later: probewatch calibration use {new}" in shown.stderr
        assert service.asked == ["begin-recalibration", "propose-calibration", "abort-recalibration"]
        assert new.exists(), "a scan is not lost"
        assert recalibrated(*arguments, "--force", "--yes").returncode == 0
    assert "end-recalibration" in service.asked


@pytest.mark.parametrize("named", [("--config", "nothing.toml"), ("--socket", "nobody"), ()])
def test_a_service_that_is_not_there_is_told_before_anybody_is_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("click.prompt", lambda *_, **__: pytest.fail("asked, though nobody can take the answer"))
    answer = answered("recalibrate", "--live", "--solve", "all", *named)
    assert answer.returncode in (2, 69, 78), answer
    assert answer.stdout == ""


def test_a_folder_that_the_unit_cannot_see_is_refused_before_the_scan(tmp_path: Path) -> None:
    answer = answered("recalibrate", "--live", "--socket", "/run/probewatch/control", "--folder", tmp_path)
    assert (answer.returncode, "the service cannot see it" in answer.stderr) == (78, True), answer
