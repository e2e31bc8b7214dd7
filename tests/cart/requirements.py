"""What the harness needs of the host. Each test names what is missing when it skips.

`python -m tests.cart.requirements` prints the Debian packages that this host lacks.
"""

import os
import shutil
import subprocess
from collections.abc import Iterable
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


def absent(programs: Iterable[str] = tuple(TOOLS)) -> list[str]:
    """The Debian packages to install for these programs."""
    return sorted({TOOLS[name] for name in programs if shutil.which(name) is None})


def missing(programs: tuple[str, ...]) -> str:
    """Why these cannot be used here, in words; empty when they can."""
    if os.geteuid() != 0:
        return "needs root"
    if packages := absent(programs):
        return f"needs {', '.join(packages)} (apt install {' '.join(packages)})"
    return "" if _may_mount() else "needs the right to mount file systems, which this container withholds"


if __name__ == "__main__":
    print(*absent())
