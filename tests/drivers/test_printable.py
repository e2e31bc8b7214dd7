"""What devices, servers, files and clients say reaches no terminal, log or status as anything but printable text."""

import io
import json
import os
import pty
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from ctypes import c_uint8
from datetime import UTC, datetime
from pathlib import Path

import pytest
import structlog
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console
from rich.style import Style
from rich.text import Text as Words

from probewatch.appliance.core.quality.gesture import Gesture
from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.service.control.server import ControlServer
from probewatch.appliance.service.host.log import configure
from probewatch.appliance.service.host.systemd_notify import Notifier
from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError, DeviceLost, RecordingError
from probewatch.drivers.io.inventory import serial_ports
from probewatch.drivers.printable import (
    LONGEST_TEXT,
    LONGEST_WORDS,
    printable,
    printable_bytes,
    printable_screen,
    printable_value,
)
from probewatch.drivers.recordings.metaimage import read_metaimage
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from probewatch.drivers.trackers.ndi.identity import identity_of
from probewatch.drivers.trackers.ndi.rom import ROM_BYTES, definition_of
from probewatch.drivers.trackers.optotrak.rtc3d import ByteOrder, PacketType, Text, encode_packet
from probewatch.drivers.trackers.optotrak.tracker import open_tracker
from probewatch.drivers.video.v4l2 import abi
from probewatch.tools.commands.log import command as log_command
from probewatch.tools.shared.gesture_drawings import drawing
from tests.support.recordings import SIZE_PX, items

HOSTILE = "\x1b]0;owned\x07\x1b[2J\x9b31m\u202etxet\u2066\u200b\r\n{forged}\x00\x7f\ud800" + "x" * 100_000
SAFE_HOSTILE = HOSTILE.replace("\ud800", "")


def is_fit(text: str, longest: int = LONGEST_WORDS) -> bool:
    return text.isprintable() and len(text) <= longest


@given(st.text() | st.just(HOSTILE))
def test_one_line_of_a_bounded_length(text: str) -> None:
    assert is_fit(printable(text))
    assert is_fit(printable_bytes(text.encode(errors="surrogatepass")))
    if text.isprintable() and len(text) <= LONGEST_WORDS:
        assert printable(text) == text


