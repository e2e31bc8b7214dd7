"""What drivers say of themselves is what they do: one suite over the rows of every driver. Outputs that are not there:
tests/drivers/outputs/test_contract.py.
"""

import ast
import importlib
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.clock.host_clock import HostClock
from drivers.descriptor import TARGETS, Driver, Option
from drivers.errors import ConfigurationError, DeviceLost, RecordingError
from drivers.registry import check_options, drivers, open_output, open_tracker, open_video, split_url
from tests.support.absent import absent_url

HERE = Path(__file__).parents[2]
OPENERS = {"output": open_output, "tracker": open_tracker, "video": open_video}
SOURCES = [driver for driver in drivers().values() if driver.contact is None]
OPTIONS = [(driver, option) for driver in drivers().values() for option in driver.options]
BESIDE = {
    ("optotrak", "rate"): {"deadline_ms": "5000"},
    ("optotrak", "reference"): {"body": "7"},
    ("optotrak", "witness"): {"body": "7"},
}
"""What else a URL must say for the least and the greatest value of an option."""


def named(value: object) -> str | None:
    if isinstance(value, Driver):
        return value.scheme
    return value.name if isinstance(value, Option) else None


def read(driver: Driver, **options: str) -> None:
    """The driver's own reading of these beside what it cannot do without; nothing is opened."""
    if driver.scheme == "tone" and shutil.which("aplay") is None:
        pytest.skip("aplay (alsa-utils) is not installed")
    _, target, needed = split_url(driver.url("/dev/x" if "://" not in next(iter(driver.examples.values())) else "x"))
    importlib.import_module(driver.module).checked(target, needed | options)


def test_whoever_can_open_a_device_is_named_by_a_descriptor() -> None:
    found = set()
    for file in (HERE / "drivers").rglob("*.py"):
        functions = {one.name for one in ast.parse(file.read_text()).body if isinstance(one, ast.FunctionDef)}
        if "checked" in functions and functions & {f"open_{kind}" for kind in OPENERS}:
            found.add(".".join(file.relative_to(HERE).with_suffix("").parts))
    assert found == {driver.module for driver in drivers().values()}


@pytest.mark.parametrize("driver", drivers().values(), ids=named)
def test_a_descriptor_is_whole(driver: Driver) -> None:
    assert driver.targets
    assert set(driver.targets) <= set(TARGETS)
    assert (driver.contact is not None) == ("output" in driver.kinds)
    for kind, example in driver.examples.items():
        assert example.startswith(f"{driver.scheme}:")
        read(driver)
        check_options(example, kind)
    for option in driver.options:
        assert option.help
        assert option.values, "a page must tell what may be written"
        assert not (option.bounds and option.words)


@pytest.mark.parametrize(("driver", "option"), OPTIONS, ids=named)
def test_an_option_is_read_as_its_row_says(driver: Driver, option: Option) -> None:
    beside = BESIDE.get((driver.scheme, option.name), {})
    good, bad = option.words, "no-such-word"
    if option.bounds is not None:
        good, bad = tuple(f"{bound:g}" for bound in option.bounds), f"{option.bounds[1] + 1:g}"
    for value in good:
        read(driver, **beside, **{option.name: value})
    if good:
        with pytest.raises(ConfigurationError) as refusal:
            read(driver, **beside, **{option.name: bad})
        assert f"{option.name}={bad} {option.refusal}" in refusal.value.what
        assert refusal.value.where.startswith(f"{driver.scheme}:")
        assert refusal.value.remedy


@pytest.mark.parametrize(("driver", "option"), OPTIONS, ids=named)
def test_a_slip_in_the_name_of_an_option_is_told_with_the_name(driver: Driver, option: Option) -> None:
    with pytest.raises(ConfigurationError) as refusal:
        read(driver, **{f"{option.name}s": "1"})
    assert refusal.value.what == f"unknown option '{option.name}s'"
    assert refusal.value.remedy.startswith(f"Did you mean {option.name}=? Use ")


@pytest.mark.parametrize("driver", SOURCES, ids=named)
def test_what_is_not_there_is_lost_or_no_recording(driver: Driver) -> None:
    url = absent_url(driver)
    for kind in driver.kinds:
        with pytest.raises(RecordingError if driver.scheme == "replay" else DeviceLost) as refusal:
            OPENERS[kind](url, HostClock())
        assert refusal.value.where
        assert refusal.value.remedy


@pytest.mark.parametrize("driver", drivers().values(), ids=named)
def test_an_unknown_option_is_refused_by_name_before_anything_is_opened(driver: Driver) -> None:
    url = absent_url(driver)
    for kind in driver.kinds:
        with pytest.raises(ConfigurationError, match="unknown option 'colour'"):
            OPENERS[kind](f"{url}{'&' if '?' in url else '?'}colour=red", HostClock())


LAZY = """
import sys
from drivers.registry import check_options, drivers
modules = {driver.module for driver in drivers().values()}
print(sorted((modules | {"cv2", "gpiod", "serial"}) & sys.modules.keys()))
check_options("sim:/run/scanner", "video")
print(sorted((modules | {"cv2", "gpiod", "serial"}) & sys.modules.keys()))
"""


def test_to_know_all_drivers_imports_none_and_to_read_one_imports_that_alone() -> None:
    said = subprocess.run([sys.executable, "-c", LAZY], capture_output=True, text=True, check=True, cwd=HERE)
    assert said.stdout.splitlines() == ["[]", "['drivers.video.sim']"]
