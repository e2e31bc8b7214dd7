"""URLs of devices: what is written in one is read, or refused by name."""

import pytest

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.registry import is_simulated, split_url


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("probe=Probe&probe=Other", "option 'probe' is given twice, as Probe and Other. Write probe= once"),
        ("image=", "option 'image' has no value. Write image=VALUE"),
        ("probe", "option 'probe' has no value. Write probe=VALUE"),
        ("probe=Probe&=Other&x=1", "'=Other' names no option"),
        ("simulated=yes&simulated=no", "option 'simulated' is given twice"),
    ],
)
def test_no_part_of_a_url_is_passed_over(query: str, words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        split_url(f"igtl://host:18944?{query}")


def test_values_are_taken_as_they_are_written() -> None:
    options = split_url("ndi:/dev/ttyUSB0?probe=/etc/a+b%26c.rom&")[2]
    assert options == {"probe": "/etc/a+b&c.rom"}
    assert is_simulated("igtl://host?probe=a=b&simulated=yes")
    assert not is_simulated("igtl://host?probe=simulated=yes")
