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

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.descriptor import TARGETS, Driver, Option
from probewatch.drivers.errors import ConfigurationError, DeviceLost, RecordingError
from probewatch.drivers.registry import check_options, drivers, open_output, open_tracker, open_video, split_url
from tests.support.absent import absent_url
from tests.support.rigs import lines, rigs

HERE = Path(__file__).parents[2]
OPENERS = {"output": open_output, "tracker": open_tracker, "video": open_video}
SOURCES = [driver for driver in drivers().values() if driver.contact is None]
OPTIONS = [(driver, option) for driver in drivers().values() for option in driver.options]


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


def refused(driver: Driver, **options: str) -> str:
    """Why; empty where they are taken. A value may be right and still not go with the defaults of other options."""
    try:
        read(driver, **options)
    except ConfigurationError as error:
        return error.what
    return ""


def test_whoever_can_open_a_device_is_named_by_a_descriptor() -> None:
    found = set()
    for file in (HERE / "drivers").rglob("*.py"):
        functions = {one.name for one in ast.parse(file.read_text()).body if isinstance(one, ast.FunctionDef)}
        if "checked" in functions and functions & {f"open_{kind}" for kind in OPENERS}:
            found.add(".".join(("probewatch", *file.relative_to(HERE).with_suffix("").parts)))
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
    good, bad = option.words, "no-such-word"
    if option.bounds is not None:
        good, bad = tuple(f"{bound:g}" for bound in option.bounds), f"{option.bounds[1] + 1:g}"
    for value in good:
        assert f"{option.name}={value} {option.refusal}" not in refused(driver, **{option.name: value})
    if good:
        with pytest.raises(ConfigurationError) as refusal:
            read(driver, **{option.name: bad})
        assert f"{option.name}={bad} {option.refusal}" in refusal.value.what
        assert refusal.value.where.startswith(f"{driver.scheme}:")
        assert refusal.value.remedy


@pytest.mark.parametrize(("driver", "option"), OPTIONS, ids=named)
def test_a_slip_in_the_name_of_an_option_is_told_with_the_name(driver: Driver, option: Option) -> None:
    with pytest.raises(ConfigurationError) as refusal:
        read(driver, **{f"{option.name}s": "1"})
    assert refusal.value.what == f"unknown option '{option.name}s'"
    assert refusal.value.remedy.startswith(f"Did you mean '{option.name}'? Use ")


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


HELD_ELSEWHERE = {
    "v4l2": "tests/drivers/video/v4l2/test_source.py",
    "opencv": "tests/drivers/video/test_opencv.py",
    "replay": "tests/drivers/recordings/test_replay.py",
}
"""Sources without a simulated device, and the tests that hold them to the contract of sources."""


@pytest.mark.parametrize("driver", SOURCES, ids=named)
def test_every_source_is_held_by_the_contract_suites(driver: Driver) -> None:
    held = {(rig.scheme, rig.kind) for rig in rigs().values() if not rig.is_variant}
    if driver.twin is None:
        assert (HERE / HELD_ELSEWHERE[driver.scheme]).is_file()
        return
    assert driver.scheme not in HELD_ELSEWHERE
    for kind in driver.kinds:
        assert (driver.scheme, kind) in held, "give it a row in RIGS of tests/support/simulated_*.py"
    if "tracker" in driver.kinds:
        assert driver.scheme in lines(), "give it a row in LINES of tests/support/simulated_*.py"
        assert lines()[driver.scheme].silences
        assert "deadline_ms" in {option.name for option in driver.options}, "the suites set it"


def test_no_row_of_the_suites_is_of_a_driver_that_is_not_there() -> None:
    assert {rig.scheme for rig in rigs().values()} | lines().keys() | HELD_ELSEWHERE.keys() == {
        driver.scheme for driver in SOURCES
    }


@pytest.mark.parametrize("driver", [one for one in drivers().values() if one.twin is not None], ids=named)
def test_a_simulated_device_has_its_command(driver: Driver) -> None:
    assert driver.twin is not None
    command = importlib.import_module(f"probewatch.tools.simulators.{driver.twin.name}").command
    assert command.name == driver.twin.name
    assert driver.twin.what


LAZY = """
import sys
from probewatch.drivers.registry import check_options, drivers
modules = {driver.module for driver in drivers().values()}
print(sorted((modules | {"cv2", "gpiod", "serial"}) & sys.modules.keys()))
check_options("sim:/run/scanner", "video")
print(sorted((modules | {"cv2", "gpiod", "serial"}) & sys.modules.keys()))
"""


def test_to_know_all_drivers_imports_none_and_to_read_one_imports_that_alone() -> None:
    said = subprocess.run([sys.executable, "-c", LAZY], capture_output=True, text=True, check=True, cwd=HERE)
    assert said.stdout.splitlines() == ["[]", "['probewatch.drivers.video.sim']"]
