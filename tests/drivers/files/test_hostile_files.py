"""What is named as a file and is none, or is none of the kind: refused by name, at once, and left as it is."""

import os
import re
import stat
import time
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from probewatch.appliance.configuration.config import load_config
from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.appliance.storage.calibration_file import read_calibration, write_calibration
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError, ProbewatchError, RecordingError
from probewatch.drivers.files.atomic_file import check_writable, writing
from probewatch.drivers.io.byte_log import ByteLog, read_log
from probewatch.drivers.recordings import metaimage
from probewatch.drivers.recordings.metaimage import read_metaimage
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from probewatch.drivers.recordings.nrrd import write_nrrd
from probewatch.drivers.recordings.replay import open_recording
from probewatch.drivers.recordings.sequence import read_sequence
from probewatch.drivers.twins.tool_motion import pose_file
from probewatch.tools.commands.log import command as log_command
from probewatch.tools.commands.replay import command as replay_command
from tests.appliance.storage.test_calibration_file import calibration
from tests.support.recordings import SIZE_PX, items
from tests.support.stopwatch import Stopwatch

AT_ONCE_S = 1.0
NAMED = r"not a file|a NUL in its name|leads out of the folder"


def folder(path: Path) -> None:
    path.mkdir()


def pipe(path: Path) -> None:
    os.mkfifo(path)


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def pipe_behind_a_link(path: Path) -> None:
    os.mkfifo(path.with_name("behind"))
    path.symlink_to("behind")


def folder_behind_a_link(path: Path) -> None:
    path.with_name("behind").mkdir()
    path.symlink_to("behind")


def nul(path: Path) -> None:
    """Nothing can be there; the name itself is what is wrong."""


NO_FILES = (folder, pipe, device, pipe_behind_a_link, folder_behind_a_link, nul)


@pytest.fixture(params=NO_FILES, ids=lambda make: make.__name__)
def no_file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / ("named\0so" if request.param is nul else "named")
    request.param(path)
    return path


def refused_at_once(kind: type[ProbewatchError], use: Callable[[Path], object], path: Path) -> str:
    before = None if "\0" in str(path) else (path.lstat().st_mode, path.lstat().st_ino)
    watch = Stopwatch()
    with pytest.raises(kind, match=NAMED) as refusal:
        use(path)
    assert watch.spent_s() < AT_ONCE_S
    assert before is None or before == (path.lstat().st_mode, path.lstat().st_ino), "it is as it was"
    return str(refusal.value)


def write_csv(path: Path) -> None:
    AlarmLog(path.parent / "alarms")
    result = CliRunner().invoke(log_command, [str(path.parent / "alarms"), "--csv", str(path)])
    raise_refusal(result)


def write_report(path: Path) -> None:
    (recording := path.parent / "empty.mha").touch()
    raise_refusal(
        CliRunner().invoke(replay_command, [str(recording), "--calibration", "none.toml", "--html", str(path)])
    )


def raise_refusal(result: Result) -> None:
    assert isinstance(result.exception, ProbewatchError), result.output
    raise result.exception


WRITERS: dict[str, Callable[[Path], object]] = {
    "report of a command, before its work": write_report,
    "export": write_csv,
    "calibration": lambda path: write_calibration(path, calibration(), {}),
    "byte log": lambda path: ByteLog(path, "ndi:/dev/x", HostClock()),
    "asked beforehand": check_writable,
}


@pytest.mark.parametrize("writer", WRITERS)
def test_nothing_but_a_file_is_written_to(writer: str, no_file: Path) -> None:
    if "\0" in str(no_file) and WRITERS[writer] in (write_csv, write_report):
        return  # no argument of a command holds a NUL
    refused_at_once(ConfigurationError, WRITERS[writer], no_file)


def test_a_recording_is_written_to_a_file_only(no_file: Path) -> None:
    with pytest.raises(OSError, match=NAMED):
        write_metaimage(no_file, items(), SIZE_PX)


def test_a_device_is_not_replaced(tmp_path: Path) -> None:
    """As root, in a folder of devices: the report took the place of /dev/null."""
    node = tmp_path / "null"
    try:
        os.mknod(node, stat.S_IFCHR | 0o666, os.makedev(1, 3))
    except PermissionError:
        pytest.skip("only root makes devices")
    with pytest.raises(ConfigurationError, match="it is a device, not a file"), writing(node) as stream:
        stream.write(b"{}")
    assert stat.S_ISCHR(node.stat().st_mode)


