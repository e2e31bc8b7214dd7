"""Whatever OpenCV reads as a video source: a file, and a stream from a real server on this host."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2
import numpy as np
import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.device_api import VideoSource
from probewatch.drivers.errors import ConfigurationError, DeviceLost
from probewatch.drivers.registry import open_video
from probewatch.drivers.samples import Frame

W, H, PICTURES = 160, 120, 20


def picture(number: int) -> np.ndarray:
    """(H, W, 3): brighter with each number, a dark left half."""
    image = np.full((H, W, 3), 60 + 8 * number, np.uint8)
    image[:, : W // 2] = 16
    return image


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("film") / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 50, (W, H))
    for number in range(PICTURES):
        writer.write(picture(number))
    writer.release()
    return path


def all_of(source: VideoSource) -> tuple[list[Frame], DeviceLost]:
    frames: list[Frame] = []
    try:
        while True:
            frame = source.read(2.0)
            assert frame is not None, "no picture for two seconds"
            frames.append(frame)
    except DeviceLost as end:
        return frames, end


def test_a_codec_that_cannot_be_decoded_is_no_end_of_the_film() -> None:
    with open_video(f"opencv:{Path(__file__).parents[2] / 'data' / 'av1.mkv'}", HostClock()) as source:
        frames, end = all_of(source)
    assert (len(frames), end.what) == (0, "no picture of it can be decoded")


@pytest.mark.parametrize("name", ["notes.txt", "notes.nfo"])
def test_a_text_is_not_played_as_a_film_of_its_lines(tmp_path: Path, name: str) -> None:
    """FFmpeg draws it, at 25 Hz and 640 x 400 pixels."""
    (tmp_path / name).write_text("0.1;0.2;0.3\n" * 1000)
    with pytest.raises(DeviceLost, match=r"is text, which would be drawn as pictures\. Give the film itself"):
        open_video(f"opencv:{tmp_path / name}", HostClock())


def test_a_film_that_is_called_a_text_plays(tmp_path: Path, film: Path) -> None:
    (tmp_path / "film.txt").write_bytes(film.read_bytes())
    with open_video(f"opencv:{tmp_path / 'film.txt'}", HostClock()) as source:
        frame = source.read(2.0)
    assert frame is not None


def test_a_file_plays_at_its_own_rate_and_is_lost_at_its_end(film: Path) -> None:
    clock = HostClock()
    with open_video(f"opencv:{film}", clock) as source:
        frames, end = all_of(source)
    assert "the film has ended" in str(end)
    assert [frame.sequence for frame in frames] == list(range(PICTURES))
    steps_ns = np.diff([frame.stamp.t_ns for frame in frames])
    np.testing.assert_allclose(steps_ns, 20e6, atol=1)
    assert clock.now_ns() >= frames[-1].stamp.t_ns, "none comes before its time"
    for frame in frames:
        assert abs(int(frame.image[60, 120]) - (60 + 8 * frame.sequence)) <= 3
        assert abs(int(frame.image[60, 40]) - 16) <= 3


def test_crop_and_orientation(film: Path) -> None:
    with open_video(f"opencv:{film}?crop=72,0,32,16&orientation=UF", HostClock()) as source:
        frame = source.read(2.0)
    assert frame is not None
    assert frame.image.shape == (16, 32)
    assert frame.image[8, 4] > 50 > frame.image[8, 28], "turned left to right"


def test_a_crop_outside_the_picture_is_said(film: Path) -> None:
    with open_video(f"opencv:{film}?crop=100,0,100,20", HostClock()) as source, pytest.raises(DeviceLost, match="crop"):
        source.read(2.0)


class Server(BaseHTTPRequestHandler):
    """A camera as many are: JPEG pictures one after the other in one reply, 25 a second."""

    pictures = 30

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        for number in range(self.pictures):
            _, jpeg = cv2.imencode(".jpg", picture(number % PICTURES))
            head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {jpeg.size}\r\n\r\n"
            self.wfile.write(head.encode() + jpeg.tobytes() + b"\r\n")
            time.sleep(0.02)

    def log_message(self, *_: object) -> None: ...


@contextmanager
def camera() -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), Server)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"opencv:http://127.0.0.1:{server.server_address[1]}/video.mjpg"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def test_a_stream_is_stamped_at_arrival_and_its_end_is_a_loss() -> None:
    clock = HostClock()
    with camera() as url, open_video(f"{url}?delay_ms=50&error_ms=70", clock) as source:
        first = source.read(5.0)
        assert first is not None
        assert clock.now_ns() - first.stamp.t_ns >= 50_000_000
        assert first.stamp.err_ns == 70_000_000
        frames, end = all_of(source)
    assert "sends no more pictures" in str(end)
    assert len(frames) >= 10


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("opencv:0?fps=3", "unknown option 'fps'"),
        ("opencv:rtsp://host/x?channel=1", "%3F"),
        ("opencv:0?error_ms=never", "error_ms=never"),
        ("opencv:0?crop=1,2,3", "crop=1,2,3 is not a part of a picture"),
        ("opencv:0?crop=0,0,8,80", "crop=0,0,8,80"),
        ("opencv:0?orientation=XY", "orientation=XY"),
    ],
)
def test_a_url_that_can_never_work_is_refused(url: str, words: str) -> None:
    with pytest.raises(ConfigurationError) as refusal:
        open_video(url, HostClock())
    assert words in str(refusal.value)


@pytest.mark.parametrize("target", ["/no/such/file.avi", "63", "rtsp://127.0.0.1:1/live"])
def test_what_is_not_there_is_lost(target: str) -> None:
    with pytest.raises(DeviceLost) as refusal:
        open_video(f"opencv:{target}", HostClock())
    assert refusal.value.remedy


def test_pictures_larger_than_any_scanner_has_are_refused_before_they_take_memory(tmp_path: Path) -> None:
    """One of 12000 x 12000 took 1.6 GB, beyond which the kernel ends the service."""
    path = tmp_path / "huge.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 50, (8192, 2064))
    writer.write(np.zeros((2064, 8192, 3), np.uint8))
    writer.release()
    with pytest.raises(DeviceLost, match="sends pictures of 8192 x 2064 pixels, more than 16777216"):
        open_video(f"opencv:{path}", HostClock())


def test_a_file_that_is_no_film_is_lost(tmp_path: Path) -> None:
    (tmp_path / "film.avi").write_bytes(b"RIFF" + bytes(100))
    with pytest.raises(DeviceLost, match="cannot read it"):
        open_video(f"opencv:{tmp_path}/film.avi", HostClock())
