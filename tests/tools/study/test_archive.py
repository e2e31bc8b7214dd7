"""Archives of recordings: folders and object stores, one row each, on a Dask cluster whose scheduler may vanish."""

import csv
import hashlib
import io
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import fsspec
import numpy as np
import pytest
from click.testing import CliRunner, Result
from rich.console import Console

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.limits import Limits
from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.appliance.types import Calibration
from probewatch.drivers.errors import ConfigurationError, DeviceLost, RecordingError
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from probewatch.drivers.samples import Pose, PoseStatus, Stamp
from probewatch.tools.cli import probewatch
from probewatch.tools.study.archive import CONTENT, NOT_FETCHED, ArchiveTask, archive_table
from probewatch.tools.study.store import NotFetchedError, fetched, listed
from tests.support.black_boxes import record
from tests.support.recordings import items

SIZE_PX = (48, 32)


@pytest.fixture
def store() -> Iterator[str]:
    """An object store in the memory of this process, empty."""
    memory = fsspec.filesystem("memory")
    memory.store.clear()
    yield "memory:///archive"
    memory.store.clear()


def fill(store: str, *names: str, data: bytes = b"x") -> None:
    for name in names:
        with fsspec.open(f"{store}/{name}", "wb") as stream:
            stream.write(data)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "good.igs.mha"
    write_metaimage(path, items(40, SIZE_PX), SIZE_PX)
    return path


@pytest.fixture
def calibration(tmp_path: Path) -> Path:
    path = tmp_path / "probe.toml"
    write_calibration(path, Calibration(np.eye(3), (1, 1), np.array([0.2, 0.2]), np.zeros(3), SIZE_PX), {})
    return path


def test_a_store_is_listed_and_the_files_of_one_run_are_one_recording(store: str) -> None:
    fill(store, "b/two.MHA", "a/one.nrrd", "notes.txt", "ring/20261123T101112-ab12-00002.mcap")
    fill(store, "ring/20261123T101012-ab12-00001.mcap", "kept/20261123T101012-cd34-00001.mcap")
    assert sorted(listed(store)) == [
        (f"{store}/a/one.nrrd",),
        (f"{store}/b/two.MHA",),
        (f"{store}/kept/20261123T101012-cd34-00001.mcap",),
        (f"{store}/ring/20261123T101012-ab12-00001.mcap", f"{store}/ring/20261123T101112-ab12-00002.mcap"),
    ]
    assert listed(f"{store}/a/one.nrrd") == [(f"{store}/a/one.nrrd",)]


@pytest.mark.parametrize(
    ("url", "error", "what"),
    [
        ("memory://nothing", ConfigurationError, "holds no recordings"),
        ("nonsense://x", ConfigurationError, "cannot be reached"),
        ("sftp://user:secret@host/x", ConfigurationError, "credentials in an address"),
        ("file:///nowhere/at/all", ConfigurationError, "holds no recordings"),
    ],
)
def test_what_is_no_store_is_refused_by_name(url: str, error: type[Exception], what: str) -> None:
    with pytest.raises(error, match=what):
        listed(url)


def test_a_recording_that_does_not_come_is_no_row_to_keep(store: str) -> None:
    (row,) = ArchiveTask(f"{store}/gone.mha", None, urls=(f"{store}/gone.mha",)).rows()
    assert row["error"].startswith(NOT_FETCHED)
    with pytest.raises(NotFetchedError), fetched((f"{store}/gone.mha",)):
        pass


def test_a_copy_is_gone_when_it_is_not_needed(store: str) -> None:
    fill(store, "a.mha", data=b"12345")
    with fetched((f"{store}/a.mha",)) as (copy,):
        assert (copy.name, copy.read_bytes()) == ("a.mha", b"12345")
    assert not copy.parent.exists()


def study(*arguments: object) -> Result:
    return CliRunner().invoke(probewatch, ["study", *map(str, arguments)])


def rows_of(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "recordings.csv").read_text().splitlines()))


