"""The machine's files, built once and kept: kernel module, root file system with the package, disk.

Everything lies under PROBEWATCH_CART_CACHE (default ~/.cache/probewatch-cart)/SUITE; each part is built again when what
it is made from has changed. The mirror is the one that this host's apt uses.
"""

import fcntl
import hashlib
import inspect
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
HOST_SOURCES = (Path("/etc/apt/sources.list.d/debian.sources"), Path("/etc/apt/sources.list"))
KERNEL_SOURCE = {"bookworm": "6.1", "trixie": "6.12"}
PACKAGES = (
    "systemd-sysv,udev,kmod,procps,e2fsprogs,python3,dbus,v4l-utils,qemu-guest-agent,linux-image-amd64,"
    "init-system-helpers,gpiod"
)
"""e2fsprogs: Debian 13 has it no longer in every system, and the initrd takes its file system check from there."""
BUILD_PACKAGES = "gcc,make,xz-utils,linux-headers-amd64,linux-source-{source}"
MASKED = [
    "serial-getty@ttyS0.service",
    "getty@tty1.service",
    "e2scrub_reap.service",
    "e2scrub_all.timer",
    "apt-daily.timer",
    "apt-daily-upgrade.timer",
    "dpkg-db-backup.timer",
    "fstrim.timer",
    "systemd-binfmt.service",
    "systemd-pstore.service",
]
GPIO_SIM = "gpio-sim-cart"


def suite() -> str:
    """Which Debian the machine runs."""
    return os.environ.get("PROBEWATCH_CART_SUITE", "bookworm")


class NoMirror(Exception):  # noqa: N818  it says what is missing
    """The Debian mirror of this host does not answer."""


@dataclass(frozen=True, slots=True)
class Image:
    """Where the built parts lie."""

    folder: Path

    @property
    def root(self) -> Path:
        """The root file system with the package installed, as files."""
        return self.folder / "root"

    @property
    def disk(self) -> Path:
        """The same as a raw ext4 disk."""
        return self.folder / "disk.img"

    @property
    def kernel(self) -> Path:
        return self.folder / "vmlinuz"

    @property
    def initrd(self) -> Path:
        return self.folder / "initrd.img"