def test_what_is_a_file_or_is_not_there_is_written(tmp_path: Path) -> None:
    file, link, new = tmp_path / "file", tmp_path / "link", tmp_path / "new"
    file.write_text("old")
    link.symlink_to("file")
    for path in (file, link, new):
        check_writable(path)
        with writing(path) as stream:
            stream.write(b"new")
        assert path.read_text() == "new"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "link", "new"]


def test_what_fails_while_it_is_written_leaves_the_old_file(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("old")

    def on_a_full_disk() -> None:
        with writing(file) as stream:
            stream.write(b"half")
            raise OSError(28, "No space left on device")

    with pytest.raises(ConfigurationError, match="No space left"):
        on_a_full_disk()
    assert (file.read_text(), [path.name for path in tmp_path.iterdir()]) == ("old", ["file"])


READERS: dict[str, tuple[type[ProbewatchError], Callable[[Path], object]]] = {
    "configuration": (ConfigurationError, load_config),
    "calibration": (ConfigurationError, lambda path: read_calibration(path, SIZE_PX)),
    "recording": (RecordingError, open_recording),
    "poses": (RecordingError, pose_file),
    "byte log": (RecordingError, read_log),
}


@pytest.mark.parametrize("reader", READERS)
def test_nothing_but_a_file_is_read(reader: str, no_file: Path) -> None:
    refused_at_once(*READERS[reader], no_file)


@pytest.mark.parametrize("compressed", [False, True])
def test_the_pictures_of_a_recording_lie_in_a_file(no_file: Path, compressed: bool) -> None:
    header = no_file.with_name("a.mhd")
    write_metaimage(header, items(), SIZE_PX, compressed=compressed, detached=True)
    data = header.with_suffix(".zraw" if compressed else ".raw").name
    header.write_text(header.read_text().replace(f"ElementDataFile = {data}", f"ElementDataFile = {no_file.name}"))
    refused_at_once(RecordingError, lambda _: list(read_metaimage(header).pictures()), no_file)


def metaimage_naming(header: Path, name: str) -> Path:
    write_metaimage(header, items(), SIZE_PX, compressed=False, detached=True)
    header.write_text(header.read_text().replace(f"ElementDataFile = {header.stem}.raw", f"ElementDataFile = {name}"))
    return header


def nrrd_naming(header: Path, name: str) -> Path:
    write_nrrd(header, items(), SIZE_PX)
    text = header.read_bytes().partition(b"\n\n")[0].decode().replace("encoding: gzip", "encoding: raw")
    header.write_text(f"{text}\ndata file: {name}\n\n")
    return header


NAMING = {"a.mhd": metaimage_naming, "a.nhdr": nrrd_naming}


@pytest.mark.parametrize("kind", NAMING)
@pytest.mark.parametrize("way", ["absolute", "above", "below", "backslash", "link out", "link to a folder out"])
def test_a_header_shows_no_file_that_lies_elsewhere(tmp_path: Path, kind: str, way: str) -> None:
    """Whose bytes would be the pictures of a report: a letter of the right length lies outside of the folder."""
    folder, secret = tmp_path / "sent", tmp_path / "letter"
    (folder / "below").mkdir(parents=True)
    width, height = SIZE_PX
    for place in (secret, folder / "below" / "letter", folder / "below\\letter"):
        place.write_bytes(b"s" * (width * height * len(items())))
    (folder / "link").symlink_to(secret)
    (folder / "out").symlink_to(tmp_path)
    name = {
        "absolute": str(secret),
        "above": "../letter",
        "below": "below/letter",
        "backslash": "below\\letter",
        "link out": "link",
        "link to a folder out": "out/letter",
    }[way]
    header = NAMING[kind](folder / kind, name)
    with pytest.raises(
        RecordingError, match=r"(ElementDataFile|data file) .* (beside the header|leads out of the folder)"
    ):
        list(read_sequence(header).pictures())


@pytest.mark.parametrize("kind", NAMING)
def test_a_file_beside_the_header_and_a_link_to_one_are_shown(tmp_path: Path, kind: str) -> None:
    """Also where the folder itself is reached through a link."""
    width, height = SIZE_PX
    (tmp_path / "sent").mkdir()
    (tmp_path / "by").symlink_to("sent")
    (tmp_path / "sent" / "pictures.raw").write_bytes(bytes(width * height * len(items())))
    (tmp_path / "sent" / "link.raw").symlink_to("pictures.raw")
    for name in ("pictures.raw", "link.raw"):
        header = NAMING[kind](tmp_path / "by" / kind, name)
        assert len(list(read_sequence(header).pictures())) == len(items())


def bomb(path: Path, size: str, content_bytes: int) -> Path:
    """A small file whose pictures unfold to so many zeros."""
    write_metaimage(path, items(), SIZE_PX)
    header = path.read_bytes().partition(b"LOCAL\n")[0].decode()
    zeros = zlib.compress(bytes(content_bytes), 1)
    header = re.sub(r"CompressedDataSize = \d+", f"CompressedDataSize = {len(zeros)}", header)
    path.write_bytes(re.sub(r"DimSize = .*", f"DimSize = {size}", header).encode() + b"LOCAL\n" + zeros)
    return path


def peak_of(use: Callable[[], object], complaint: str) -> int:
    """Bytes in memory while it is refused."""
    tracemalloc.start()
    try:
        with pytest.raises(RecordingError, match=complaint):
            use()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_a_picture_that_unfolds_beyond_any_scanner_is_refused_unread(tmp_path: Path) -> None:
    path = bomb(tmp_path / "a.mha", "16384 16384 4", 1_000_000)
    assert peak_of(lambda: read_metaimage(path), "DimSize says 16384 × 16384 pixels") < 1_000_000


def test_pictures_that_unfold_to_more_than_they_say_take_no_memory(tmp_path: Path) -> None:
    path = bomb(tmp_path / "a.mha", "7 5 4", 50_000_000)
    session = read_metaimage(path)
    assert peak_of(lambda: list(session.pictures()), "more or less picture data") < 2_000_000


def test_a_header_without_end_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metaimage, "MAX_HEADER_LINES", 5_000)
    path = tmp_path / "a.mha"
    path.write_bytes(b"".join(b"key%d = 1\n" % number for number in range(6_000)))
    with pytest.raises(RecordingError, match="the header is longer"):
        read_metaimage(path)