JSON = st.recursive(
    st.text(max_size=20) | st.integers() | st.just(HOSTILE),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@given(JSON)
@settings(max_examples=30)
def test_whatever_json_holds(value: object) -> None:
    texts: list[str] = []

    def walk(one: object) -> None:
        if isinstance(one, str):
            texts.append(one)
        elif isinstance(one, dict):
            for key, inner in one.items():
                walk(key)
                walk(inner)
        elif isinstance(one, list):
            for inner in one:
                walk(inner)

    walk(printable_value(value))
    assert all(is_fit(text, LONGEST_TEXT + 1) for text in texts)


def test_words_of_people_are_left_alone() -> None:
    for words in ("Gerät Nr. 5 · ζ ± 0.4 mm", "日本語", "🟢 ok", "a–b “c” …"):
        assert printable(words) == words


def test_colours_pass_to_a_terminal_only() -> None:
    text = "\x1b[1;31mred\x1b[0m \x1b]0;title\x07 \x9b2J \u202e\n"
    shown = printable_screen(text, colours=True)
    assert shown == "\x1b[1;31mred\x1b[0m \ufffd]0;title\ufffd \ufffd2J \ufffd\n"
    assert "\x1b" not in printable_screen(text, colours=False)


def test_a_link_to_a_drawing_of_the_gesture_passes_to_a_terminal_and_no_other() -> None:
    link = Words("slide it", Style(link=drawing(Gesture.SIDEWAYS).as_uri()))
    screen = Console(file=io.StringIO(), force_terminal=True, color_system="standard", legacy_windows=False)
    with screen.capture() as capture:
        screen.print(link)
    assert "\x1b]8;id=" in capture.get()
    assert printable_screen(capture.get(), colours=True) == capture.get()
    for url in ("https://a.example/gesture-press.svg", "file:///etc/passwd", "file:///a/gesture-press.svg;x"):
        shown = printable_screen(f"\x1b]8;id=1;{url}\x1b\\here\x1b]8;;\x1b\\", colours=True)
        assert "\x1b]8;id" not in shown


def rtc3d_server(listener: socket.socket, words: str) -> None:
    """Answers every command with an error in these words."""
    line, _ = listener.accept()
    with line:
        line.recv(4096)
        line.sendall(encode_packet(Text(PacketType.ERROR, words), ByteOrder.BIG))
        line.recv(4096)


def said_by_rtc3d_server(folder: Path) -> str:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        words = SAFE_HOSTILE.replace("\x00", "")[:40_000]
        server = threading.Thread(target=rtc3d_server, args=(listener, words))
        server.start()
        try:
            with pytest.raises(DeviceLost) as refusal:
                open_tracker(f"127.0.0.1:{port}", {"body": "1"}, HostClock())
        finally:
            server.join(5)
    assert "owned" in refusal.value.what, "it is told, in safe words"
    return refusal.value.what


def said_by_ndi_tracker(folder: Path) -> str:
    words = SAFE_HOSTILE[:2000].replace("\n", "").replace("\r", "")
    version = f"Polaris {words} Control Firmware\nNDI S/N: {words}\nFreeze Tag: {words}\n"
    return str(identity_of(version, words))


def said_by_tool(folder: Path) -> str:
    image = bytearray(ROM_BYTES)
    image[0x250:0x264] = HOSTILE[:20].encode("latin-1", "replace")
    return definition_of(bytes(image)).part_number


def said_by_grabber(folder: Path) -> str:
    card = (c_uint8 * 32)(*HOSTILE[:32].encode(errors="replace")[:32])
    return abi.text(card) + abi.fourcc_text(0x1B9B0A07)


def said_by_usb_adapter(folder: Path) -> str:
    port = folder / "sys/class/tty/ttyUSB0"
    (port / "device").mkdir(parents=True)
    (port / "type").write_text("4")
    (port / "device/product").write_bytes(SAFE_HOSTILE.encode())
    return serial_ports(folder)[0].title


def said_by_header(folder: Path) -> str:
    path = folder / "a.mha"
    write_metaimage(path, items(), SIZE_PX)
    names = path.read_bytes().replace(b"Probe", "Pr\x1b[2J\u202e".encode())
    path.write_bytes(names.replace(b"OK", b"\x1bOK"))
    recording = read_metaimage(path)
    reading = recording.transform(0, recording.transform_names()[0])
    with pytest.raises(RecordingError) as refusal:
        read_metaimage(folder / "none\x1b[2J")
    return reading.reason + str(refusal.value)


SPEAKERS: dict[str, Callable[[Path], str]] = {
    "RTC3D server": said_by_rtc3d_server,
    "NDI tracker": said_by_ndi_tracker,
    "tool memory": said_by_tool,
    "video grabber": said_by_grabber,
    "USB adapter": said_by_usb_adapter,
    "file header": said_by_header,
}


@pytest.mark.parametrize("speaker", SPEAKERS)
def test_where_bytes_become_text(speaker: str, tmp_path: Path) -> None:
    assert is_fit(SPEAKERS[speaker](tmp_path), 1000)


def test_every_refusal_is_one_printable_line() -> None:
    refusal = ConfigurationError(HOSTILE, HOSTILE, HOSTILE)
    assert all(is_fit(text, LONGEST_TEXT) for text in (refusal.what, refusal.where, refusal.remedy))
    assert str(refusal).isprintable()


def test_the_log_writes_nothing_else() -> None:
    stream = io.StringIO()
    with configure("info", stream):
        try:
            raise ValueError(HOSTILE)
        except ValueError:
            structlog.get_logger(device=HOSTILE).error(HOSTILE, what=[HOSTILE], exc_info=True)
    lines = stream.getvalue().splitlines()
    assert len(lines) == 1
    fields = json.loads(lines[0])
    assert fields["exception"].startswith("Traceback")
    assert all(line.isprintable() for line in fields.pop("exception").splitlines())
    assert all(is_fit(str(value), 2 * LONGEST_TEXT) for value in fields.values())


def test_neither_does_the_status_at_either_end(tmp_path: Path) -> None:
    status = {"remarks": [HOSTILE], "lost": {HOSTILE: HOSTILE}, "age_s": 1.5, "latched": None}
    with ControlServer(tmp_path / "control") as server:
        end = threading.Event()

        def tick() -> None:
            while not end.wait(0.005):
                server.poll(lambda do, request, who: {"status": status})

        service = threading.Thread(target=tick)
        service.start()
        try:
            with socket.socket(socket.AF_UNIX) as raw:
                raw.connect(str(tmp_path / "control"))
                raw.sendall(b'{"v": 1, "do": "status"}\n')
                line = raw.makefile("rb").readline().decode()
            with ControlClient(tmp_path / "control") as client:
                shown = client.status()
        finally:
            end.set()
            service.join()
    assert line.removesuffix("\n").isprintable()
    assert all(is_fit(text, LONGEST_TEXT) for text in (*shown["remarks"], *shown["lost"], *shown["lost"].values()))
    assert (shown["age_s"], shown["latched"]) == (1.5, None)


def test_the_client_trusts_no_service(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "control"))
        listener.listen()

        def lie() -> None:
            line, _ = listener.accept()
            line.recv(4096)
            line.sendall(json.dumps({"ok": True, "status": {"text": HOSTILE}}).encode() + b"\n")
            line.close()

        liar = threading.Thread(target=lie)
        liar.start()
        with ControlClient(tmp_path / "control") as client:
            assert is_fit(client.status()["text"], LONGEST_TEXT)
        liar.join(5)


