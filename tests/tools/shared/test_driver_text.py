"""What the terminal says of the drivers is what their descriptors say."""

from probewatch.drivers.io.inventory import CONNECTED
from probewatch.drivers.registry import check_options, drivers
from probewatch.tools.shared.driver_text import any_url, before_paths, examples
from tests.support.answers import answered


def test_the_help_of_probe_has_every_url_and_every_option() -> None:
    lines = answered("probe", "--help").stdout.splitlines()
    for driver in drivers().values():
        (at,) = (number for number, line in enumerate(lines) if line.strip().startswith(f"{driver.scheme}:"))
        assert driver.device in lines[at]
        told = " ".join(lines[at + 1 :])
        for option in driver.options:
            before, found, told = told.partition(f"{option.name}={option.values}")
            assert found, f"{driver.scheme}: {option.name}"
            assert not any(f" {other}:" in before for other in drivers()), "it stands below its own URL"


def test_what_is_offered_as_an_example_can_be_configured() -> None:
    for kind in ("tracker", "video", "output"):
        for url in examples(kind).split(", "):
            check_options(url, kind)
    assert "tone:" not in examples("output"), "a sound is no contact"
    assert "sim:" not in examples("video")
    assert any_url().count(":") >= 4


def test_a_path_is_told_with_the_schemes_that_take_it_and_what_they_need() -> None:
    serial, video, gpio = before_paths(CONNECTED)
    assert serial.split(maxsplit=2)[2] == "ndi:, relay: or serialpin: with ?pin= after it"
    assert video.split() == ["video", "v4l2:"]
    assert gpio.split(maxsplit=2)[2] == "gpio: with ?line= after it"
