"""`python -m tests.rules.pythons [VERSION … | --by-turns]`: the quick tests on other supported Pythons, on all of them
where none is named. By turns, as the gate runs it, it is one, another one with each commit, and a third of the tests:
six commits in a row run every test on both.

Each has an environment of its own. An interpreter that this machine has is taken: one on the path, or one of pyenv's.
For the version that Debian 13 has, root may do without: its own Python in Debian 13's files under build/, made by
mmdebstrap from the mirror that apt uses. What could not be had is said, and is no failure.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from tests.cart.image import NoMirror, bootstrap
from tests.cart.requirements import missing
from tests.rules.third import commits

ROOT = Path(__file__).parents[2]
VERSIONS = ("3.11", "3.12", "3.13")
BY_TURNS = "--by-turns"
DEBIAN = {"3.13": "trixie"}
"""Version → the Debian whose Python it is, where another one than this machine's can bring it."""
PACKAGES = (
    "python3-venv,git,make,gcc,libc6-dev,udev,systemd,alsa-utils,man-db,dpkg-dev,procps,ca-certificates,prometheus,"
    "openssh-client"
)
PLACE = ROOT / "build"
_SHARED = ROOT.parent / "shared"


def main(asked: list[str]) -> int:
    here = f"3.{sys.version_info.minor}"
    others = [version for version in VERSIONS if version != here]
    chosen, third = in_turn(others, commits(ROOT)) if asked == [BY_TURNS] else (asked or others, "")
    results = {version: tried(version, third) for version in chosen}
    print(f"\nquick tests on Python {here}: see make test")
    for version in dict.fromkeys([*results, *others]):
        which = f", third {third}" if third and version in results else ""
        print(f"quick tests on Python {version}{which}: {results.get(version, 'LEFT OUT') or 'passed'}")
    return int(any(result == "FAILED" for result in results.values()))


def in_turn(versions: list[str], commit: int | None) -> tuple[list[str], str]:
    """(the one of the commit, and its third of the tests), which is given as how many lie behind it; all where that is
    not known.
    """
    if commit is None:
        return versions, ""
    return [versions[commit % len(versions)]], str(commit // len(versions) % 3 + 1)


def tried(version: str, third: str = "") -> str:
    """Empty where the tests pass; FAILED; or why they were left out. third: which of them, "" for all."""
    if python := interpreter(version):
        print(f"\nPython {version}: {python}", flush=True)
        return _quick(["make", "-C", str(ROOT)], str(python), ROOT / f".venv-{version}", third)
    if version not in DEBIAN:
        return f"LEFT OUT, this machine has no python{version} and no Debian does"
    if why := missing(("mmdebstrap", "chroot", "unshare")):
        return f"LEFT OUT, this machine has no python{version}; Debian's own {why}"
    try:
        root = _debian(DEBIAN[version])
    except NoMirror as error:
        return f"LEFT OUT, this machine has no python{version}, and the Debian mirror does not answer: {error}"
    print(f"\nPython {version}: Debian's own in {root}", flush=True)
    return _quick(_inside(root), f"python{version}", Path("/opt/venv"), third)


def interpreter(version: str) -> Path | None:
    """One that answers with this version and can make environments."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    on_path = shutil.which(f"python{version}")
    found = [Path(on_path)] if on_path else []
    found += sorted(pyenv.glob(f"{version}.*/bin/python{version}"), reverse=True)
    ask = "import ensurepip, venv, sys; print('%d.%d' % sys.version_info[:2])"
    for python in found:
        done = subprocess.run([python, "-c", ask], capture_output=True, text=True, check=False)
        if (done.returncode, done.stdout.strip()) == (0, version):
            return python
    return None


def _quick(make: list[str], python: str, environment: Path, third: str) -> str:
    command = [*make, "quick", f"PYTHON={python}", f"VENV={environment}", f"THIRD={third}"]
    return "" if subprocess.run(command, check=False, stdin=subprocess.DEVNULL).returncode == 0 else "FAILED"


def _debian(suite: str) -> Path:
    """Its files with Python and what the tests need, made once. Raises NoMirror."""
    root = PLACE / suite
    done = root / "opt/made-for"
    if not (done.exists() and done.read_text() == PACKAGES):
        shutil.rmtree(root, ignore_errors=True)
        PLACE.mkdir(exist_ok=True)
        bootstrap(suite, PACKAGES, root, "minbase")
        for given in ("/etc/resolv.conf", "/etc/ssl/certs/ca-certificates.crt"):
            shutil.copy(given, root / given.lstrip("/"))
        done.write_text(PACKAGES)
    return root


def _inside(root: Path) -> list[str]:
    """make in the checkout, as that Debian sees it: the same folder, mounted where nobody else sees it."""
    script = (
        'mkdir -p "$1$2" "$1$3"; mount --bind "$2" "$1$2"; [ ! -d "$3" ] || mount --bind "$3" "$1$3"; '
        'mount --rbind /dev "$1/dev"; mount -t proc proc "$1/proc"; '
        'mount -t tmpfs tmpfs "$1/tmp"; mount -t tmpfs tmpfs "$1/run"; '
        'root=$1 checkout=$2; shift 3; exec chroot "$root" make -C "$checkout" "$@"'
    )
    private = ["unshare", "--mount", "--pid", "--fork", "--kill-child", "sh", "-ec", script, "inside"]
    return [*private, str(root), str(ROOT), str(_SHARED)]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