def test_the_service_manager_is_told_one_line(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        notifier = Notifier(str(tmp_path / "notify"))
        notifier.alive("monitoring\nMAINPID=1\nREADY=0")
        notifier.close()
        assert manager.recv(4096).count(b"\n") == 2


COMMAND = "import sys; sys.argv[1:] = {arguments!r}; from probewatch.tools.cli import main; main()"


def test_a_terminal_is_never_taken_over(tmp_path: Path) -> None:
    """The last net: a name of a file that nobody else looks at, on a real pseudo-terminal."""
    name = tmp_path / "a\x1b]0;owned\x07\x9b2J\u202e.mha"
    write_metaimage(name, items(), SIZE_PX)
    (tmp_path / "x.toml").write_text("\x1b = 1")
    command = COMMAND.format(arguments=["replay", str(name), "--calibration", str(tmp_path / "x.toml")])
    master, slave = pty.openpty()
    with subprocess.Popen([sys.executable, "-c", command], stdout=slave, stderr=slave) as process:
        os.close(slave)
        shown = b""
        try:
            while block := os.read(master, 65536):
                shown += block
        except OSError:
            pass  # Linux says so when the other side has closed
        process.wait(20)
    os.close(master)
    assert b"probewatch:" in shown
    assert not any(control in shown for control in (b"\x1b]", b"\x07", "\x9b".encode(), "\u202e".encode())), shown


def test_the_net_holds_where_everything_else_failed() -> None:
    code = (
        "import click, sys; from probewatch.tools.shared.terminal import guard_terminal; guard_terminal()\n"
        f"click.echo({SAFE_HOSTILE[:60]!r}); print({SAFE_HOSTILE[:60]!r}, file=sys.stderr)\n"
        "struct_bytes = sys.stdout.buffer.write(b'raw bytes pass\\n'); sys.stdout.flush()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert b"raw bytes pass" in done.stdout
    for shown in (done.stdout.decode(), done.stderr.decode()):
        assert all(line.isprintable() for line in shown.split("\n"))
        assert "forged" in shown


def test_a_row_of_an_export_is_no_formula(tmp_path: Path) -> None:
    log = AlarmLog(tmp_path / "log")
    log.append(datetime(2026, 1, 1, tzinfo=UTC), 0, "request", {"reason": "=HYPERLINK(1)", "who": "@me\x1b[2J"}, None)
    CliRunner().invoke(log_command, [str(tmp_path / "log"), "--csv", str(tmp_path / "out.csv")])
    text = (tmp_path / "out.csv").read_text()
    assert ",'=HYPERLINK(1)," in text
    assert ",'@me\ufffd[2J," in text
