"""OpenIGTLink software that others wrote, both ways: pyigtl, and the example programs of the reference library.

The examples come with Debian's openigtlink-examples and are built here; that library knows header version 1 only.
"""

import json
import shutil
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Event

import numpy as np
import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.openigtlink import content
from probewatch.drivers.openigtlink.image import parse_image
from probewatch.drivers.openigtlink.message import Message
from probewatch.drivers.registry import open_tracker, open_video
from probewatch.drivers.samples import PoseStatus
from probewatch.tools.openigtlink.passage import Passage
from probewatch.tools.openigtlink.server import StateServer
from probewatch.tools.shared.status_watch import StatusWatch
from tests.support.answering import Answering
from tests.support.example_status import MATRIX, OPEN, example_status
from tests.support.igtl_listener import Listener
from tests.support.polling import until
from tests.support.scripted_feed import ScriptedFeed
from tests.support.simulated import PROBEWATCH

EXAMPLES = Path("/usr/share/doc/openigtlink-examples/examples")
PROGRAMS = {
    "Tracker": ("TrackerServer", "TrackerClient"),
    "Imager": ("ImagerServer", "ImagerClient"),
    "Status": ("StatusServer", "StatusClient"),
    "String": ("StringServer", "StringClient"),
    "TrackingData": ("TrackingDataServer", "TrackingDataClient"),
    "QuaternionTrackingData": ("QuaternionTrackingDataServer", "QuaternionTrackingDataClient"),
    "Receiver": ("ReceiveClient",),
    "Capability": ("CapabilityServer", "CapabilityClient"),
    "Point": ("PointServer", "PointClient"),
    "Trajectory": ("TrajectoryServer", "TrajectoryClient"),
    "PolyData": ("PolyDataServer", "PolyDataClient"),
    "ImageMeta": ("ImageMetaServer", "ImageMetaClient", "LabelMetaServer", "LabelMetaClient"),
    "Bind": ("BindClient",),
}
needs_examples = pytest.mark.skipif(
    not EXAMPLES.is_dir() or shutil.which("cmake") is None or shutil.which("c++") is None,
    reason="needs libopenigtlink-dev, openigtlink-examples, cmake and a C++ compiler",
)
Process = subprocess.Popen[str]


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as door:
        return int(door.getsockname()[1])


def listens(port: int) -> bool:
    """By the kernel's table, without connecting: the examples serve one client after the other."""
    wanted = f":{port:04X} 00000000:0000 0A"
    return wanted in Path("/proc/net/tcp").read_text()


@contextmanager
def running(*command: str | Path) -> Iterator[Process]:
    """Nobody reads its output meanwhile: one that has written 64 kB waits."""
    process = subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@contextmanager
def peer(kind: str, port: int, seconds: float) -> Iterator[Process]:
    with running(sys.executable, "-m", "tests.support.igtl_peer", kind, str(port), str(seconds)) as process:
        yield process


@contextmanager
def relay(*arguments: str) -> Iterator[int]:
    """The simulated server's port."""
    with running(*PROBEWATCH, "simulate", "openigtlink", "--tcp", "0", *arguments) as process:
        assert process.stdout is not None
        url = json.loads(process.stdout.readline())["url"]
        yield int(url.partition("?")[0].rpartition(":")[2])
        process.send_signal(signal.SIGTERM)
        process.wait(10)


@contextmanager
def state_server(folder: Path, unasked: bool = False) -> Iterator[tuple[Answering, StateServer]]:
    stop = Event()
    with (
        Answering(folder / "control", example_status) as service,
        StatusWatch(service.path, 0.05) as watch,
        Passage(folder / "feed", print) as passage,
        StateServer(("127.0.0.1", 0), watch, 0.05, passage, unasked=unasked) as server,
    ):
        thread = threading.Thread(target=server.run, args=(stop,))
        thread.start()
        try:
            until(lambda: watch.seen().status)
            yield service, server
        finally:
            stop.set()
            thread.join()


def test_pictures_and_poses_of_pyigtl_are_read() -> None:
    port = free_port()
    with peer("serve", port, 60):
        until(lambda: listens(port), 20)
        with open_tracker(f"igtl://127.0.0.1:{port}?deadline_ms=2000", HostClock()) as tracker:
            poses = [pose for _ in range(60) if (pose := tracker.read(1.0)) and pose.status is PoseStatus.OK]
        places = [pose.matrix[0, 3] for pose in poses if pose.matrix is not None]
        assert len(places) > 20
        assert places == sorted(set(places))
        assert all(pose.matrix[2, 3] == -1600 for pose in poses if pose.matrix is not None)
        with open_video(f"igtl://127.0.0.1:{port}?image=Image&deadline_ms=2000", HostClock()) as video:
            frames = [frame for _ in range(20) if (frame := video.read(1.0)) is not None]
        assert len(frames) > 10
        assert all(frame.image.shape == (48, 64) and np.ptp(frame.image) == 0 for frame in frames)
        for kind in ("IMAGE", "TRANSFORM", "STRING", "POINT", "POSITION"):
            assert heard(port, kind).content, "pyigtl knows no other types; the last three are passed over above"