def build(name: str | None = None) -> Image:
    """Every part that is not there yet or out of date. Takes minutes the first time, a second afterwards."""
    name = name or suite()
    default = Path.home() / ".cache/probewatch-cart"
    folder = Path(os.environ.get("PROBEWATCH_CART_CACHE", default)) / name
    folder.mkdir(parents=True, exist_ok=True)
    with alone(folder):
        return _built(Image(folder), name)


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Tests that run beside each other wait here until one of them has made what all use."""
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _built(image: Image, name: str) -> Image:
    folder = image.folder
    module_key = _key(BUILD_PACKAGES, inspect.getsource(_kernel_module), name)
    base_key = _key(PACKAGES, name)
    package_key = _key(*_package_sources(), name)
    with ThreadPoolExecutor() as beside:
        parts = (
            beside.submit(_part, folder, "kernel module", module_key, lambda: _kernel_module(image, name)),
            beside.submit(_part, folder, "base system", base_key, lambda: _base(image, name)),
            beside.submit(_part, folder, "package", package_key, lambda: _package(image, name)),
        )
    for part in parts:
        part.result()
    inside_key = _key(*_baked_in(), inspect.getsource(_root) + inspect.getsource(_inside))
    root_key = _key(module_key, base_key, package_key, inside_key)
    _part(folder, "root", root_key, lambda: _root(image))
    _part(folder, "disk", root_key, lambda: _disk(image))
    return image


def package_of(image: Image) -> Path:
    """The .deb that was installed."""
    (package,) = (image.folder / "deb").glob("*.deb")
    return package


def _key(*parts: Path | str) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part.read_bytes() if isinstance(part, Path) else part.encode())
    return digest.hexdigest()


def _package_sources() -> list[Path]:
    folders = ("appliance", "drivers", "tools", "systemd", "config")
    found = [path for folder in folders for path in (ROOT / folder).rglob("*") if path.is_file()]
    return sorted(path for path in [*found, ROOT / "requirements.lock"] if path.suffix != ".pyc")


def _baked_in() -> list[Path]:
    """What the machine has from its first boot on; scripts are put there by the tests that use them."""
    return sorted(path for path in (HERE / "inside").iterdir() if path.suffix not in (".py", ".pyc", ""))


def _part(folder: Path, name: str, key: str, make: Callable[[], None]) -> None:
    stamp = folder / f"{name.replace(' ', '-')}.key"
    if stamp.exists() and stamp.read_text() == key:
        return
    stamp.unlink(missing_ok=True)
    began_s = time.monotonic()
    make()
    stamp.write_text(key)
    print(f"cart image: {name} in {time.monotonic() - began_s:.0f} s", file=sys.stderr, flush=True)


def _sources(name: str, target: Path) -> str:
    """A file beside the target with apt's sources for the suite, from this host's own."""
    host = next((path for path in HOST_SOURCES if path.exists()), None)
    if host is None:
        raise NoMirror(f"this host's apt has none in {' or '.join(map(str, HOST_SOURCES))}")
    text = re.sub(r"\b(bookworm|trixie)\b", name, host.read_text())
    place = target.with_name(f"{target.name}{host.suffix}")
    place.write_text("".join(f"{line}\n" for line in text.splitlines() if not line.startswith("#")))
    return str(place)


def _kernel_module(image: Image, name: str) -> None:
    """gpio-sim and irq_sim, which Debian's kernels leave out, as one module outside the tree.

    irq_to_desc() is not exported to modules; its descriptor is reached through what is. hold=1 keeps a line's last
    level when its owner goes, as many real controllers do; without it the line returns to its pull.
    """
    build_root, source = image.folder / "build", KERNEL_SOURCE[name]
    shutil.rmtree(build_root, ignore_errors=True)
    bootstrap(name, BUILD_PACKAGES.format(source=source), build_root, "apt")
    place = build_root / "gpio-sim"
    place.mkdir()
    inner = f"linux-source-{source}"
    wanted = [f"{inner}/drivers/gpio", f"{inner}/kernel/irq/irq_sim.c"]
    archive = build_root / f"usr/src/{inner}.tar.xz"
    run("tar", "-C", str(place), "--strip-components=3", "-xJf", str(archive), *wanted)
    _adapt(place / "irq_sim.c", "irq_to_desc(irqnum)", "irq_data_to_desc(irq_get_irq_data(irqnum))")
    free = re.search(
        r"static void gpio_sim_free\(.*?\n\{.*?gpiochip_get_data\(gc\);\n", (place / "gpio-sim.c").read_text(), re.S
    )
    assert free is not None, "this kernel's gpio-sim is not understood"
    head = "static bool hold;\nmodule_param(hold, bool, 0644);\n\n"
    _adapt(place / "gpio-sim.c", free[0], f"{head}{free[0]}\n\tif (hold)\n\t\treturn;\n")
    (place / "Kbuild").write_text(f"obj-m := {GPIO_SIM}.o\n{GPIO_SIM}-y := gpio-sim.o irq_sim.o\n")
    run("chroot", str(build_root), "sh", "-c", "make -s -C /lib/modules/*/build M=/gpio-sim modules")
    shutil.copy(place / f"{GPIO_SIM}.ko", image.folder)
    (image.folder / "kernel-version").write_text(next((build_root / "lib/modules").iterdir()).name)
    shutil.rmtree(build_root)


def _adapt(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text, f"{path.name} of this kernel is not understood"
    path.write_text(text.replace(old, new))


def _base(image: Image, name: str) -> None:
    bootstrap(name, PACKAGES, image.folder / "base.tar", "minbase")


def bootstrap(name: str, packages: str, target: Path, variant: str, architecture: str | None = None) -> None:
    """architecture: another than this machine's, for which nothing can be run: variant extract. Raises NoMirror."""
    options = ("-q", f"--variant={variant}", f"--include={packages}")
    options += (f"--architectures={architecture}",) if architecture else ()
    try:
        run("mmdebstrap", *options, name, str(target), _sources(name, target))
    except RuntimeError as error:
        if silent := re.search("(?m)^.*(Could not (connect|resolve)|Temporary failure resolving).*$", str(error)):
            raise NoMirror(silent[0].strip()) from error
        raise


