"""What the harness needs of the host. Each test names what is missing when it skips."""

import os
import shutil
from pathlib import Path

CAP_SYS_ADMIN = 21
"""Of linux/capability.h."""

TOOLS = {
    "mmdebstrap": "mmdebstrap",
    "mke2fs": "e2fsprogs",
    "dpkg-deb": "dpkg",
    "chroot": "coreutils",
    "qemu-system-x86_64": "qemu-system-x86",
    "qemu-img": "qemu-utils",
    "systemd-nspawn": "systemd-container",
    "nsenter": "util-linux",
}
"""Program → Debian package."""

IMAGE = ("mmdebstrap", "mke2fs", "dpkg-deb", "chroot")
GUEST = (*IMAGE, "qemu-system-x86_64", "qemu-img")
CONTAINER = (*IMAGE, "systemd-nspawn", "nsenter")


def _may_mount() -> bool:
    """Root within an unprivileged container is not root enough."""
    (held,) = (line.split()[1] for line in Path("/proc/self/status").read_text().splitlines() if "CapEff" in line)
    return bool(int(held, 16) >> CAP_SYS_ADMIN & 1)


def missing(programs: tuple[str, ...]) -> str:
    """Why these cannot be used here, in words; empty when they can."""
    if os.geteuid() != 0:
        return "needs root"
    if not _may_mount():
        return "needs the right to mount file systems (CAP_SYS_ADMIN), which this container withholds"
    absent = sorted({TOOLS[name] for name in programs if shutil.which(name) is None})
    return f"needs {', '.join(absent)} (apt install {' '.join(absent)})" if absent else ""
