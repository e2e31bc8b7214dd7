"""What is in the built package: `make test-deb`. Runs what it can of it on this machine, without installing it."""

import hashlib
import json
import re
import subprocess
from importlib.metadata import distributions
from pathlib import Path

import pytest

from tests.systemd.test_package_sources import COMMANDS, PAGES

ROOT = Path(__file__).parents[2]
PACKAGES = sorted((ROOT / "dist").glob("probewatch_*.deb"))
OPT = "opt/probewatch"
pytestmark = pytest.mark.deb


@pytest.fixture(scope="session", params=PACKAGES, ids=lambda package: package.name)
def package(request: pytest.FixtureRequest) -> Path:
    path: Path = request.param
    return path


@pytest.fixture(scope="session")
def tree(package: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its files, unpacked."""
    folder = tmp_path_factory.mktemp("package")
    subprocess.run(["dpkg-deb", "-x", package, folder], check=True)
    return folder


def said(*command: str | Path) -> str:
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    return done.stdout


def python(tree: Path) -> Path:
    """The interpreter that the package uses; another Debian's is not on this machine."""
    link = tree / OPT / "bin/python3"
    if not link.readlink().exists():
        pytest.skip(f"needs {link.readlink()}, the Python of another Debian")
    return link


def test_the_packages_were_built() -> None:
    assert PACKAGES, "make deb has put none into dist/"


def test_the_sums_are_those_of_the_packages() -> None:
    said("sh", "-c", f"cd {ROOT / 'dist'} && sha256sum --strict --check SHA256SUMS")
    listed = {line.split()[1] for line in (ROOT / "dist/SHA256SUMS").read_text().splitlines()}
    assert listed == {package.name for package in PACKAGES}


def test_every_page_of_the_documentation_is_in_it(tree: Path) -> None:
    about = tree / "usr/share/doc/probewatch"
    for folder, target in (("docs", "docs"), ("config", "examples")):
        expected = {file.relative_to(ROOT / folder): file.read_bytes() for file in (ROOT / folder).rglob("*.*")}
        assert expected
        shipped = about / target
        assert {file.relative_to(shipped): file.read_bytes() for file in shipped.rglob("*.*")} == expected
    assert (about / "README.md").read_text() == (ROOT / "README.md").read_text()
    assert "Apache License" in (about / "copyright").read_text()


def test_man_pages_and_completion_lie_where_debian_looks_for_them(tree: Path) -> None:
    manual = tree / "usr/share/man/man1"
    assert {page.name for page in manual.iterdir()} == {f"{name}.gz" for name in PAGES}
    assert "complete -o nosort -F" in (tree / "usr/share/bash-completion/completions/probewatch").read_text()
    assert (tree / "usr/share/zsh/vendor-completions/_probewatch").read_text().startswith("#compdef probewatch\n")
    assert "complete " in (tree / "usr/share/fish/vendor_completions.d/probewatch.fish").read_text()


def test_everything_belongs_to_root_and_nobody_else_may_write_to_it(package: Path) -> None:
    for line in said("dpkg-deb", "-c", package).splitlines():
        mode, owner = line.split()[:2]
        assert owner == "root/root", line
        assert mode.startswith("l") or "w" not in (mode[5], mode[8]), line


def test_it_asks_for_the_python_that_it_was_built_for(package: Path, tree: Path) -> None:
    minor = int((tree / OPT / "bin/python3").readlink().name.rpartition(".")[2])
    needed = said("dpkg-deb", "-f", package, "Depends")
    assert f"python3 (>= 3.{minor}), python3 (<< 3.{minor + 1})" in needed
    assert (tree / OPT / f"lib/python3.{minor}/site-packages/probewatch/appliance").is_dir()


def test_the_configuration_is_one_that_dpkg_keeps_and_that_says_it_is_to_be_adapted(package: Path, tree: Path) -> None:
    assert said("dpkg-deb", "-I", package, "conffiles").split() == ["/etc/probewatch/probewatch.toml"]
    configuration = (tree / "etc/probewatch/probewatch.toml").read_text()
    assert "\nconfigured = false\n" in configuration
    assert "sim:" not in configuration
    (begins,) = (tree / OPT).glob("lib/python3.*/site-packages/probewatch/tools/shared/probewatch.toml")
    assert not begins.is_symlink(), "with what `probewatch configure` begins where the file is gone"
    assert begins.read_text() == configuration.replace("\nconfigured = false\n", "\n# configured = true\n")


def test_its_list_of_parts_names_every_distribution_in_it(package: Path, tree: Path) -> None:
    bom = json.loads((tree / "usr/share/doc/probewatch/sbom.cdx.json").read_text())
    assert (bom["bomFormat"], bom["metadata"]["component"]["name"]) == ("CycloneDX", "probewatch")
    listed = {(part["name"], part["version"]) for part in bom["components"] if part["type"] == "library"}
    (site,) = (tree / OPT / "lib").glob("python3.*/site-packages")
    there = {(re.sub(r"[-_.]+", "-", one.name).lower(), one.version) for one in distributions(path=[str(site)])}
    assert listed | {("probewatch", bom["metadata"]["component"]["version"])} == there
    libraries = [part for part in bom["components"] if part["type"] == "file"]
    assert any("opencv" in part["name"] for part in libraries)
    for part in libraries:
        assert part["hashes"][0]["content"] == hashlib.sha256((site / part["name"]).read_bytes()).hexdigest()


def test_it_brings_one_import_name(tree: Path) -> None:
    """`tools` or `drivers` there would stand in the way of whoever has packages of that name."""
    (site,) = (tree / OPT / "lib").glob("python3.*/site-packages")
    (own,) = (one for one in distributions(path=[str(site)]) if one.name == "probewatch")
    brought = {file.parts[0] for file in own.files or () if "dist-info" not in file.parts[0]}
    assert {name for name in brought if not name.startswith("..")} == {"probewatch"}
    assert not (site / "probewatch/tools/development").exists()


def test_every_command_runs_as_it_was_packed(tree: Path) -> None:
    program = (python(tree), tree / OPT / "bin/probewatch")
    overview = said(*program, "--help")
    for name in COMMANDS:
        assert f"  {name}" in overview
        assert said(*program, name, "--help").startswith(f"Usage: probewatch {name}")


def test_its_libraries_are_those_of_this_machine(tree: Path) -> None:
    own = "probewatch.appliance.core.line, probewatch.appliance.core.registration.compiled"
    imports = f"import {own}, cv2, gpiod, scipy.linalg"
    where = said(python(tree), "-I", "-c", f"{imports}; print(probewatch.__file__)")
    assert where.startswith(str(tree.resolve())), where
