"""Builds probewatch_VERSION~SUITE_ARCH.deb. Needs dpkg-deb, and the Python of `make .venv/dev`.

The locked wheels are laid out under /opt/probewatch as a virtual environment of the target's own Python, so one machine
builds for every suite. Nothing of the target is run here.
"""

import gzip
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from datetime import UTC, datetime
from pathlib import Path

import click
from documents import completions, man_pages
from sbom import sbom

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
PYTHONS = {"bookworm": (11, "deb12"), "trixie": (13, "deb13")}
"""Suite → (minor version of its Python 3, suffix of the package's version)."""
PLATFORMS = ("manylinux_2_28", "manylinux_2_27", "manylinux_2_17", "manylinux2014")
ARCHITECTURE = {"amd64": "x86_64", "arm64": "aarch64"}
LAUNCHER = "#!/opt/probewatch/bin/python3\nimport sys\nfrom probewatch.tools.cli import main\nsys.exit(main())\n"
FILES = {
    "systemd/probewatch.service": "usr/lib/systemd/system/probewatch.service",
    "systemd/probewatch.service.d/10-devices.conf": "usr/lib/systemd/system/probewatch.service.d/10-devices.conf",
    "systemd/probewatch-openigtlink.service": "usr/lib/systemd/system/probewatch-openigtlink.service",
    "systemd/probewatch-metrics.service": "usr/lib/systemd/system/probewatch-metrics.service",
    "systemd/probewatch-mqtt.service": "usr/lib/systemd/system/probewatch-mqtt.service",
    "systemd/probewatch-page.service": "usr/lib/systemd/system/probewatch-page.service",
    "systemd/probewatch-recorder.service": "usr/lib/systemd/system/probewatch-recorder.service",
    "systemd/probewatch-report.service": "usr/lib/systemd/system/probewatch-report.service",
    "systemd/probewatch-report.timer": "usr/lib/systemd/system/probewatch-report.timer",
    "systemd/probewatch.sysusers": "usr/lib/sysusers.d/probewatch.conf",
    "systemd/probewatch.tmpfiles": "usr/lib/tmpfiles.d/probewatch.conf",
    "systemd/probewatch.modules-load": "usr/lib/modules-load.d/probewatch.conf",
    "systemd/60-probewatch.rules": "usr/lib/udev/rules.d/60-probewatch.rules",
    "systemd/watchdog.conf": "usr/lib/systemd/system.conf.d/50-probewatch-watchdog.conf",
    "README.md": "usr/share/doc/probewatch/README.md",
    "LICENSE": "usr/share/doc/probewatch/copyright",
}


@click.command()
@click.argument("out", type=click.Path(file_okay=False, path_type=Path))
@click.argument("suites", metavar="[SUITE]...", nargs=-1, type=click.Choice(list(PYTHONS)))
@click.option("--architecture", type=click.Choice(list(ARCHITECTURE)), default="amd64", show_default=True)
def main(out: Path, suites: tuple[str, ...], architecture: str) -> None:
    """Build the package for each SUITE (bookworm, trixie; both where none is named) into the folder OUT."""
    out.mkdir(parents=True, exist_ok=True)
    for suite in suites or PYTHONS:
        click.echo(build(suite, architecture, out))
    _sums(out)


def build(suite: str, architecture: str, out: Path) -> Path:
    """The package for one suite."""
    minor, suffix = PYTHONS[suite]
    version = f"{_project()['version']}~{suffix}"
    with tempfile.TemporaryDirectory(prefix="probewatch-deb-") as folder:
        tree = Path(folder) / "tree"
        epoch = _run("git", "-C", str(ROOT), "log", "-1", "--format=%ct").strip()
        _environment(tree / "opt/probewatch", minor, ARCHITECTURE[architecture])
        _files(tree)
        built = datetime.fromtimestamp(int(epoch), UTC)
        _documents(tree, built.date().isoformat())
        (site,) = (tree / "opt/probewatch/lib").glob("python3.*/site-packages")
        _put(tree / "usr/share/doc/probewatch/sbom.cdx.json", sbom(site, "probewatch", version, built))
        _control(tree, version, architecture, minor)
        package = out / f"probewatch_{version}_{architecture}.deb"
        _run(
            "dpkg-deb", "--root-owner-group", "-Zzstd", "-z6", "--build", str(tree), str(package),
            SOURCE_DATE_EPOCH=epoch,
        )  # fmt: skip
    return package


