"""`python -m tests.arm64 [PYTEST ARGUMENTS]`: the package for arm64, built here and run by qemu-user.

In Debian's own files for arm64 under build/arm64, with a binfmt_misc of its own, so that nothing of this machine is
changed. First registration and line on stored pictures on both machines, compared; then the quick tests, or what the
arguments name. What could not be had is said, with exit code 2.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from tests.arm64 import figures
from tests.cart.image import NoMirror, bootstrap
from tests.cart.requirements import missing

ROOT = Path(__file__).parents[2]
PLACE = ROOT / "build/arm64"
SYSTEM, CHECKOUT = PLACE / "root", "checkout"
SUITE, SITE = "bookworm", "opt/probewatch/lib/python3.11/site-packages"
QEMU = "qemu-aarch64-static"
PACKAGES = (
    "python3,libpython3-stdlib,libstdc++6,base-files,base-passwd,netbase,bash,coreutils,dash,findutils,git,grep,make,"
    "openssh-client,openssl,procps,sed,tzdata,util-linux"
)
QUICK = "not thorough and not slow and not live and not cart and not deb"
NO_WHEEL = {
    "crcmod", "greenlet", "grimp", "import-linter", "librt", "mypy", "mypy-extensions", "ndicapi", "optype",
    "playwright", "pre-commit", "pyee", "pyigtl", "ruff", "scikit-surgerycore", "scikit-surgerynditracker",
    "scipy-stubs", "types-pyserial", "vulture",
}  # fmt: skip
"""Of the development lock: crcmod has no wheel for arm64, and with it pyigtl and scikit-surgerynditracker; the others
judge the sources, which are the same.
"""
LEFT_OUT = (
    "tests/drivers/openigtlink/test_connection.py",
    "tests/drivers/openigtlink/test_tracker.py",
    "tests/drivers/openigtlink/test_video.py",
    "tests/drivers/twins/test_openigtlink.py",
)
"""qemu-user 7.2 answers TCP_INFO with four bytes: without the round trip time, by which an OpenIGTLink server's stamps
are placed, none can be opened there. A kernel for arm64 gives it.
"""
MAGIC = (
    r":aarch64:M::\x7fELF\x02\x01\x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x02\x00\xb7\x00"
    r":\xff\xff\xff\xff\xff\xff\xff\x00\xff\xff\xff\xff\xff\xff\xff\xff\xfe\xff\xff\xff:"
)
"""How an executable for arm64 begins, as Debian's qemu-user-static tells binfmt_misc."""
INSIDE = """
mount -t binfmt_misc none /proc/sys/fs/binfmt_misc
printf '%s' "$1" > /proc/sys/fs/binfmt_misc/register
cd "$2"
mount --rbind /dev dev; mount -t proc proc proc; mount -t tmpfs tmpfs tmp; mount -t tmpfs tmpfs run
shift 2
exec chroot . /usr/bin/env -i -C /checkout PATH=/usr/bin:/bin HOME=/tmp LANG=C.UTF-8 OMP_NUM_THREADS=1 \
  OPENBLAS_NUM_THREADS=1 PYTHONPATH="/checkout/tools/development/package:/$SITE:/opt/tests" python3 "$@"
"""


class NotRun(Exception):  # noqa: N818  it says what is missing
    """What this machine lacks."""


def main(arguments: list[str]) -> int:
    try:
        _lacking()
        _system()
    except (NotRun, NoMirror) as error:
        print(f"NOT RUN: {error}", file=sys.stderr)
        return 2
    same = _compared()
    print(f"LEFT OUT, since qemu does not tell TCP's round trip time: {', '.join(LEFT_OUT)}", flush=True)
    left_out = [f"--ignore={name}" for name in LEFT_OUT]
    tests = ["-m", "pytest", *left_out, "-p", "no:cacheprovider", "-m", QUICK, *(arguments or ["-n", "2"])]
    return emulated(*tests) or int(not same)


def emulated(*arguments: str) -> int:
    """Exit code of Debian's Python for arm64 with the package's modules, in the checkout."""
    format_ = rf"{MAGIC}{shutil.which(QEMU)}:OCF"
    private = [
        "unshare",
        "--map-root-user",
        "--mount",
        "--pid",
        "--fork",
        "--kill-child",
        "sh",
        "-ec",
        INSIDE,
        "inside",
    ]
    command = [*private, format_, str(SYSTEM), *arguments]
    return subprocess.run(command, env=os.environ | {"SITE": SITE}, stdin=subprocess.DEVNULL, check=False).returncode


