"""The machine under QEMU: power, a shell through Debian's qemu-guest-agent, hot-plug through QMP, and its snapshot."""

import base64
import itertools
import json
import os
import shutil
import socket
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from tests.cart.image import Image, alone, run
from tests.support.polling import until

BOOT_S, EXEC_S = 240.0, 120.0
MEMORY_MIB = 2048
ACCEL = os.environ.get("PROBEWATCH_CART_ACCEL", "tcg,thread=multi")
"""Software emulation works everywhere; with `kvm` the same tests run at full speed."""
CPU = "max,-avx2" if ACCEL.startswith("tcg") else "max"
"""QEMU 7.2 emulates AVX2 wrongly: numpy.argpartition ends in a segmentation fault, and the estimator with it."""
SNAPSHOT = "ready"
SCRIPTS, PYTHON = "/usr/local/lib/cart", "/opt/probewatch/bin/python3"


@dataclass(frozen=True, slots=True)
class Ended:
    """What a command in the guest left. seconds: on the host's clock, with the agent's own delay."""

    code: int
    out: str
    seconds: float


@dataclass
class Ports:
    """What hangs at the machine's plugs; None leaves a plug empty. The plugs are the same for every snapshot.

    serial: /dev/ttyS1. usb_serial: plugged later. printed: file that keeps what is written to /dev/ttyS2.
    """

    serial: Path | None = None
    usb_serial: Path | None = None
    scanner: Path | None = None
    printed: Path | None = None


