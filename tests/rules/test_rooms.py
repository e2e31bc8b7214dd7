"""Every module stands in a room: folders say what they are for, and the import contracts leave none of them out."""

import ast
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from probewatch.drivers.registry import drivers

ROOT = Path(__file__).parents[2]
PACKAGES = ("appliance", "drivers", "tools")
PACKAGE = ROOT / "tools/development/package/probewatch"
LEAVES = frozenset({"samples", "rigid", "errors", "printable"})
"""Modules of the drivers that are values and arithmetic alone: the pure rooms of the appliance may import them."""
CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]

_PAGES = ("*.md", "Makefile", "pyproject.toml", ".ci/run", "config/*", "docs/*.md", "systemd/*", "systemd/deb/*")
_MODULE = re.compile(r"(?<![\w./-])(?:(?:probewatch\.)?(?:appliance|drivers|tools)|tests)(?:\.(?!py\b)[A-Za-z]\w*)+")
_PATH = re.compile(r"(?<![\w./-])(?:appliance|drivers|tools|tests|systemd|docs|config)/[\w./*-]*\w(?![\w{])")


def folders(*tops: str) -> list[Path]:
    found = [path for top in tops for path in (ROOT / top).rglob("*.py") if PACKAGE not in path.parents]
    return sorted({path.parent.relative_to(ROOT) for path in found if "__pycache__" not in path.parts})


def children(folder: Path) -> set[str]:
    modules = {path.stem for path in (ROOT / folder).glob("*.py")} - {"__init__"}
    return modules | {path.parent.name for path in (ROOT / folder).glob("*/__init__.py")}


def has_rooms(folder: Path) -> bool:
    return any((ROOT / folder).glob("*/__init__.py"))


@pytest.mark.parametrize("folder", folders(*PACKAGES), ids=str)
def test_a_folder_says_what_may_enter_it(folder: Path) -> None:
    opening = ast.get_docstring(ast.parse((ROOT / folder / "__init__.py").read_text()))
    assert opening, f"{folder}/__init__.py does not say what the folder is for"


@pytest.mark.parametrize("folder", folders("tests"), ids=str)
def test_a_folder_of_tests_is_a_package(folder: Path) -> None:
    """Else two tests of the same name in two folders are one module to pytest."""
    assert (ROOT / folder / "__init__.py").exists() or folder.name == "inside", "scripts for another machine"


@pytest.mark.parametrize("folder", [one for one in folders(*PACKAGES) if has_rooms(one)], ids=str)
def test_what_holds_rooms_has_a_contract_that_leaves_none_out(folder: Path) -> None:
    """Layers that name each, or no one may know another, whatever it is called, but for what several share."""
    container = ".".join(("probewatch", *folder.parts))
    if any(one["type"] == "independence" and one["modules"] == [f"{container}.*"] for one in CONTRACTS):
        return
    found = [one for one in CONTRACTS if one.get("containers") == [container]]
    assert len(found) == 1, f"{container} has {len(found)} contracts in pyproject.toml, not one"
    (contract,) = found
    assert contract["type"] == "layers"
    assert contract["exhaustive"], "a new module would stand in no contract"
    assert "exhaustive_ignores" not in contract
    assert {name for layer in contract["layers"] for name in layer.split(" | ")} == children(folder)


@pytest.mark.parametrize(
    "contract", [one for one in CONTRACTS if one["type"] == "independence"], ids=lambda c: c["name"]
)
def test_what_devices_share_is_there_and_is_no_device(contract: dict[str, list[str]]) -> None:
    """A file that is let in must be shared by several of the room, or a device could hide among them."""
    (modules,) = contract["modules"]
    room = Path(*modules.removeprefix("probewatch.").removesuffix(".*").split("."))
    devices = {driver.module for driver in drivers().values()}
    for line in contract["ignore_imports"]:
        _, _, shared = line.removesuffix(".**").partition(" -> ")
        assert shared.rpartition(".")[2] in children(room), f"{shared} is gone: take it out of pyproject.toml"
        assert not any(device == shared or device.startswith(f"{shared}.") for device in devices), shared


def test_the_pure_rooms_may_take_nothing_but_values_of_the_drivers() -> None:
    (contract,) = (one for one in CONTRACTS if "probewatch.appliance.core" in one.get("source_modules", ()))
    within = "probewatch.drivers."
    forbidden = {name.removeprefix(within) for name in contract["forbidden_modules"] if name.startswith(within)}
    assert forbidden == children(Path("drivers")) - LEAVES


@pytest.mark.parametrize("folder", folders("tests"), ids=str)
def test_the_tests_mirror_the_packages(folder: Path) -> None:
    top, *rest = folder.parts[1:] or [""]
    if top in PACKAGES:
        assert (ROOT / top).joinpath(*rest).is_dir(), f"there is no {'/'.join((top, *rest))} that this could test"


def texts() -> Iterator[tuple[Path, str]]:
    """Pages and code, whole: with comments and strings go the imports, which lead somewhere anyway."""
    for page in {page for pattern in _PAGES for page in ROOT.glob(pattern) if page.is_file() and page.suffix != ".py"}:
        yield page, page.read_text()
    for folder in (*folders(*PACKAGES, "tests"), Path("systemd/deb")):
        for module in (ROOT / folder).glob("*.py"):
            yield module, module.read_text()


@cache
def is_there(name: str) -> bool:
    """A module, or something that its file mentions."""
    parts = name.removeprefix("probewatch.").split(".")
    for count in range(len(parts), 0, -1):
        place = ROOT.joinpath(*parts[:count])
        file = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
        if file.is_file():
            return parts[count:] == [] or re.search(rf"\b{parts[count]}\b", file.read_text()) is not None
    return False


def test_a_name_that_leads_nowhere_is_seen() -> None:
    assert is_there("probewatch.drivers.samples")
    assert is_there("probewatch.drivers.samples.Pose")
    assert not is_there("drivers." + "sample")
    assert not is_there("probewatch.drivers.samples." + "Posture")


def test_every_module_and_path_that_a_page_or_the_code_names_is_there() -> None:
    lost = [
        f"{file.relative_to(ROOT)}: {name}"
        for file, text in texts()
        for name in {*_MODULE.findall(text), *_PATH.findall(text)}
        if not (any(ROOT.glob(name)) if "/" in name else is_there(name) or (ROOT / name).exists())
    ]
    assert not lost, "\n".join(lost)