def test_pyigtl_reads_our_pictures_and_poses() -> None:
    with relay() as port, peer("listen", port, 4) as listener:
        said = json.loads(listener.communicate(timeout=30)[0].splitlines()[-1])
    assert said["Image_Tracker"]["value"][0] == [1, 480, 640]
    assert 1 < said["Image_Tracker"]["value"][1] < 254
    rotation = np.array(said["ProbeToTracker"]["value"])[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-5)


def test_pyigtl_reads_our_state(tmp_path: Path) -> None:
    with state_server(tmp_path) as (service, server):
        service.changes = OPEN
        with peer("listen", server.address[1], 3) as listener:
            said = json.loads(listener.communicate(timeout=30)[0].splitlines()[-1])
    assert json.loads(said["ProbewatchState"]["value"])["state"] == "halt"
    np.testing.assert_allclose(said["ImageToProbe"]["value"], MATRIX, rtol=1e-6)


@contextmanager
def shown(folder: Path) -> Iterator[StateServer]:
    """A server that passes through, to everybody, a feed of 30 pictures and 30 poses a second."""
    feed, ended = ScriptedFeed(folder / "feed", (640, 480)), Event()

    def show() -> None:
        while not ended.wait(1 / 30):
            feed.track()
            feed.show()

    thread = threading.Thread(target=show)
    thread.start()
    try:
        with state_server(folder, unasked=True) as (_, server):
            yield server
    finally:
        ended.set()
        thread.join()
        feed.close()


def test_pyigtl_reads_the_pictures_poses_and_estimate_that_are_passed_through(tmp_path: Path) -> None:
    with shown(tmp_path) as server, peer("listen", server.address[1], 3) as listener:
        said = json.loads(listener.communicate(timeout=30)[0].splitlines()[-1])
    assert said["Image"]["value"][0] == [1, 480, 640]
    assert said["Image"]["place"] == np.eye(4).tolist()
    np.testing.assert_array_equal(np.array(said["ProbeToTracker"]["value"])[:3, :3], np.eye(3))
    assert said["ProbeToTracker"]["value"][0][3] > 30
    assert said["ImageToProbeEstimate"]["value"][1][1] == pytest.approx(0.07 * 1.004)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the programs are; built in half a minute."""
    folder = tmp_path_factory.mktemp("examples")
    shutil.copytree(EXAMPLES, folder / "src")
    for packed in (folder / "src").rglob("*.gz"):
        subprocess.run(["gunzip", str(packed)], check=True)
    configure = ["cmake", "-S", str(folder / "src"), "-B", str(folder / "b")]
    subprocess.run(configure, check=True, capture_output=True)
    wanted = [program for programs in PROGRAMS.values() for program in programs]
    subprocess.run(["make", "-C", str(folder / "b"), *wanted], check=True, capture_output=True)
    return folder / "b"


def program(built: Path, name: str) -> Path:
    return next(built / folder / name for folder, names in PROGRAMS.items() if name in names)


def heard(port: int, kind: str) -> Message:
    with Listener(("127.0.0.1", port)) as listener:
        return listener.until(kind, deadline_s=10)


@needs_examples
@pytest.mark.parametrize(
    ("name", "more", "kind"),
    [
        ("TrackerServer", ["50"], "TRANSFORM"),
        ("ImagerServer", ["20", str(EXAMPLES / "Imager/img")], "IMAGE"),
        ("StatusServer", [], "STATUS"),
        ("StringServer", ["20"], "STRING"),
        ("CapabilityServer", [], "CAPABILITY"),
    ],
)
def test_what_the_reference_servers_send_is_understood(built: Path, name: str, more: list[str], kind: str) -> None:
    port = free_port()
    with running(program(built, name), str(port), *more):
        until(lambda: listens(port), 10)
        message = heard(port, kind)
    match kind:
        case "TRANSFORM":
            assert np.abs(content.parse_transform(message.content)[:3, 3]).max() <= 50
        case "IMAGE":
            assert parse_image(message.content).size == (256, 256, 1)
        case "STATUS":
            assert content.parse_status(message.content).code == content.OK
        case "STRING":
            assert content.parse_words(message.content).text
        case _:
            assert content.parse_types(message.content)


@needs_examples
@pytest.mark.parametrize(
    ("name", "ask", "kind"),
    [
        ("PointServer", "", "POINT"),
        ("TrajectoryServer", "", "TRAJ"),
        ("PolyDataServer", "GET_POLYDATA", "POLYDATA"),
        ("ImageMetaServer", "GET_IMGMETA", "IMGMETA"),
        ("LabelMetaServer", "GET_LBMETA", "LBMETA"),
    ],
)
def test_what_we_do_not_use_is_taken_whole_and_passed_over(built: Path, name: str, ask: str, kind: str) -> None:
    """By its length, and with its check sum, so that what follows is read."""
    port = free_port()
    with running(program(built, name), str(port)):
        until(lambda: listens(port), 10)
        with Listener(("127.0.0.1", port)) as listener:
            if ask:
                listener.ask(ask, "Client")
            assert listener.until(kind, deadline_s=10).content


@needs_examples
def test_pictures_of_the_reference_server_are_frames(built: Path) -> None:
    port, images = free_port(), EXAMPLES / "Imager/img"
    with running(program(built, "ImagerServer"), str(port), "20", images):
        until(lambda: listens(port), 10)
        with open_video(f"igtl://127.0.0.1:{port}?header=1&deadline_ms=2000", HostClock()) as video:
            frame = until(lambda: video.read(1.0))
    stored = {file.read_bytes() for file in images.glob("*.raw")}
    assert frame.image.tobytes() in stored


@needs_examples
@pytest.mark.parametrize(
    ("name", "ask", "wanted"),
    [
        ("TrackingDataServer", "tdata", PoseStatus.OK),
        ("QuaternionTrackingDataServer", "qtdata", PoseStatus.NOT_UNDERSTOOD),
    ],
)
def test_tracking_data_of_the_reference_server_come_when_asked_for(
    built: Path, name: str, ask: str, wanted: PoseStatus
) -> None:
    """Those quaternions have not the length 1, so they are no poses, and said to be none."""
    port = free_port()
    with running(program(built, name), str(port)):
        until(lambda: listens(port), 10)
        url = f"igtl://127.0.0.1:{port}?probe=Channel%200&ask={ask}&header=1&deadline_ms=2000"
        with open_tracker(url, HostClock()) as tracker:
            pose = until(lambda: (one := tracker.read(1.0)) and one.status is not PoseStatus.MISSING and one)
    assert pose.status is wanted
    assert "length" in pose.reason or pose.matrix is not None


def received(built: Path, port: int) -> str:
    """What the reference library's receiver says of three seconds."""
    command = ["timeout", "3", str(program(built, "ReceiveClient")), "127.0.0.1", str(port)]
    return subprocess.run(command, capture_output=True, text=True, errors="replace", check=False).stderr


