"""What `probewatch devices` finds in a /dev, /sys and /proc made for the test, and what it prints of it."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from probewatch.drivers.io.inventory import Found, gpio_chips, serial_ports, video_devices
from tests.support.answers import answered

PROBEWATCH = Path(sys.executable).parent / "probewatch"
_NOBODY = 65534


def put(path: Path, text: str = "") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def link(path: Path, target: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.symlink_to(target)


def add_usb_serial(root: Path, name: str, by_id: str = "", port: str = "1-1") -> None:
    usb = root / f"sys/devices/pci0/usb1/{port}"
    for key, value in (("manufacturer", "FTDI"), ("product", "FT232R USB UART"), ("serial", "A1B2C3")):
        put(usb / key, f"{value}\n")
    (usb / f"{port}:1.0/{name}").mkdir(parents=True)
    link(root / f"sys/class/tty/{name}/device", f"../../../devices/pci0/usb1/{port}/{port}:1.0/{name}")
    put(root / f"dev/{name}")
    if by_id:
        link(root / f"dev/serial/by-id/{by_id}", f"../../{name}")


def add_camera(root: Path, name: str, title: str, index: int = 0) -> None:
    put(root / f"sys/class/video4linux/{name}/name", f"{title}\n")
    put(root / f"sys/class/video4linux/{name}/index", f"{index}\n")
    put(root / f"dev/{name}")


def add_gpio(root: Path, name: str, device: str, label: str = "", base: int = 512) -> None:
    (root / f"sys/devices/platform/{device}/{name}").mkdir(parents=True)
    link(root / f"sys/bus/gpio/devices/{name}", f"../../../devices/platform/{device}/{name}")
    if label:
        put(root / f"sys/class/gpio/gpiochip{base}/label", f"{label}\n")
        put(root / f"sys/class/gpio/gpiochip{base}/ngpio", "32\n")
        link(root / f"sys/class/gpio/gpiochip{base}/device", f"../../../devices/platform/{device}")
    put(root / f"dev/{name}")


def test_serial_ports_have_the_name_that_survives_replugging(tmp_path: Path) -> None:
    add_usb_serial(tmp_path, "ttyUSB10", port="1-2")
    add_usb_serial(tmp_path, "ttyUSB2", "usb-FTDI_FT232R_A1B2C3-if00-port0")
    assert serial_ports(tmp_path) == (
        Found("/dev/serial/by-id/usb-FTDI_FT232R_A1B2C3-if00-port0", "/dev/ttyUSB2", "FTDI FT232R USB UART A1B2C3"),
        Found("/dev/ttyUSB10", "/dev/ttyUSB10", "FTDI FT232R USB UART A1B2C3"),
    )


def test_ports_without_hardware_and_consoles_are_left_out(tmp_path: Path) -> None:
    for name, kind in (("ttyS0", "4"), ("ttyS1", "0"), ("tty1", ""), ("console", "")):
        put(tmp_path / f"sys/class/tty/{name}/type", kind)
        put(tmp_path / f"dev/{name}")
    assert serial_ports(tmp_path) == (Found("/dev/ttyS0", "/dev/ttyS0", "serial port on the board"),)


def test_video_nodes_are_told_apart(tmp_path: Path) -> None:
    add_camera(tmp_path, "video1", "Grabber", index=1)
    add_camera(tmp_path, "video0", "Grabber")
    link(tmp_path / "dev/v4l/by-id/usb-Grabber-video-index0", "../../video0")
    assert video_devices(tmp_path) == (
        Found("/dev/v4l/by-id/usb-Grabber-video-index0", "/dev/video0", "Grabber"),
        Found("/dev/video1", "/dev/video1", "Grabber, node 1"),
    )


def test_gpio_chips_are_named_by_their_driver(tmp_path: Path) -> None:
    add_gpio(tmp_path, "gpiochip0", "gpio-sim.0")
    add_gpio(tmp_path, "gpiochip1", "INT3450:00", "INT3450:00")
    assert gpio_chips(tmp_path) == (
        Found("/dev/gpiochip0", "/dev/gpiochip0", "gpio-sim.0"),
        Found("/dev/gpiochip1", "/dev/gpiochip1", "INT3450:00, 32 lines"),
    )


def test_who_holds_a_device_is_named(tmp_path: Path) -> None:
    add_camera(tmp_path, "video0", "Grabber")
    put(tmp_path / "proc/42/comm", "probewatch\n")
    link(tmp_path / "proc/42/fd/7", "/dev/video0")
    link(tmp_path / "proc/42/fd/8", "socket:[123]")
    link(tmp_path / "proc/self", "42")
    assert video_devices(tmp_path)[0].obstacle == "in use by probewatch (42)"


def test_a_device_without_a_node_is_said(tmp_path: Path) -> None:
    add_camera(tmp_path, "video0", "Grabber")
    (tmp_path / "dev/video0").unlink()
    assert video_devices(tmp_path)[0].obstacle == "has no node in /dev"


@contextmanager
def as_a_plain_user() -> Iterator[None]:
    before = os.geteuid()
    if before == 0:
        os.seteuid(_NOBODY)
    try:
        yield
    finally:
        os.seteuid(before)


def test_missing_permission_names_the_group() -> None:
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        root.chmod(0o755)
        add_camera(root, "video0", "Grabber")
        (root / "dev/video0").chmod(0o000)
        with as_a_plain_user():
            (found,) = video_devices(root)
    assert found.obstacle.startswith("no permission; add this user to the group '")


def test_this_host_can_be_asked() -> None:
    for found in (*serial_ports(), *video_devices(), *gpio_chips()):
        assert found.node.startswith("/dev/")


def listed(root: Path) -> str:
    answer = answered("devices", "--root", root)
    assert answer.returncode == 0, answer.stderr
    return answer.stdout


def test_without_a_terminal_each_device_is_one_line_of_fields(tmp_path: Path) -> None:
    add_usb_serial(tmp_path, "ttyUSB0", "usb-FTDI")
    add_gpio(tmp_path, "gpiochip0", "gpio-sim.0")
    put(tmp_path / "proc/42/comm", "minicom\n")
    link(tmp_path / "proc/42/fd/3", "/dev/ttyUSB0")
    assert [line.split("\t") for line in listed(tmp_path).splitlines()] == [
        ["kind", "path", "node", "what it is", "state"],
        [
            "serial port",
            "/dev/serial/by-id/usb-FTDI",
            "/dev/ttyUSB0",
            "FTDI FT232R USB UART A1B2C3",
            "in use by minicom (42)",
        ],
        ["GPIO chip", "/dev/gpiochip0", "/dev/gpiochip0", "gpio-sim.0", "free"],
    ]


def test_nothing_connected_is_said(tmp_path: Path) -> None:
    assert listed(tmp_path) == "No serial port, no video device and no GPIO chip is connected.\n"


def test_on_a_terminal_it_is_a_table(tmp_path: Path) -> None:
    add_camera(tmp_path, "video0", "Grabber [v2]")
    master, slave = os.openpty()
    environment = os.environ | {"COLUMNS": "120", "TERM": "dumb"}
    shown = subprocess.Popen([PROBEWATCH, "devices", "--root", tmp_path], stdout=slave, env=environment)
    os.close(slave)
    text = read_all(master)
    assert shown.wait(10) == 0
    assert "what it is" in text
    assert "Grabber [v2]" in text
    assert "\t" not in text


def read_all(master: int) -> str:
    """What was written to a terminal until its other side closed."""
    text = b""
    with suppress(OSError):
        while True:
            text += os.read(master, 4096)
    os.close(master)
    return text.decode()