@pytest.mark.thorough
def test_a_store_is_studied_on_a_cluster_and_what_was_missing_is_done_later(
    store: str, recording: Path, calibration: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Workers are threads here, which share the store; nothing of the calibration's file is left for them."""
    from distributed import LocalCluster  # noqa: PLC0415  takes a second that other tests need not wait for

    fill(store, "a/good.igs.mha", "b/good.igs.mha", data=recording.read_bytes())
    fill(store, "bad.mha", data=b"no recording")
    there = list(listed(store))
    monkeypatch.setattr("probewatch.tools.commands.study.listed", lambda url: [*there, (f"{store}/late.mha",)])
    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0") as cluster:
        options = ("--calibration", calibration, "--output", tmp_path / "out", "--scheduler", cluster.scheduler_address)
        first = study(store, *options)
        assert isinstance(first.exception, DeviceLost), first.output
        assert "1 of 4 recordings could not be fetched" in str(first.exception)
        rows = {row["recording"]: row for row in rows_of(tmp_path / "out")}
        assert set(rows) == {f"{store}/{name}" for name in ("a/good.igs.mha", "b/good.igs.mha", "bad.mha")}
        assert [bool(row["error"]) for _, row in sorted(rows.items())] == [False, False, True]
        assert rows[f"{store}/a/good.igs.mha"]["frames"] == "40"
        fill(store, "late.mha", data=recording.read_bytes())
        second = study(store, *options)
    assert second.exception is None, second.output
    assert "3 of 4 recordings are in" in second.output
    assert [row["error"] for row in rows_of(tmp_path / "out") if row["recording"].endswith("late.mha")] == [""]


@pytest.mark.thorough
@pytest.mark.parametrize("how", ["{}", "file://{}"])
def test_a_folder_is_studied_by_path_and_by_address(
    how: str, recording: Path, calibration: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "archive" / "ward"
    folder.mkdir(parents=True)
    recording.rename(folder / recording.name)
    done = study(how.format(folder.parent), "--calibration", calibration, "--output", tmp_path / "out", "--jobs", 1)
    assert done.exception is None, done.output
    (row,) = rows_of(tmp_path / "out")
    assert (row["recording"], row["frames"], row["error"]) == (how.format(folder / recording.name), "40", "")


def test_a_row_is_not_kept_for_another_calibration(recording: Path, calibration: Path, tmp_path: Path) -> None:
    """Nobody would see that what stands there was judged by the calibration of last week."""
    out = "--output", tmp_path / "out", "--jobs", 1
    assert study(recording, "--calibration", calibration, *out).exit_code == 0
    (row,) = rows_of(tmp_path / "out")
    assert row["calibration_sha256"] == hashlib.sha256(calibration.read_bytes()).hexdigest()
    assert study(recording, "--calibration", calibration, *out).exit_code == 0
    calibration.write_text(calibration.read_text().replace("0.2", "0.3"))
    again = study(recording, "--calibration", calibration, *out)
    assert isinstance(again.exception, ConfigurationError)
    assert row["calibration_sha256"][:12] in str(again.exception)
    assert "--output" in str(again.exception)
    assert rows_of(tmp_path / "out") == [row]


def test_a_row_is_not_kept_for_a_recording_that_has_changed_under_its_name(
    recording: Path, calibration: Path, tmp_path: Path
) -> None:
    """It may have been cut, copied again or exported anew; a copy with the same content is the same recording."""
    out = "--output", tmp_path / "out", "--jobs", 1
    assert study(recording, "--calibration", calibration, *out).exit_code == 0
    (row,) = rows_of(tmp_path / "out")
    assert row["recording_sha256"] == hashlib.sha256(recording.read_bytes()).hexdigest()
    os.utime(recording, ns=(0, 0))
    assert study(recording, "--calibration", calibration, *out).exit_code == 0, "only the date is another"
    write_metaimage(recording, items(20, SIZE_PX), SIZE_PX)
    again = study(recording, "--calibration", calibration, *out)
    assert isinstance(again.exception, ConfigurationError), again.output
    assert f"has {recording} as it was ({row['recording_state']}); it has changed since" in str(again.exception)
    assert "Take its line out" in str(again.exception)
    assert rows_of(tmp_path / "out") == [row]


def test_names_of_tools_are_taken_as_replay_takes_them(recording: Path, calibration: Path, tmp_path: Path) -> None:
    """The row said to give --probe, which only replay took."""
    stylus = [
        replace(one, transforms={"StylusToTracker": one.transforms["ProbeToTracker"]}) for one in items(20, SIZE_PX)
    ]
    write_metaimage(recording, stylus, SIZE_PX)
    given = recording, "--calibration", calibration, "--jobs", 1, "--output"
    named = "--probe", "Stylus", "--orientation", "MF"
    assert "--probe Stylus" in str(study(*given, tmp_path / "usual").exception)
    assert "--probe Stylus" in rows_of(tmp_path / "usual")[0]["error"]
    assert study(*given, tmp_path / "out", *named).exit_code == 0
    (row,) = rows_of(tmp_path / "out")
    assert (row["error"], row["paired"], row["names"]) == ("", "20", "probe=Stylus orientation=MF")
    assert "with probe=Stylus orientation=MF, now the usual ones" in str(study(*given, tmp_path / "out").exception)
    assert "--probe is of RECORDINGs" in study("--probe", "Stylus", "--output", tmp_path / "none").output


def test_a_row_is_not_kept_where_another_file_of_the_recording_has_changed(
    recording: Path, calibration: Path, store: str
) -> None:
    """The pictures beside a header, a further file of a recorder's run, and an object of a store."""
    header = recording.with_name("apart.mhd")
    write_metaimage(header, items(40, SIZE_PX), SIZE_PX, detached=True, compressed=False)
    pictures = header.with_suffix(".raw")
    fill(store, "a.mha", data=recording.read_bytes())
    urls = (f"{store}/a.mha",)
    for task, changed in (
        (ArchiveTask(header, calibration), lambda: pictures.write_bytes(pictures.read_bytes()[::-1])),
        (ArchiveTask(urls[0], calibration, urls=urls), lambda: fill(store, "a.mha", data=b"other")),
    ):
        (row,) = task.rows()
        assert (row["error"], task.is_of(row)) == ("", True)
        changed()
        assert not task.is_of(row)
    first, second = (recording.with_name(f"run-ab12-0000{part}.mcap") for part in (1, 2))
    poses_alone(first)
    (row,) = ArchiveTask(first, None, parts=(first,)).rows()
    assert not ArchiveTask(first, None, parts=(first, poses_alone(second))).is_of(row)


@pytest.mark.parametrize(("name", "data"), [("apart.mhd", "apart.raw"), ("apart.mha", "other name.bin")])
def test_the_pictures_of_a_header_come_with_it_and_are_part_of_its_state(
    name: str, data: str, recording: Path, calibration: Path, store: str
) -> None:
    """The header came alone, so that its row said that there is no such file; other pictures beside an .mha kept its
    row.
    """
    header = recording.with_name("apart.mhd")
    write_metaimage(header, items(40, SIZE_PX), SIZE_PX, detached=True, compressed=False)
    fill(store, name, data=header.read_bytes().replace(b"= apart.raw", f"= ./{data}".encode()))
    urls = (f"{store}/{name}",)
    task = ArchiveTask(urls[0], calibration, urls=urls)
    assert task.rows()[0]["error"].startswith(f"{NOT_FETCHED}: {data}: "), "it may be there another time"
    fill(store, data, data=header.with_suffix(".raw").read_bytes())
    (row,) = task.rows()
    assert (row["error"], row["paired"], row[CONTENT]) == ("", "40", content(store, name, data))
    assert task.is_of(row)
    fill(store, data, data=header.with_suffix(".raw").read_bytes()[::-1])
    assert not task.is_of(row)


def content(store: str, *names: str) -> str:
    whole = b""
    for name in names:
        with fsspec.open(f"{store}/{name}") as stream:
            whole += stream.read()
    return hashlib.sha256(whole).hexdigest()


def poses_alone(path: Path) -> Path:
    """A black box of a cart whose scanner was off."""
    poses = [Pose(Stamp(10**9 + k * 20_000_000, 100_000), k, np.eye(4), 0.1, PoseStatus.OK) for k in range(30)]
    reference = Calibration(np.eye(3), (1, 1), np.array([0.2, 0.2]), np.zeros(3), SIZE_PX)
    record(path, EstimatorSettings(1, reference, Limits(), 500_000_000), poses)
    return path


def test_one_file_in_which_nothing_can_be_judged_ends_no_row_of_the_others(recording: Path, calibration: Path) -> None:
    """A black box without pictures, an empty one, and what only looks like one."""
    folder = recording.parent
    box = poses_alone(folder / "poses.mcap")
    (folder / "empty.mcap").write_bytes(b"")
    (folder / "cut.mcap").write_bytes(box.read_bytes()[:200])
    tasks = [ArchiveTask(recording, calibration)]
    tasks += [ArchiveTask(folder / name, None, parts=(folder / name,)) for name in ("poses.mcap", "empty.mcap")]
    good, poses, empty = (row for task in tasks for row in task.rows())
    assert (good["error"], good["frames"]) == ("", "40")
    assert (poses["error"].partition(":")[0], poses["verdict"], poses["closed"]) == (
        "nothing in it can be judged",
        "NOT_VERIFIED",
        "0",
    )
    assert empty["error"] != ""
    result = CliRunner().invoke(probewatch, ["replay", str(folder), "--calibration", str(calibration)])
    assert result.exit_code == 0, result.output
    assert all(name in result.output for name in ("good.igs.mha", "poses.mcap", "empty.mcap", "cut.mcap"))


@pytest.mark.parametrize("several", [False, True])
def test_an_archive_in_which_nothing_can_be_judged_ends_as_unusable_data(
    tmp_path: Path, calibration: Path, several: bool
) -> None:
    for name in ("a.mha", "b.mha")[: 1 + several]:
        write_metaimage(tmp_path / name, items(3, SIZE_PX), SIZE_PX)
    result = study(tmp_path, "--calibration", calibration, "--jobs", 1, "--output", tmp_path / "out")
    assert isinstance(result.exception, RecordingError)
    assert ("none of 2 can be used" in str(result.exception)) == several
    assert "nothing in it can be judged: only 3 pictures have a pose. Record pictures" in str(result.exception)
    again = CliRunner().invoke(probewatch, ["replay", str(tmp_path), "--calibration", str(calibration)])
    assert isinstance(again.exception, RecordingError)


def test_poses_alone_and_a_link_to_nothing_are_told_as_what_they_are(recording: Path, calibration: Path) -> None:
    """The calibration was accused of the first, and the second was not listed at all."""
    folder = recording.parent
    write_metaimage(folder / "poses.mha", [replace(one, image=None) for one in items(40, SIZE_PX)], None)
    (folder / "away.mha").symlink_to(folder / "not-mounted" / "away.mha")
    matrix = "0.2 0 0 -5 0 0.2 0 -3 0 0 0.2 0 0 0 0 1"
    device_set = folder / "device-set.xml"
    transform = f'<Transform From="Image" To="Probe" Matrix="{matrix}"/>'
    device_set.write_text(
        f"<PlusConfiguration><CoordinateDefinitions>{transform}</CoordinateDefinitions></PlusConfiguration>"
    )
    result = CliRunner().invoke(probewatch, ["replay", str(folder), "--calibration", str(device_set)])
    assert result.exit_code == 0, result.output
    assert "poses.mha: holds no pictures" in result.output
    assert "away.mha: cannot be read: No such file or directory" in result.output
    noise = ["noise", str(folder / "poses.mha"), "--calibration", str(device_set), "--output", str(folder / "n.toml")]
    assert "poses.mha: holds no pictures" in str(CliRunner().invoke(probewatch, noise).exception)


def test_a_defect_of_ours_costs_one_row(recording: Path, calibration: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(self: ArchiveTask) -> dict[str, str]:
        raise ValueError("zip() argument 2 is longer than argument 1")

    monkeypatch.setattr(ArchiveTask, "_said", broken)
    (row,) = ArchiveTask(recording, calibration).rows()
    assert row["error"].startswith("not judged, which is a defect of probewatch: ValueError: zip()")


def test_the_table_says_why_most_pictures_have_no_pose(recording: Path, calibration: Path) -> None:
    """What was not shown, all ten of it, says nothing of a matrix that is none."""
    unseen = [replace(item, transforms={"ProbeToTracker": np.diag([0.2, 0.2, 0.2, 1])}) for item in items(40, SIZE_PX)]
    write_metaimage(recording.parent / "scaled.igs.mha", unseen, SIZE_PX)
    result = CliRunner().invoke(probewatch, ["replay", str(recording.parent), "--calibration", str(calibration)])
    assert result.exit_code == 0, result.output
    rows = {line.split()[0]: line for line in result.stdout.splitlines() if line}
    assert "no picture has a pose: ProbeToTracker is not a rotation and a translation" in rows["scaled.igs.mha"]
    assert "no picture has a pose" not in rows["good.igs.mha"]


def test_of_what_could_not_be_judged_no_share_is_told_and_the_reason_has_a_heading() -> None:
    rows = [
        {"recording": "a", "verdict": "", "fault": "", "closed": "", "missing": "", "live": "", "error": "is cut"},
        {"recording": "b", "verdict": "OK", "fault": "", "closed": "0.25", "missing": "", "live": "", "error": ""},
    ]
    out = io.StringIO()
    Console(file=out, width=120).print(
        archive_table([{"paired": "", "frames": "", "reason": "", **row} for row in rows])
    )
    told = out.getvalue()
    assert "why" in told
    assert "25 %" in told
    assert " 0 %" not in told.replace("\t", " ")
