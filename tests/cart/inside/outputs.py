"""The package's GPIO and control-line outputs on gpio-sim and on the kernel's own serial driver; prints JSON."""

import fcntl
import json
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.registry import open_output

CLOCK = HostClock()
BANK = next(Path("/sys/devices/platform").glob("gpio-sim.*/gpiochip*"))
CHIP, PORT = "gpio:/dev/gpiochip0", "/dev/ttyS1"
LOOP = 0x8000
HOLDER = """
import time
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.registry import open_output
kept = [open_output(url, HostClock()) for url in {urls!r}]
[one.write(True) for one in kept]
print("held", flush=True)
time.sleep(100)
"""


def level(line: int = 0) -> int:
    return int((BANK / f"sim_gpio{line}/value").read_text())


def refused(url: str) -> str:
    try:
        with open_output(url, CLOCK):
            return "opened"
    except DeviceLost as loss:
        return loss.what


def gpio() -> dict[str, object]:
    found: dict[str, object] = {"idle": level()}
    for name, query in (("high", "line=0"), ("low", "line=relay&active=low")):
        with open_output(f"{CHIP}?{query}", CLOCK) as output:
            seen = [level()]
            for energised in (True, False, True):
                output.write(energised)
                seen.append(level())
            found[name] = seen
            found[f"{name} read back"] = output.read_back()
            found["busy"] = refused(f"{CHIP}?line=0")
        found[f"{name} closed"] = level()
    found["no line"] = refused(f"{CHIP}?line=99"), refused(f"{CHIP}?line=nothing")
    (BANK / "sim_gpio2/pull").write_text("pull-down")
    with open_output(f"{CHIP}?line=relay&sense=sense", CLOCK) as output:
        try:
            output.write(True)
            found["stuck"] = "followed"
        except DeviceLost as loss:
            found["stuck"] = loss.what
        (BANK / "sim_gpio2/pull").write_text("pull-up")
        output.write(True)
        found["followed"] = output.read_back()
    (BANK / "sim_gpio2/pull").write_text("pull-down")
    with open_output(f"{CHIP}?line=relay&heartbeat=2", CLOCK) as output:
        seen = []
        for number in range(50):
            output.write(number < 40)
            seen.append(level())
            time.sleep(0.05)
        found["wave"] = seen
    return found


def lines(fd: int) -> dict[str, bool]:
    word = bytearray(4)
    fcntl.ioctl(fd, termios.TIOCMGET, word)
    (bits,) = struct.unpack("<I", word)
    masks = {"rts": termios.TIOCM_RTS, "dtr": termios.TIOCM_DTR, "cts": termios.TIOCM_CTS, "dsr": termios.TIOCM_DSR}
    return {name: bool(bits & mask) for name, mask in masks.items()}


def loop_back(fd: int, on: bool) -> None:
    """The 8250's own test mode: RTS is led to CTS, DTR to DSR."""
    request = termios.TIOCMBIS if on else termios.TIOCMBIC
    fcntl.ioctl(fd, request, struct.pack("<I", LOOP))


def serial() -> dict[str, object]:
    found: dict[str, object] = {}
    for pin, sense in (("rts", "cts"), ("dtr", "dsr")):
        with open_output(f"serialpin:{PORT}?pin={pin}&sense={sense}", CLOCK) as output:
            fd = output._port.fileno()
            found[f"{pin} opened"] = lines(fd)[pin]
            loop_back(fd, True)
            seen = []
            for energised in (True, False, True):
                output.write(energised)
                seen.append((lines(fd)[pin], output.read_back()))
            found[pin] = seen
            found[f"{pin} busy"] = refused(f"serialpin:{PORT}?pin={pin}")
            loop_back(fd, False)
            try:
                output.write(False)
                found[f"{pin} stuck"] = "followed"
            except DeviceLost as loss:
                found[f"{pin} stuck"] = loss.what
    return found


def modem_register() -> str:
    """The port's raised lines by the driver's own word, without opening it."""
    return next(line for line in Path("/proc/tty/driver/serial").read_text().splitlines() if line.startswith("1:"))


def killed() -> dict[str, object]:
    """A process that holds both outputs energised dies."""
    source = HOLDER.format(urls=[f"{CHIP}?line=relay", f"serialpin:{PORT}?pin=rts"])
    holder = subprocess.Popen([sys.executable, "-c", source], stdout=subprocess.PIPE)
    assert holder.stdout is not None
    holder.stdout.readline()
    before = level(), "RTS" in modem_register()
    began_s = time.monotonic()
    holder.kill()
    while time.monotonic() - began_s < 2 and level():
        time.sleep(0.0005)
    found: dict[str, object] = {
        "before": before,
        "gpio": level(),
        "gpio_ms": round((time.monotonic() - began_s) * 1e3, 1),
    }
    holder.wait()
    time.sleep(0.05)
    found["rts"] = "RTS" in modem_register()
    return found


if __name__ == "__main__":
    print(json.dumps({"gpio": gpio(), "serial": serial(), "killed": killed()}))