class Guest:
    """One machine in `folder`. Leaving the context pulls the plug."""

    look_s = 0.5
    rate = 1.0
    """Seconds of its cart in a second."""

    def __init__(self, image: Image, folder: Path, ports: Ports | None = None) -> None:
        self.image, self.folder, self.ports = image, folder, ports or Ports()
        self.disk = folder / "disk.qcow2"
        self.process: subprocess.Popen[bytes] | None = None
        self.log = (folder / "qemu.log").open("ab")
        self._ids = itertools.count(1)
        self._scripts_there = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.cut_power()
        self.log.close()

    def fresh_disk(self) -> None:
        """As delivered."""
        self.disk.unlink(missing_ok=True)
        backing = ("-F", "raw", "-b", str(self.image.disk))
        run("qemu-img", "create", "-q", "-f", "qcow2", *backing, str(self.disk))

    def switch_on(self, *more: str) -> float:
        """Cold boot from the disk; seconds until the agent answers. more: options of QEMU."""
        began_s = time.monotonic()
        self._start(*more)
        self.await_agent()
        return time.monotonic() - began_s

    def restore(self) -> None:
        """Go on from the snapshot of a machine that has booted, its service stopped; it is taken at the first use."""
        ready = self.image.folder / f"ready-{CPU}-{MEMORY_MIB}.qcow2"
        with alone(self.image.folder):
            if not ready.exists():
                self._take_snapshot(ready)
        self.resume(ready, SNAPSHOT)
        self.await_agent()
        self.sh(f"date -s @{time.time():.3f} >/dev/null")

    def resume(self, disk: Path, snapshot: str) -> None:
        """Go on from a snapshot in a copy of that disk."""
        shutil.copy(disk, self.disk)
        self._start("-loadvm", snapshot)

    def cut_power(self) -> None:
        """The plug is pulled: nothing in the guest gets a word in."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None

    def _take_snapshot(self, ready: Path) -> None:
        """With empty plugs: the serial port's modem lines are part of it, and stay as what hung there left them."""
        plugged, self.ports = self.ports, Ports()
        self.fresh_disk()
        self.switch_on()
        settle = "systemctl is-system-running --wait; systemctl stop probewatch; sync"
        self.sh(settle, check=False, timeout_s=BOOT_S)
        self.qmp("human-monitor-command", {"command-line": f"savevm {SNAPSHOT}"})
        self.cut_power()
        self.disk.rename(ready)
        self.ports = plugged

    def _start(self, *more: str) -> None:
        self.cut_power()
        self._scripts_there = False
        for left in self.folder.glob("*.sock"):
            left.unlink()
        kernel = "root=/dev/vda rw console=ttyS0 quiet panic=0"
        command = [
            "qemu-system-x86_64", "-M", "q35", "-accel", ACCEL, "-cpu", CPU, "-smp", "2", "-m", str(MEMORY_MIB),
            "-nodefaults", "-display", "none", "-kernel", str(self.image.kernel), "-initrd", str(self.image.initrd),
            "-append", kernel, "-drive", f"file={self.disk},if=none,id=disk,format=qcow2,cache=writeback",
            "-device", "virtio-blk-pci,drive=disk", "-device", "i6300esb", "-action", "watchdog=reset",
            "-chardev", f"file,id=console,path={self.folder}/console.log,append=on",
            "-device", "isa-serial,chardev=console,index=0", "-device", "qemu-xhci,id=usb",
            "-device", "virtio-serial-pci", *self._socket("agent"),
            "-device", "virtserialport,chardev=agent,name=org.qemu.guest_agent.0",
            "-qmp", f"unix:{self.folder}/qmp.sock,server=on,wait=off", *self._plugs(), *more,
        ]  # fmt: skip
        self.process = subprocess.Popen(command, stdout=self.log, stderr=self.log, stdin=subprocess.DEVNULL)

    def _socket(self, name: str) -> list[str]:
        return ["-chardev", f"socket,id={name},path={self.folder}/{name}.sock,server=on,wait=off"]

    def _plugs(self) -> list[str]:
        ports, found = self.ports, []
        serial = "null,id=serial" if ports.serial is None else f"serial,id=serial,path={ports.serial}"
        found += ["-chardev", serial, "-device", "isa-serial,chardev=serial,index=1"]
        printed = "null,id=printed" if ports.printed is None else f"file,id=printed,path={ports.printed}"
        found += ["-chardev", printed, "-device", "isa-serial,chardev=printed,index=2"]
        if ports.usb_serial is not None:
            found += ["-chardev", f"serial,id=usb-serial,path={ports.usb_serial}"]
        scanner = f"socket,id=scanner,path={ports.scanner},reconnect=1" if ports.scanner else "null,id=scanner"
        return [*found, "-chardev", scanner, "-device", "virtserialport,chardev=scanner,name=cart.scanner"]

    def plug_usb_serial(self) -> None:
        self.qmp("device_add", {"driver": "usb-serial", "chardev": "usb-serial", "id": "adapter", "bus": "usb.0"})

    def unplug_usb_serial(self) -> None:
        self.qmp("device_del", {"id": "adapter"})

    def qmp(self, command: str, arguments: dict[str, Any] | None = None) -> Any:
        """Answer of QEMU's monitor. Raises RuntimeError for a refusal."""
        with self._connected("qmp") as line, line.makefile("rwb") as stream:
            stream.readline()
            for one in ({"execute": "qmp_capabilities"}, {"execute": command, "arguments": arguments or {}}):
                stream.write(json.dumps(one).encode() + b"\n")
                stream.flush()
                answer = self._answer(stream)
        return answer

    @staticmethod
    def _answer(stream: Any) -> Any:
        for line in stream:
            said = json.loads(line)
            if "error" in said:
                raise RuntimeError(f"QEMU refuses: {said['error']['desc']}")
            if "return" in said:
                return said["return"]
        raise RuntimeError("QEMU closed its monitor")

    def _connected(self, name: str) -> socket.socket:
        end_s = time.monotonic() + 10
        while True:
            line = socket.socket(socket.AF_UNIX)
            line.settimeout(BOOT_S)
            try:
                line.connect(str(self.folder / f"{name}.sock"))
                return line
            except OSError:
                line.close()
                assert self.process is not None
                if time.monotonic() > end_s or self.process.poll() is not None:
                    self.log.flush()
                    raise RuntimeError(f"QEMU does not run: {(self.folder / 'qemu.log').read_text()[-800:]}") from None
                time.sleep(0.02)

    def await_agent(self, deadline_s: float = BOOT_S) -> None:
        """Raises TimeoutError with the end of the console when the machine does not come up."""
        end_s = time.monotonic() + deadline_s
        while time.monotonic() < end_s:
            try:
                self._agent("guest-ping", timeout_s=1.0)
                return
            except TimeoutError:
                continue
        raise TimeoutError(f"the guest does not come up; its console ends: {self.console()[-1500:]}")

    def console(self) -> str:
        return (self.folder / "console.log").read_text(errors="replace")

    def _agent(self, command: str, arguments: dict[str, Any] | None = None, timeout_s: float = EXEC_S) -> Any:
        """One request on a connection of its own, after a synchronisation that leaves old answers behind."""
        number = next(self._ids)
        with self._connected("agent") as line, line.makefile("rwb") as stream:
            line.settimeout(timeout_s)
            sync = {"execute": "guest-sync-delimited", "arguments": {"id": number}}
            stream.write(b"\xff" + json.dumps(sync).encode() + b"\n")
            stream.flush()
            while json.loads(stream.readline().rpartition(b"\xff")[2] or b"{}").get("return") != number:
                continue
            request = {"execute": command} | ({"arguments": arguments} if arguments else {})
            stream.write(json.dumps(request).encode() + b"\n")
            stream.flush()
            answer = json.loads(stream.readline() or b"{}")
        if "error" in answer:
            raise RuntimeError(f"the guest agent refuses {command}: {answer['error']['desc']}")
        return answer.get("return")

    def sh(self, script: str, check: bool = True, timeout_s: float = EXEC_S) -> Ended:
        """Run a shell script in the guest and wait. Raises AssertionError for a failing one if it shall check."""
        began_s = time.monotonic()
        pid = self._begin(script, capture=True)
        while not (status := self._agent("guest-exec-status", {"pid": pid}))["exited"]:
            if time.monotonic() - began_s > timeout_s:
                raise TimeoutError(f"after {timeout_s:g} s the guest still runs: {script}")
            time.sleep(0.02)
        out = "".join(
            base64.b64decode(status.get(key, "")).decode(errors="replace") for key in ("out-data", "err-data")
        )
        ended = Ended(status.get("exitcode", -int(status.get("signal", 1))), out, time.monotonic() - began_s)
        assert ended.code == 0 or not check, f"{script}\nended with {ended.code}:\n{ended.out[-3000:]}"
        return ended

    def reload_units(self) -> None:
        """As systemctl daemon-reload; systemd may then start this machine's agent again, and what it runs with it."""
        self.begin("systemctl daemon-reload")
        until(lambda: not self._needs_reload(), EXEC_S, self.look_s, lambda: "the units are not read again")

    def _needs_reload(self) -> bool:
        try:
            return self.sh("systemctl show -P NeedDaemonReload probewatch", timeout_s=10).out.strip() != "no"
        except (RuntimeError, TimeoutError, AssertionError):
            return True

    def begin(self, script: str) -> None:
        """Run it in the background."""
        self._begin(f"({script}) </dev/null >>/run/cart-background.log 2>&1", capture=False)

    def _begin(self, script: str, capture: bool) -> int:
        arguments = {"path": "/bin/bash", "arg": ["-c", script], "capture-output": capture}
        return int(self._agent("guest-exec", arguments)["pid"])

    def script(self, name: str, *arguments: str, timeout_s: float = EXEC_S) -> Any:
        """Run one of tests/cart/inside with the package's Python; what it prints as JSON."""
        self.put_scripts()
        words = " ".join(arguments)
        return json.loads(self.sh(f"{PYTHON} {SCRIPTS}/{name}.py {words}", timeout_s=timeout_s).out)

    def put_scripts(self) -> None:
        """All of them, once: they import each other."""
        if self._scripts_there:
            return
        self._scripts_there = True
        for source in (Path(__file__).parent / "inside").glob("*.py"):
            self.put(f"{SCRIPTS}/{source.name}", source.read_text())

    def put(self, path: str, text: str) -> None:
        """Write a file in the guest."""
        handle = self._agent("guest-file-open", {"path": path, "mode": "w"})
        self._agent("guest-file-write", {"handle": handle, "buf-b64": base64.b64encode(text.encode()).decode()})
        self._agent("guest-file-close", {"handle": handle})
