"""What the harness needs of the host. Each test names what is missing when it skips."""

import os
import shutil
import subprocess
from functools import cache

TOOLS = {
    "mmdebstrap": "mmdebstrap",
    "mke2fs": "e2fsprogs",
    "dpkg-deb": "dpkg",
    "chroot": "coreutils",
    "qemu-system-x86_64": "qemu-system-x86",
    "qemu-img": "qemu-utils",
    "systemd-nspawn": "systemd-container",
    "nsenter": "util-linux",
    "unshare": "util-linux",
}
"""Program → Debian package."""

IMAGE = ("mmdebstrap", "mke2fs", "dpkg-deb", "chroot", "unshare")
GUEST = (*IMAGE, "qemu-system-x86_64", "qemu-img")
CONTAINER = (*IMAGE, "systemd-nspawn", "nsenter")


@cache
def _may_mount() -> bool:
    """Root within an unprivileged container is not root enough; so it is tried, where nobody else sees it."""
    tried = "mount -t tmpfs none /mnt && mount -t proc proc /proc"
    command = ["unshare", "--mount", "--pid", "--fork", "sh", "-c", tried]
    try:
        return subprocess.run(command, capture_output=True, check=False, timeout=20).returncode == 0
    except (OSError, subprocess.TimeoutExpired):
        return False


def missing(programs: tuple[str, ...]) -> str:
    """Why these cannot be used here, in words; empty when they can."""
    if os.geteuid() != 0:
        return "needs root"
    absent = sorted({TOOLS[name] for name in programs if shutil.which(name) is None})
    if absent:
        return f"needs {', '.join(absent)} (apt install {' '.join(absent)})"
    return "" if _may_mount() else "needs the right to mount file systems, which this container withholds"
