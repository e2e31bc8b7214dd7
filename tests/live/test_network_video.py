"""RTSP from GStreamer's own server into the service's capture thread: silence, unplugging, and back by itself."""

import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import structlog

from probewatch.appliance.service.devices.source_thread import CaptureThread
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.registry import open_video
from probewatch.drivers.samples import Frame, Sample
from tests.support.polling import until

PYTHON, SCRIPT = "/usr/bin/python3", Path(__file__).parents[1] / "support" / "rtsp_server.py"
NEEDS = "import gi; gi.require_version('GstRtspServer', '1.0'); from gi.repository import Gst; Gst.init(None); "
NEEDS += "assert Gst.ElementFactory.find('rtpjpegpay')"
OPEN_S, LOST_S, BACK_S = 20.0, 8.0, 40.0


def server(port: int) -> "subprocess.Popen[str]":
    process = subprocess.Popen([PYTHON, SCRIPT, str(port)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


@pytest.fixture
def port() -> int:
    if subprocess.run([PYTHON, "-c", NEEDS], capture_output=True, check=False).returncode:
        pytest.skip("needs Debian's python3-gi, gir1.2-gst-rtsp-server-1.0 and gstreamer1.0-plugins-good")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


def follow(thread: CaptureThread, what: str, done: Callable[[], bool], within_s: float) -> None:
    began_s = time.monotonic()
    until(done, within_s)
    print(f"{what}: after {time.monotonic() - began_s:.1f} s; lost: {thread.lost}")


def test_a_network_camera_is_lost_once_and_back_once_whatever_happens_to_it(port: int) -> None:
    frames: list[Sample] = []
    camera = server(port)
    with structlog.testing.capture_logs() as entries:
        thread = CaptureThread("video", f"opencv:rtsp://127.0.0.1:{port}/live", open_video, frames.append, HostClock())
        thread.start()
        try:
            follow(thread, "first picture", lambda: bool(frames), OPEN_S)
            assert isinstance(frames[0], Frame)
            assert frames[0].image.shape == (240, 320)
            camera.send_signal(signal.SIGSTOP)
            follow(thread, "silent", lambda: thread.lost is not None, LOST_S)
            camera.send_signal(signal.SIGCONT)
            follow(thread, "goes on", lambda: thread.lost is None, BACK_S)
            camera.kill()
            camera.communicate()
            follow(thread, "killed", lambda: thread.lost is not None, LOST_S)
            camera = server(port)
            seen = len(frames)
            follow(thread, "started again", lambda: thread.lost is None and len(frames) > seen + 5, BACK_S)
        finally:
            thread.stop()
            thread.join(10)  # Before the camera ends, which the thread would still report.
            camera.kill()
            camera.communicate()
    told = [entry["event"] for entry in entries if str(entry["event"]).startswith("device")]
    assert told == ["device lost", "device back"] * 2
    assert thread.failure is None
