"""`probewatch replay` of black boxes, of several recordings, and its page."""

import json
import os
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.limits import Limits
from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.appliance.types import Calibration
from probewatch.drivers.errors import ConfigurationError, RecordingError
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from probewatch.drivers.recordings.nrrd import write_nrrd
from probewatch.drivers.samples import Frame, Stamp
from probewatch.drivers.twins.scene.world import WorldSettings
from probewatch.tools.commands.replay import command
from probewatch.tools.shared.found_recordings import found as found_recordings
from tests.support.black_boxes import record
from tests.support.recordings import REPLAYED_PX, items
from tests.support.sessions import kept, session

SMALL = WorldSettings(width_px=400, height_px=300, scale_mm_per_px=(0.09, 0.08))


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> Path:
    world = kept(3, settings=SMALL)
    reference = calibration_from_image_to_probe(world.image_to_probe, (400, 300))
    folder = tmp_path_factory.mktemp("box")
    record(folder / "scan.mcap", EstimatorSettings(1, reference, Limits(), 500_000_000), session(world, 5.0))
    write_calibration(folder / "probe.toml", reference, {})
    return folder / "scan.mcap"


def said(*arguments: object) -> str:
    """All of it."""
    return told(*arguments)[0]


def told(*arguments: object) -> tuple[str, Any]:
    """Text and JSON."""
    result = CliRunner().invoke(command, [str(one) for one in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output, json.loads(result.stdout) if "--json" in arguments else None


@pytest.mark.thorough
def test_a_black_box_is_judged_by_its_own_reference_and_compared(box: Path) -> None:
    text, report = told(box, "--json")
    assert "all 150 verdicts are those of the live run, bit for bit" in text
    assert report["black_box"]["bit_for_bit"] is True
    assert report["black_box"]["recorded_verdicts"] == report["black_box"]["equal_verdicts"] == 150
    assert report["frames"] == 150


def test_what_was_told_live_stands_beside_what_is_told_now(tmp_path: Path) -> None:
    """Each change of it, once; the same state told again is no change."""
    reference = Calibration(np.eye(3), (1, 1), np.array([0.2, 0.2]), np.zeros(3), REPLAYED_PX)
    frames = [Frame(Stamp(n * 100_000_000, 0), n, item.image) for n, item in enumerate(items(20, REPLAYED_PX))]
    said_live = [
        ("not verified", None, "too little"),
        ("not verified", None, "still"),
        ("halt", "polarity", "mirrored"),
    ]
    live = {5 * n: {"state": s, "fault": f, "reason": r} for n, (s, f, r) in enumerate(said_live)}
    record(tmp_path / "a.mcap", EstimatorSettings(1, reference, Limits(), 500_000_000), frames, told=live)
    page = tmp_path / "r.html"
    text, report = told(tmp_path / "a.mcap", "--json", "--html", page)
    bars = page.read_text().partition('aria-label="states as reported live over time"')[2].partition("</svg>")[0]
    assert re.findall(r'<rect class="(\w+)"[^>]*><title>([^<]*)', bars) == [
        ("wait", "0.0 s not verified: too little"),
        ("bad", "1.0 s halt: mirrored"),
    ], "on the axis of what is told now"
    assert report["black_box"]["told_live"] == [
        {"t_s": 0.0, "state": "not verified", "fault": None, "reason": "too little"},
        {"t_s": 1.0, "state": "halt", "fault": "polarity", "reason": "mirrored"},
    ]
    assert "1.00 s  reported live: halt: mirrored" in text
    assert "State as reported live" in page.read_text()


@pytest.mark.thorough
def test_with_a_calibration_it_is_judged_by_that_one(box: Path) -> None:
    text = said(box, "--calibration", box.with_name("probe.toml"), "--inject", "freeze-video@3")
    assert "FAULT · frozen-video" in text
    assert "live run" not in text


@pytest.mark.thorough
def test_a_cut_black_box_says_where(box: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(box.read_bytes()[: box.stat().st_size // 2])
    text = said(cut)
    assert "damaged: cut.mcap ends at byte" in text
    assert "bit for bit" in text


@pytest.mark.thorough
def test_the_page_shows_what_was_missing_and_loads_nothing(box: Path, tmp_path: Path) -> None:
    page = tmp_path / "scan.html"
    said(box, "--html", page)
    text = page.read_text()
    assert not re.search(r"(src|href)=[\"']?(?!data:)", text.replace('src="data:', ""))
    for words in ("What was missing", "Coverage", "picture", "tracker", "First picture", "bit for bit", "<polyline"):
        assert words in text, words
    ways = re.findall(r'<polyline class="(a|b)"', text)
    assert ways.count("a") > 2
    assert ways.count("b") >= 2


@pytest.fixture
def archive(box: Path, tmp_path: Path) -> Path:
    """Two sequences, a black box, and a file that is none."""
    folder = tmp_path / "archive"
    folder.mkdir()
    write_metaimage(folder / "one.igs.mha", items(40, REPLAYED_PX), REPLAYED_PX)
    write_nrrd(folder / "two.nrrd", items(40, REPLAYED_PX), REPLAYED_PX)
    shutil.copy(box, folder / "three.mcap")
    (folder / "four.mcap").write_bytes(box.read_bytes()[:40])
    (folder / "five.mha").write_text("ObjectType = Image\n")
    return folder


@pytest.mark.thorough
def test_a_folder_becomes_a_table_in_which_each_has_its_row(archive: Path) -> None:
    text, report = told(archive, "--json")
    assert "four.mcap" in text, "what cannot be read is told"
    rows = {Path(row["recording"]).name: row for row in report["recordings"]}
    assert set(rows) == {"one.igs.mha", "two.nrrd", "three.mcap", "five.mha"}
    assert rows["three.mcap"]["live"] == "150 of 150"
    assert "calibration is not known" in rows["one.igs.mha"]["error"]


@pytest.mark.thorough
def test_with_a_calibration_all_are_judged_and_pictures_of_either_kind_alike(archive: Path, tmp_path: Path) -> None:
    calibration = tmp_path / "probe.toml"
    write_calibration(calibration, Calibration(np.eye(3), (1, 1), np.array([0.2, 0.2]), np.zeros(3), REPLAYED_PX), {})
    recordings = archive / "one.igs.mha", archive / "two.nrrd"
    one, two = told(*recordings, "--calibration", calibration, "--json")[1]["recordings"]
    own = dict.fromkeys(["recording", "recording_sha256", "recording_state"], "")
    assert {**one, **own} == {**two, **own}
    assert one["frames"] == "40"


@pytest.mark.thorough
def test_what_cannot_be_meant_is_refused(box: Path, archive: Path, tmp_path: Path) -> None:
    runner = CliRunner()
    assert "Missing option '--calibration'" in runner.invoke(command, [str(archive / "one.igs.mha")]).output
    assert "needs --calibration" in runner.invoke(command, [str(box), "--inject", "freeze-video"]).output
    assert "--estimate needs" in runner.invoke(command, [str(box), "--estimate", str(tmp_path / "x.toml")]).output
    several = [str(archive), "--html", str(tmp_path / "x.html")]
    assert "--html is for one recording" in runner.invoke(command, several).output
    (tmp_path / "empty").mkdir()
    assert isinstance(runner.invoke(command, [str(tmp_path / "empty")]).exception, ConfigurationError)
    assert isinstance(runner.invoke(command, [str(archive / "four.mcap")]).exception, RecordingError)


@pytest.mark.thorough
@pytest.mark.parametrize("option", [("--probe", "Stylus"), ("--reference", "Tracker"), ("--orientation", "UN")])
def test_an_option_that_does_nothing_for_a_black_box_is_refused(box: Path, option: tuple[str, str]) -> None:
    result = CliRunner().invoke(command, [str(box), *option])
    assert result.exit_code == 2
    assert f"{option[0]} is for sequences and films" in result.output


def test_a_link_that_leads_nowhere_and_a_pipe_in_a_folder_are_told(tmp_path: Path) -> None:
    """Left out without a word, a recording that was moved away would be missed by nobody."""
    folder = tmp_path / "archive"
    folder.mkdir()
    (folder / "gone.igs.mha").symlink_to(tmp_path / "moved.igs.mha")
    os.mkfifo(folder / "pipe.mcap")
    (folder / "empty.nhdr").touch()
    (folder / "folder.mha").mkdir()
    found, refused = found_recordings([folder])
    assert [one.name for one in found if isinstance(one, Path)] == ["empty.nhdr", "gone.igs.mha", "pipe.mcap"]
    assert not refused
    result = CliRunner().invoke(command, [str(folder), "--json"])
    rows = {Path(row["recording"]).name: row["error"] for row in json.loads(result.stdout)["recordings"]}
    assert "No such file" in rows["gone.igs.mha"]
    assert "a pipe" in rows["pipe.mcap"]


@pytest.mark.parametrize("content", [b"", b"no recording"])
def test_a_file_with_the_name_of_a_black_box_that_is_none_is_told_as_such(tmp_path: Path, content: bytes) -> None:
    """An empty one, as a power cut leaves, was told to need --calibration."""
    (tmp_path / "cut.mcap").write_bytes(content)
    result = CliRunner().invoke(command, [str(tmp_path / "cut.mcap")])
    assert isinstance(result.exception, RecordingError), result.output
    assert str(result.exception).startswith(f"{tmp_path}/cut.mcap: is not an MCAP file")