def _lacking() -> None:
    """Raises NotRun."""
    if why := missing(("mmdebstrap", "dpkg-deb", "chroot", "unshare")):
        raise NotRun(why)
    if shutil.which(QEMU) is None:
        raise NotRun("needs qemu-user-static (apt install qemu-user-static)")
    tried = ["unshare", "--map-root-user", "--mount", "mount", "-t", "binfmt_misc", "none", "/proc/sys/fs/binfmt_misc"]
    if subprocess.run(tried, capture_output=True, check=False).returncode:
        raise NotRun("needs a binfmt_misc of its own: Linux 6.7 or newer, and the right to mount")


def _system() -> None:
    """Debian and what the tests need are made once; the package and the checkout each time. Raises NoMirror."""
    made, recipe = PLACE / "made-for", f"{PACKAGES}\n{_lock()}"
    if not (made.exists() and made.read_text() == recipe):
        shutil.rmtree(PLACE, ignore_errors=True)
        PLACE.mkdir(parents=True)
        bootstrap(SUITE, PACKAGES, SYSTEM, "extract", "arm64")
        for name in ("passwd", "group"):
            shutil.copy(SYSTEM / f"usr/share/base-passwd/{name}.master", SYSTEM / f"etc/{name}")
        _wheels(SYSTEM / "opt/tests")
        made.write_text(recipe)
    for old in (SYSTEM / "opt/probewatch", SYSTEM / CHECKOUT, PLACE / "package"):
        shutil.rmtree(old, ignore_errors=True)
    build = [sys.executable, "systemd/deb/build.py", str(PLACE / "package"), SUITE, "--architecture", "arm64"]
    subprocess.run(build, cwd=ROOT, check=True)
    (package,) = (PLACE / "package").glob("*.deb")
    subprocess.run(["dpkg-deb", "-x", str(package), str(SYSTEM)], check=True)
    _checkout()


def _checkout() -> None:
    """Tests and pages of the checkout beside the package's own modules, so that nothing else can be imported."""
    every = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(every, cwd=ROOT, check=True, stdout=subprocess.PIPE).stdout
    (SYSTEM / CHECKOUT).mkdir()
    subprocess.run(["xargs", "-0", "cp", "--parents", "-t", str(SYSTEM / CHECKOUT)], cwd=ROOT, check=True, input=listed)
    for name in ("appliance", "drivers", "tools"):
        shutil.copytree(SYSTEM / SITE / "probewatch" / name, SYSTEM / CHECKOUT / name, dirs_exist_ok=True)


def _lock() -> str:
    """What the tests need besides the package, with hashes."""
    blocks = re.split(r"(?m)^(?=[a-z])", (ROOT / "requirements-dev.lock").read_text())[1:]
    carried = {block.split("==")[0] for block in re.split(r"(?m)^(?=[a-z])", (ROOT / "requirements.lock").read_text())}
    return "".join(block for block in blocks if block.split("==")[0] not in NO_WHEEL | carried)


def _wheels(target: Path) -> None:
    lock = PLACE / "wheels.lock"
    lock.write_text(_lock())
    platforms = [f"--platform=manylinux_2_{glibc}_aarch64" for glibc in (28, 27, 26, 24, 17)]
    foreign = ["--only-binary=:all:", "--python-version=3.11", "--implementation=cp", "--abi=cp311", "--abi=abi3",
               "--abi=none", *platforms, "--platform=manylinux2014_aarch64"]  # fmt: skip
    pip = [
        sys.executable,
        "-m",
        "pip",
        "--disable-pip-version-check",
        "--quiet",
        "install",
        "--no-deps",
        "--no-compile",
    ]
    subprocess.run([*pip, "--require-hashes", "-r", str(lock), "--target", str(target), *foreign], check=True)


def _compared() -> bool:
    """Says how far apart both machines are; False where that is more than stated."""
    session = SYSTEM / CHECKOUT / "session.npz"
    figures.store(session)
    here = figures.figures(session)
    if emulated("-m", "tests.arm64.figures", session.name, "figures.json"):
        print("registration and line FAILED on arm64")
        return False
    there = json.loads((session.parent / "figures.json").read_text())
    session.unlink()
    told, largest = figures.differences(here, there)
    print(
        f"\n{there['machine']} beside {here['machine']}, {len(here['pairs'])} pairs, {len(here['verdicts'])} verdicts:"
    )
    print("  largest difference: " + ", ".join(f"{value:.2g} {what}" for what, value in largest.items()))
    for one in (here, there):
        print(f"  {one['machine']}: {one['pair_ms']:.1f} ms of the processor a pair, {one['picture_ms']:.1f} a picture")
    print("  CAUTION: qemu translates each instruction, so its times say nothing of a processor for arm64.")
    for what in told:
        print(f"  DIFFERENT: {what}")
    sys.stdout.flush()
    return not told


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
