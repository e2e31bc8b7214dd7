"""A film and a table of poses are a recording."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from probewatch.drivers.errors import RecordingError
from probewatch.drivers.recordings.film import Film
from probewatch.drivers.recordings.pose_table import POSE_COLUMNS, PoseTable, write_poses
from probewatch.drivers.recordings.replay import open_recording
from probewatch.drivers.recordings.sequence import read_sequence
from probewatch.drivers.rigid import rotation_from_vector
from probewatch.drivers.samples import Frame, Pose, PoseStatus
from tests.support.recordings import picture, turn

SIZE_PX = (64, 48)
FPS = 25
DATA = Path(__file__).parents[2] / "data"


def film(path: Path, count: int = 10) -> Path:
    """Lossless: FFV1 in Matroska."""
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), FPS, SIZE_PX, False)
    assert writer.isOpened()
    for index in range(count):
        writer.write(picture(index, SIZE_PX))
    writer.release()
    return path


def rows(count: int = 20):
    for index in range(count):
        matrix = turn(0.1 * index, index / 3)
        cells = {f"m{row}{column}": repr(float(matrix[row, column])) for row in range(3) for column in range(4)}
        yield {"t_s": 0.01 + index / 50, "sequence": 7 + index, "status": "ok" if index != 3 else "not seen", **cells}


def test_a_text_is_no_film_of_its_lines(tmp_path: Path) -> None:
    (tmp_path / "scan.txt").write_text("0.1;0.2;0.3\n" * 1000)
    with pytest.raises(RecordingError, match="is text, which would be drawn as pictures"):
        Film(tmp_path / "scan.txt")


def test_pictures_and_poses_come_in_order_of_time(tmp_path: Path) -> None:
    table = tmp_path / "poses.csv"
    write_poses(table, rows())
    session = open_recording(film(tmp_path / "scan.mkv"), poses=table)
    samples = list(session.samples())
    frames = [one for one in samples if isinstance(one, Frame)]
    poses = [one for one in samples if isinstance(one, Pose)]
    assert session.size_px == SIZE_PX
    assert [one.stamp.t_ns for one in samples] == sorted(one.stamp.t_ns for one in samples)
    assert [one.stamp.t_ns for one in frames] == [pytest.approx(k * 1e9 / FPS, abs=1e6) for k in range(10)]
    for index, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.image, picture(index, SIZE_PX))
    assert [one.sequence for one in poses] == list(range(7, 27))
    assert (poses[3].status, poses[3].reason) == (PoseStatus.MISSING, "not seen")
    np.testing.assert_allclose(poses[5].matrix, turn(0.5, 5 / 3), atol=1e-12)


@pytest.mark.parametrize(
    ("word", "status", "reason"),
    [
        ("OK", PoseStatus.OK, ""),
        ("SWITCH2_IS_ON", PoseStatus.OK, ""),
        ("fault: the tracker was bumped", PoseStatus.FAULT, "the tracker was bumped"),
        ("out of volume: too far away", PoseStatus.OUT_OF_VOLUME, "too far away"),
        ("OUT_OF_VIEW", PoseStatus.MISSING, "ProbeToTracker is OUT_OF_VIEW"),
        ("missing", PoseStatus.MISSING, "missing"),
        ("REQ_TIMEOUT", PoseStatus.STALE, "ProbeToTracker is REQ_TIMEOUT"),
        ("behind the drape", PoseStatus.MISSING, "behind the drape"),
        ("1", PoseStatus.MISSING, "the status is '1', not 'ok'"),
        ("True", PoseStatus.MISSING, "the status is 'True', not 'ok'"),
    ],
)
def test_a_status_in_a_table_is_ours_a_word_of_plus_or_else_why_there_is_none(
    tmp_path: Path, word: str, status: PoseStatus, reason: str
) -> None:
    table = tmp_path / "poses.csv"
    table.write_text(f"t_s,status,x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,{word},1,2,3,1,0,0,0\n1,ok,1,2,3,1,0,0,0\n")
    reading = PoseTable(table).transform(0, "ProbeToTracker")
    assert (reading.status, reading.reason) == (status, reason)


@pytest.mark.parametrize("words", [("VISIBLE", "VISIBLE"), ("1", "0"), ("visible", "hidden"), ("true", "missing")])
def test_a_table_whose_own_words_leave_no_pose_is_refused_with_what_to_write(
    tmp_path: Path, words: tuple[str, str]
) -> None:
    """Each line was "no pose", with the reason "1" and without a remedy."""
    table = tmp_path / "poses.csv"
    lines = "".join(f"{n},{word},1,2,3,1,0,0,0\n" for n, word in enumerate(words))
    table.write_text(f"t_s,status,x_mm,y_mm,z_mm,qw,qx,qy,qz\n{lines}")
    with pytest.raises(RecordingError, match="no line whose status is ok") as refused:
        PoseTable(table)
    assert repr(words[0]) in refused.value.what
    assert "Write ok where the tracker saw the tool, or leave the column out" in refused.value.advice


def test_a_table_in_which_the_tool_was_never_seen_is_no_mistake(tmp_path: Path) -> None:
    table = tmp_path / "poses.csv"
    table.write_text("t_s,status,x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,missing,,,,,,,\n1,OUT_OF_VIEW,,,,,,,\n")
    assert [PoseTable(table).transform(n, "ProbeToTracker").matrix for n in range(2)] == [None, None]


def test_quaternions_are_poses_too(tmp_path: Path) -> None:
    table = tmp_path / "poses.csv"
    half = 0.3
    table.write_text(
        "t_s,x_mm,y_mm,z_mm,qw,qx,qy,qz,note\n"
        f"0,1,2,3,{np.cos(half)},0,{np.sin(half)},0,x\n0.1,1,2,3,1,0,0,0,\n0.2,1,2,3,0,0,0,0,\n0.3,1,2,3,{-np.cos(half)},0,{-np.sin(half)},0,\n"
    )
    read = PoseTable(table)
    turned = np.eye(4)
    turned[:3, :3], turned[:3, 3] = rotation_from_vector(np.array([0, 2 * half, 0])), (1, 2, 3)
    np.testing.assert_allclose(read.transform(0, "ProbeToTracker").matrix, turned, atol=1e-12)
    np.testing.assert_allclose(read.transform(1, "ProbeToTracker").matrix[:3, :3], np.eye(3))
    assert read.transform(2, "ProbeToTracker").status is PoseStatus.NOT_UNDERSTOOD, "no rotation"
    np.testing.assert_allclose(read.transform(3, "ProbeToTracker").matrix, turned, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "is empty"),
        ("t_s,m00\n0,1\n", "has the columns t_s, m00"),
        (",".join(POSE_COLUMNS) + "\nnoon,1,ok" + ",0" * 12 + "\n", "line 2, t_s 'noon' is not a number"),
        (",".join(POSE_COLUMNS) + "\n0,1,ok,1_0" + ",0" * 11 + "\n", "line 2, m00 '1_0' is not a number"),
        (",".join(POSE_COLUMNS) + "\n0,1,ok,x" + ",0" * 11 + "\n", "line 2, m00 'x' is not a number"),
        (",".join(POSE_COLUMNS) + "\n1e300,1,ok" + ",0" * 12 + "\n", "not a time"),
        (",".join(POSE_COLUMNS) + "\n0,1\n", "line 2 ends before m00"),
        (",".join(POSE_COLUMNS) + "\n\n\n0,1,ok,," + ",0" * 10 + "\n", "line 4, m00 is empty"),
        (",".join(POSE_COLUMNS) + "\n0,1,ok" + ",0" * 13 + "\n", "line 2 has 16 values, and there are 15 headings"),
        ("t_s," + ",".join(POSE_COLUMNS) + "\n" + ",0" * 15 + "\n", "has the column t_s twice"),
        (",".join(POSE_COLUMNS) + "\n", "has headings and no line of values"),
        (",".join(POSE_COLUMNS).replace("m11", "q11") + "\n" + ",0" * 14 + "\n", "lacks the column m11"),
    ],
)
def test_a_table_that_is_none_is_refused_by_line_and_column(tmp_path: Path, text: str, what: str) -> None:
    table = tmp_path / "poses.csv"
    table.write_text(text)
    with pytest.raises(RecordingError, match=what):
        list(open_recording(film(tmp_path / "scan.mkv", 2), poses=table).samples())


def test_a_film_that_is_none_or_has_no_poses_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scan.mp4"
    path.write_bytes(b"\x00\x00\x00\x18ftypmp42" + bytes(100))
    with pytest.raises(RecordingError, match=r"cannot be decoded as a film|holds no pictures"):
        open_recording(path, poses=path)
    with pytest.raises(RecordingError, match="--poses"):
        open_recording(film(tmp_path / "scan.mkv", 2))


@pytest.mark.parametrize(
    "text", ["ffconcat version 1.0\nfile other.mkv\n", "#EXTM3U\n#EXTINF:1,\nother.mkv\n", "RIFF\nc=IN IP4 127.0.0.1\n"]
)
def test_a_list_that_names_films_is_none(tmp_path: Path, text: str) -> None:
    """FFmpeg follows some of these by itself; nothing but containers of pictures is given to it."""
    film(tmp_path / "other.mkv", 2)
    path = tmp_path / "scan.mp4"
    path.write_text(text)
    with pytest.raises(RecordingError, match=r"cannot be decoded as a film|is no film"):
        read_sequence(path)


def test_a_sequence_number_of_thousands_of_digits_is_none(tmp_path: Path) -> None:
    table = tmp_path / "poses.csv"
    table.write_text(f"t_s,x_mm,y_mm,z_mm,qw,qx,qy,qz,sequence\n0,1,2,3,1,0,0,0,{'1' * 5000}\n")
    assert PoseTable(table).sequence(0) == 0


def test_a_film_of_more_pixels_than_any_scanner_has_is_refused_before_one_is_read(tmp_path: Path) -> None:
    """Three pictures of 15000 × 15000 in a film of 8 MB took 2.6 GB."""
    path = tmp_path / "huge.avi"
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"MJPG"), FPS, (6000, 6000), False)
    writer.write(np.zeros((6000, 6000), np.uint8))
    writer.release()
    with pytest.raises(RecordingError, match="6000 × 6000 pixels"):
        read_sequence(path)


@pytest.mark.parametrize(
    ("text", "said", "remedy"),
    [
        ("", "is empty", "Copy it again"),
        ("t_s;x_mm;y_mm;z_mm;qw;qx;qy;qz\n0;1;2;3;1;0;0;0\n", "by semicolons", "commas"),
        ("t_s\tx_mm\ty_mm\tz_mm\tqw\tqx\tqy\tqz\n", "by tabs", "commas"),
        ("0.1,1,2,3,1,0,0,-1e-3\n0.2,1,2,3,1,0,0,0\n", "not with a line of headings", "t_s, x_mm"),
        ("0.1,ok,1,2,3,1,0,0,0\n0.2,ok,1,2,3,1,0,0,0\n", "not with a line of headings", "t_s, x_mm"),
        ("sep=,\nt_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n", "the line 'sep='", "Take that line out"),
        ("# by hand, mm\nt_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n", "the line '# by hand'", "Take that line out"),
        ("sep=;\nt_s;x_mm\n", "by semicolons", "commas"),
        ("PK\x03\x04\n", "a spreadsheet (XLSX)", "as CSV"),
        ("time,x,y,z,qw,qx,qy,qz\n0,1,2,3,1,0,0,0\n", "has the columns time, x, y, z, qw, qx, qy, qz", "Name them t_s"),
    ],
)
def test_a_table_without_its_headings_is_told_by_what_it_has(tmp_path: Path, text: str, said: str, remedy: str) -> None:
    table = tmp_path / "poses.csv"
    table.write_text(text)
    with pytest.raises(RecordingError) as told:
        PoseTable(table)
    assert said in told.value.what
    assert remedy in told.value.remedy


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("scan.mp4", "ffconcat version 1.0\nfile other.mkv\n"),
        ("scan.m3u8", "#EXTM3U\n#EXT-X-TARGETDURATION:3\n#EXTINF:2.0,\nother.mkv\n#EXT-X-ENDLIST\n"),
        ("scan.mkv", "ID3\3\0\0\0\0\0\0#EXTM3U\n#EXTINF:2.0,\nother.mkv\n"),
    ],
)
def test_a_list_of_films_shows_no_file_that_lies_elsewhere(tmp_path: Path, name: str, text: str) -> None:
    """Reports of a recording are handed on, so they must hold no pictures of a file that was not given."""
    (tmp_path / "elsewhere").mkdir()
    film(tmp_path / "elsewhere" / "other.mkv")
    (tmp_path / "other.mkv").symlink_to(tmp_path / "elsewhere" / "other.mkv")
    (tmp_path / name).write_text(text)
    with pytest.raises(RecordingError, match="is a list of other files"):
        Film(tmp_path / name)


@pytest.mark.parametrize("name", ["concat:other.mkv|other.mkv", "subfile,,start,0,end,0,,:other.mkv", "shot%03d.png"])
def test_a_name_that_stands_for_other_files_shows_none_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """What stands before a colon is a protocol to FFmpeg: one that connects to other computers as well."""
    monkeypatch.chdir(tmp_path)
    film(Path("other.mkv"))
    cv2.imwrite("shot000.png", np.zeros((32, 32), np.uint8))
    Path(name).write_bytes(b"received by mail")
    with pytest.raises(RecordingError, match=r"cannot be decoded as a film|stands for the numbers of other files"):
        Film(Path(name))


def test_a_film_may_have_a_colon_and_a_percent_in_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    film(tmp_path / "scan.mkv").rename("10:30 gain 50%.mkv")
    assert len(Film(Path("10:30 gain 50%.mkv"))) == 10


@pytest.mark.parametrize(("quaternion", "length"), [("0,0,0,0", "0"), ("0.5,0,0,0", "0.5"), ("3,4,0,0", "5")])
def test_a_quaternion_of_another_length_is_told_by_it(tmp_path: Path, quaternion: str, length: str) -> None:
    table = tmp_path / "poses.csv"
    table.write_text(
        f"t_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,1,2,3,{quaternion}\n0.1,1,2,3,1.05,0,0,0\n0.2,1,2,3,nan,0,0,0\n"
    )
    wrong, rounded, unknown = (PoseTable(table).transform(index, "ProbeToTracker") for index in range(3))
    assert wrong.reason.startswith(f"ProbeToTracker has a quaternion of length {length}, not 1")
    assert (wrong.matrix, wrong.status) == (None, PoseStatus.NOT_UNDERSTOOD)
    assert rounded.matrix is not None
    assert unknown.reason == "ProbeToTracker is not finite"


@pytest.mark.parametrize(
    ("head", "line", "said"),
    [
        (
            "",
            "0,MISSING,2,3,1,0,0,0",
            "x_mm 'MISSING' is not a number. Where the tracker saw nothing leave the line out",
        ),
        ("", '0,"1,493.5",2,3,1,0,0,0', "x_mm '1,493.5' is not a number. Write it with a decimal point and no other"),
        ("", "0,1 mm,2,3,1,0,0,0", "x_mm '1 mm' is not a number. Mend this line"),
        ("t_ms,", "", "lacks the column t_s; it has t_ms. Name its columns t_s and .* in seconds and mm"),
    ],
)
def test_what_is_wrong_in_a_table_has_its_own_remedy(tmp_path: Path, head: str, line: str, said: str) -> None:
    table = tmp_path / "poses.csv"
    table.write_text(f"{head or 't_s,'}x_mm,y_mm,z_mm,qw,qx,qy,qz\n{line}\n")
    with pytest.raises(RecordingError, match=said):
        PoseTable(table).transform(0, "ProbeToTracker")


def test_empty_cells_behind_the_last_heading_are_passed_over(tmp_path: Path) -> None:
    table = tmp_path / "poses.csv"
    table.write_text("t_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,1,2,3,1,0,0,0,,\n")
    assert PoseTable(table).transform(0, "ProbeToTracker").matrix is not None


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_a_table_in_utf_16_is_told_as_that(tmp_path: Path, encoding: str) -> None:
    table = tmp_path / "poses.csv"
    table.write_bytes("t_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,1,2,3,1,0,0,0\n".encode(encoding))
    with pytest.raises(RecordingError, match="is UTF-16 text, not UTF-8"):
        PoseTable(table)


def test_headings_in_capitals_and_empty_lines_of_a_spreadsheet_are_read(tmp_path: Path) -> None:
    table = tmp_path / "poses.csv"
    table.write_text("T_s,X_mm,Y_mm,Z_mm,Qw,Qx,Qy,Qz\n0,1,2,3,1,0,0,0\n,,,,,,,\n0.5,1,2,3,1,0,0,0\n,,,,,,,\n")
    read = PoseTable(table)
    assert [read.stamp_ns(index) for index in range(len(read))] == [0, 500_000_000]


@pytest.mark.parametrize(("cell", "said"), [("2026-01-01T10:00", "Give seconds as numbers"), ("", "a column status")])
def test_a_time_that_is_none_is_told_with_what_to_write(tmp_path: Path, cell: str, said: str) -> None:
    table = tmp_path / "poses.csv"
    table.write_text(f"t_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n{cell},1,2,3,1,0,0,0\n")
    with pytest.raises(RecordingError, match=said):
        PoseTable(table).stamp_ns(0)


@pytest.mark.parametrize(
    ("name", "said", "remedy"),
    [
        ("interlaced.mkv", "gives one and the same picture 4 times: it is interlaced, or was frozen", "-vf yadif"),
        ("av1.mkv", "counts 4 pictures, none of which can be decoded here (codec AV01)", "-c:v ffv1"),
    ],
)
def test_a_film_that_cannot_be_decoded_is_told_by_its_kind(name: str, said: str, remedy: str) -> None:
    """The interlaced one was judged, by what the memory held."""
    with pytest.raises(RecordingError) as told:
        Film(DATA / name)
    assert said in told.value.what
    assert remedy in told.value.remedy
    assert name in told.value.remedy


def test_a_film_of_varying_rate_is_not_cut(tmp_path: Path) -> None:
    """Matroska counts by the duration: a film that pauses has fewer pictures than that."""
    path = tmp_path / "slow.mkv"
    path.write_bytes((DATA / "varying.mkv").read_bytes())
    slow = Film(path)
    assert (len(slow), slow.lacking) == (8, 0)
    assert [round(slow.stamp_ns(index) / 1e6) for index in range(8)] == [0, 40, 80, 120, 2000, 2040, 2080, 2120]


def test_12_bits_in_pixels_of_16_are_no_black_picture(tmp_path: Path) -> None:
    with pytest.raises(RecordingError) as told:
        Film(DATA / "grey12in16.mkv")
    assert "has pixels of 16 bits, none of which comes to a quarter of white" in told.value.what
    assert "8 bits" in told.value.remedy


def test_a_film_that_is_frozen_for_a_while_is_read(tmp_path: Path) -> None:
    writer = cv2.VideoWriter(
        str(tmp_path / "a.mkv"), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), FPS, SIZE_PX, False
    )
    for index in range(6):
        writer.write(picture(index // 5, SIZE_PX))
    writer.release()
    assert len(Film(tmp_path / "a.mkv")) == 6


def test_a_film_that_has_lost_its_end_says_how_many_pictures(tmp_path: Path) -> None:
    """Half of it was judged as if it were all."""
    whole, table = film(tmp_path / "whole.mkv", 60), tmp_path / "poses.csv"
    write_poses(table, rows(150))
    assert open_recording(whole, poses=table).left_out == {}
    (tmp_path / "cut.mkv").write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    cut = open_recording(tmp_path / "cut.mkv", poses=table)
    there = len(cut.frame_order)
    assert 20 < there < 40
    assert cut.left_out == {"the film is cut: its header counts more pictures": 60 - there}
