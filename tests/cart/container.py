"""The machine's file system booted under systemd-nspawn: real systemd at full speed, without devices of its own."""

import os
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Self

from tests.cart.guest import Ended
from tests.cart.image import Image

BOOT_S = 60.0
_QUIET = ("--register=no", "--keep-unit", "--quiet")


def refused(image: Image) -> str:
    """Why systemd-nspawn cannot run even `true` here, in its own words; empty when it can."""
    command = ["systemd-nspawn", *_QUIET, f"--directory={image.root}", "--volatile=overlay", "/bin/true"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=30)
    except subprocess.TimeoutExpired:
        return "it does not answer"
    return (done.stderr.strip() or f"it ends with {done.returncode}") if done.returncode else ""


class Container:
    """One boot; whatever it writes is forgotten. Leaving the context kills it."""

    look_s = 0.1

    def __init__(self, image: Image, folder: Path) -> None:
        self.log = (folder / "container.log").open("ab")
        command = ["systemd-nspawn", *_QUIET, f"--directory={image.root}", "--volatile=overlay"]
        command += ["--console=pipe", "--machine", f"cart{os.getpid()}", "--boot"]
        self.began_s = time.monotonic()
        self.process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=self.log, stderr=self.log)
        self.leader = 0
        try:
            self._await_boot()
        except BaseException:
            self.kill()
            raise
        self.boot_s = time.monotonic() - self.began_s

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.kill()

    def kill(self) -> None:
        """All of it at once: its first process takes every other one with it."""
        if self.leader:
            subprocess.run(["kill", "-KILL", str(self.leader)], check=False, capture_output=True)
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.log.close()

    def _await_boot(self) -> None:
        end_s = time.monotonic() + BOOT_S
        while time.monotonic() < end_s:
            if self.process.poll() is not None:
                raise RuntimeError(f"the container ended: {Path(self.log.name).read_text(errors='replace')[-1500:]}")
            self.leader = self._find_leader()
            if self.leader and self.sh("systemctl is-system-running", check=False).out.strip() in (
                "running",
                "degraded",
            ):
                return
            time.sleep(0.05)
        raise TimeoutError("the container does not come up")

    def _find_leader(self) -> int:
        """The container's first process; before it there are helpers of nspawn, so it is looked for again and again."""
        pid = self.process.pid
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        return int(children[0]) if children else 0

    def sh(self, script: str, check: bool = True, timeout_s: float = 60.0) -> Ended:
        """Run a shell script inside and wait. Raises AssertionError for a failing one unless told not to check."""
        began_s = time.monotonic()
        done = subprocess.run(
            [*self._enter(), "/bin/bash", "-c", script],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
            timeout=timeout_s,
            env={"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "LANG": "C.UTF-8"},
        )
        assert done.returncode == 0 or not check, f"{script}\nended with {done.returncode}:\n{done.stdout[-3000:]}"
        return Ended(done.returncode, done.stdout, time.monotonic() - began_s)

    def put(self, path: str, text: str) -> None:
        """Write a file inside."""
        subprocess.run([*self._enter(), "/usr/bin/tee", path], input=text, text=True, check=True, capture_output=True)

    def _enter(self) -> list[str]:
        return ["nsenter", "--target", str(self.leader), "--mount", "--uts", "--ipc", "--net", "--pid", "--cgroup"]