@needs_examples
def test_the_reference_client_understands_our_simulated_server(built: Path) -> None:
    with relay("--fault", "old-header") as port:
        said = received(built, port)
    assert "Receiving TRANSFORM data type" in said
    assert "Receiving IMAGE data type" in said
    assert "(640, 480, 1)" in said


@needs_examples
def test_the_reference_client_understands_our_state(built: Path, tmp_path: Path) -> None:
    with state_server(tmp_path) as (service, server):
        service.changes = OPEN
        said = received(built, server.address[1])
    assert "Receiving STATUS data type" in said
    assert "halt" in said
    assert "contact open: Do not use the navigation" in said
    assert "Receiving STRING data type" in said
    assert "Receiving TRANSFORM data type" in said


@needs_examples
def test_the_reference_client_understands_what_is_passed_through(built: Path, tmp_path: Path) -> None:
    with shown(tmp_path) as server:
        said = received(built, server.address[1])
    assert said.count("(640, 480, 1)") > 30, said[-2000:]
    assert said.count("Receiving TRANSFORM data type") > 30
    assert "Receiving STATUS data type" in said


@needs_examples
@pytest.mark.parametrize(
    "programs",
    [
        ("TrackerClient", "ImagerClient", "StatusClient", "StringClient", "CapabilityClient"),
        ("PointClient", "TrajectoryClient", "BindClient"),
        ("PolyDataClient", "ImageMetaClient", "LabelMetaClient", "TrackingDataClient", "QuaternionTrackingDataClient"),
    ],
    ids=["types-we-read", "types-we-do-not-use", "questions-we-refuse"],
)
def test_what_the_reference_clients_send_us_disturbs_nobody(
    built: Path, tmp_path: Path, programs: tuple[str, ...]
) -> None:
    """Most go on for as long as is listened here, or longer; who has said all breaks off, which is counted."""
    rated = ("TrackerClient", "StringClient", "BindClient", "TrackingDataClient", "QuaternionTrackingDataClient")
    more = {name: ["10"] for name in rated} | {"ImagerClient": ["10", str(EXAMPLES / "Imager/img")]}
    with state_server(tmp_path) as (_, server), ExitStack() as clients:
        place = ["127.0.0.1", str(server.address[1])]
        begun = [clients.enter_context(running(program(built, name), *place, *more.get(name, []))) for name in programs]
        with Listener(server.address) as listener:
            listener.listen(2)
            listener.until("STATUS")
            # While the listener is there: one who leaves is counted as well.
            until(lambda: server.dropped <= sum(one.poll() is not None for one in begun), 10)
            assert server.turned_away == 0
        assert all(one.returncode in (0, None) for one in begun)