def _sums(out: Path) -> None:
    """SHA-256 of every package that lies there, as `sha256sum --check` reads them; docs/security.md has it signed."""
    packages = sorted(out.glob("probewatch_*.deb"))
    lines = [f"{hashlib.sha256(package.read_bytes()).hexdigest()}  {package.name}\n" for package in packages]
    _put(out / "SHA256SUMS", "".join(lines))


def _project() -> dict[str, str]:
    project: dict[str, str] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return project


def _environment(prefix: Path, minor: int, machine: str) -> None:
    """What `python3 -m venv` and pip would leave there, for a Python that need not be here."""
    site = prefix / f"lib/python3.{minor}/site-packages"
    platforms = [option for name in (*PLATFORMS, "linux") for option in ("--platform", f"{name}_{machine}")]
    foreign = [
        "--only-binary=:all:", f"--python-version=3.{minor}", "--implementation=cp", f"--abi=cp3{minor}", "--abi=abi3",
        "--abi=none", *platforms,
    ]  # fmt: skip
    lock = str(ROOT / "requirements.lock")
    _pip("install", "--no-deps", "--require-hashes", "--no-compile", "-r", lock, "--target", str(site), *foreign)
    with tempfile.TemporaryDirectory() as wheels:
        _pip("wheel", "--no-deps", "--wheel-dir", wheels, str(ROOT), PROBEWATCH_MACHINE=machine)
        (wheel,) = Path(wheels).glob("probewatch-*.whl")
        _pip("install", "--no-deps", "--no-compile", "--target", str(site), *foreign, str(wheel))
    shutil.rmtree(site / "bin", ignore_errors=True)
    _put(prefix / "pyvenv.cfg", f"home = /usr/bin\ninclude-system-site-packages = false\nversion = 3.{minor}\n")
    _put(prefix / "bin/probewatch", LAUNCHER, 0o755)
    (prefix / "bin/python3").symlink_to(f"/usr/bin/python3.{minor}")


def _files(tree: Path) -> None:
    for source, target in FILES.items():
        _put(tree / target, (ROOT / source).read_text())
    example = (ROOT / "config/probewatch.toml").read_text()
    config, count = re.subn(r"^# configured = true$", "configured = false", example, flags=re.M)
    assert count == 1, "the example configuration has lost its key 'configured'"
    _put(tree / "etc/probewatch/probewatch.toml", config)
    (tree / "usr/bin").mkdir(parents=True)
    (tree / "usr/bin/probewatch").symlink_to("/opt/probewatch/bin/probewatch")


def _documents(tree: Path, date: str) -> None:
    """Links between README and docs/ hold as in the repository."""
    about = tree / "usr/share/doc/probewatch"
    shutil.copytree(ROOT / "docs", about / "docs", copy_function=shutil.copyfile)
    shutil.copytree(ROOT / "config", about / "examples", copy_function=shutil.copyfile)
    manual = tree / "usr/share/man/man1"
    manual.mkdir(parents=True)
    for name, text in man_pages(_project()["version"], date).items():
        (manual / f"{name}.gz").write_bytes(gzip.compress(text.encode(), mtime=0))
    for target, script in completions().items():
        _put(tree / target, script)


def _control(tree: Path, version: str, architecture: str, minor: int) -> None:
    kib = sum(file.lstat().st_size for file in tree.rglob("*") if file.is_file()) // 1024
    fields = {
        "Package": "probewatch",
        "Version": version,
        "Architecture": architecture,
        "Maintainer": "probewatch <probewatch@localhost>",
        "Installed-Size": str(kib),
        "Depends": f"python3 (>= 3.{minor}), python3 (<< 3.{minor + 1}), systemd (>= 252), udev, init-system-helpers",
        "Section": "science",
        "Priority": "optional",
        "Description": f"{_project()['description']}\n Service, outputs and tools; no certified medical device.",
    }
    _put(tree / "DEBIAN/control", "".join(f"{name}: {value}\n" for name, value in fields.items()))
    _put(tree / "DEBIAN/conffiles", "/etc/probewatch/probewatch.toml\n")
    for script in ("postinst", "prerm", "postrm"):
        _put(tree / "DEBIAN" / script, (HERE / script).read_text(), 0o755)


def _put(path: Path, text: str, mode: int = 0o644) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(mode)


def _pip(*arguments: str, **environment: str) -> None:
    _run(sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", *arguments, **environment)


def _run(*command: str, **environment: str) -> str:
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=os.environ | environment)
    return done.stdout


if __name__ == "__main__":
    os.umask(0o022)
    main()