def _package(image: Image, name: str) -> None:
    shutil.rmtree(image.folder / "deb", ignore_errors=True)
    run(sys.executable, str(ROOT / "systemd/deb/build.py"), str(image.folder / "deb"), name)


def _root(image: Image) -> None:
    root = image.root
    shutil.rmtree(root, ignore_errors=True)
    root.mkdir()
    run("tar", "-C", str(root), "--numeric-owner", "-xpf", str(image.folder / "base.tar"))
    release = (image.folder / "kernel-version").read_text()
    if not (root / "lib/modules" / release).is_dir():
        raise RuntimeError(f"the mirror changed between two steps; remove {image.folder} and build again")
    modules = root / "lib/modules" / release / "updates"
    modules.mkdir(exist_ok=True)
    shutil.copy(image.folder / f"{GPIO_SIM}.ko", modules)
    shutil.copy(package_of(image), root / "probewatch.deb")
    run("chroot", str(root), "dpkg", "-i", "/probewatch.deb")
    _inside(root, release)


def _inside(root: Path, release: str) -> None:
    place = root / "usr/local/lib/cart"
    place.mkdir()
    for file in _baked_in():
        shutil.copy(file, place)
        (place / file.name).chmod(0o755 if file.suffix == ".sh" else 0o644)
    shutil.copy(place / "cart-devices.service", root / "etc/systemd/system")
    shutil.copy(place / "modprobe.conf", root / "etc/modprobe.d/cart.conf")
    (root / "etc/modules-load.d/cart.conf").write_text(f"vivid\n{GPIO_SIM}\ni6300esb\nftdi_sio\n")
    (root / "etc/fstab").write_text("/dev/vda / ext4 defaults 0 1\n")
    (root / "etc/hostname").write_text("cart\n")
    tuned = root / "etc/initramfs-tools/initramfs.conf"
    tuned.write_text(re.sub(r"(?m)^MODULES=.*", "MODULES=list", tuned.read_text()) + "FSTYPE=ext4\n")
    with (root / "etc/initramfs-tools/modules").open("a") as wanted:
        wanted.write("virtio_pci\nvirtio_blk\next4\n")
    for command in (
        ["depmod", release],
        ["update-initramfs", "-u"],
        ["passwd", "-qd", "root"],
        ["systemctl", "-q", "mask", *MASKED],
        ["systemctl", "-q", "enable", "cart-devices.service", "qemu-guest-agent.service"],
    ):
        run("chroot", str(root), *command)


def _disk(image: Image) -> None:
    boot = image.root / "boot"
    shutil.copy(next(boot.glob("vmlinuz-*")), image.kernel)
    shutil.copy(next(boot.glob("initrd.img-*")), image.initrd)
    image.disk.unlink(missing_ok=True)
    with image.disk.open("wb") as disk:
        disk.truncate(3 << 30)
    run("mke2fs", "-q", "-t", "ext4", "-L", "cart", "-d", str(image.root), str(image.disk))
    for snapshot in image.folder.glob("ready*.qcow2"):
        snapshot.unlink()


def run(*command: str) -> str:
    """Standard output. Raises RuntimeError with what the command said."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PIP_", "PYTHON"))}
    environment |= {name: value for name, value in os.environ.items() if name.startswith("PIP_")}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode:
        raise RuntimeError(
            f"{' '.join(command)} failed ({done.returncode}):\n{done.stdout[-2000:]}{done.stderr[-4000:]}"
        )
    return done.stdout


if __name__ == "__main__":
    print(build().folder)