WHOLE = {"raw": False, "compressed": True}


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(chance=st.randoms(use_true_random=False), kind=st.sampled_from(sorted(WHOLE)))
def test_a_recording_with_anything_changed_is_read_or_refused(tmp_path: Path, chance: object, kind: str) -> None:
    """False sizes, cut or doubled bytes: whatever comes, no other error, no wait, and no picture of another size."""
    path = tmp_path / f"{kind}.mha"
    if not path.exists():
        write_metaimage(path, items(), SIZE_PX, compressed=WHOLE[kind])
    spoilt = tmp_path / "spoilt.mha"
    spoilt.write_bytes(changed(path.read_bytes(), chance))
    began_s = time.thread_time()
    refusal: RecordingError | None = None
    try:
        session = open_recording(spoilt, need_poses=False)
        samples = list(session.samples())
        assert all(sample.image.shape[::-1] == session.size_px for sample in samples if hasattr(sample, "image"))
    except RecordingError as error:
        refusal = error
    assert refusal is None or str(spoilt) in str(refusal)
    assert time.thread_time() - began_s < AT_ONCE_S


NUMBERS = (b"0", b"-1", b"1", b"16384", b"16385", b"999999999", b"1e9", b"nan", b"99999999999999999999", b"")


def changed(data: bytes, chance: object) -> bytes:
    """One to three changes, half of them a number of the header."""
    for _ in range(chance.randint(1, 3)):  # type: ignore[attr-defined]
        at = chance.randrange(max(len(data), 1))  # type: ignore[attr-defined]
        what = chance.randrange(6)  # type: ignore[attr-defined]
        if what < 3:
            lines = data.split(b"\n")
            line = chance.randrange(min(len(lines), 30))  # type: ignore[attr-defined]
            key, equals, value = lines[line].partition(b" = ")
            words = value.split() or [b""]
            words[chance.randrange(len(words))] = chance.choice(NUMBERS)  # type: ignore[attr-defined]
            lines[line] = key + equals + b" ".join(words)
            data = b"\n".join(lines)
        elif what == 3:
            data = data[:at]
        elif what == 4:
            data = data[:at] + data[at : at + 64] + data[at:]
        else:
            data = data[:at] + bytes([chance.randrange(256)]) + data[at + 1 :]  # type: ignore[attr-defined]
    return data
