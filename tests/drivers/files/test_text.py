"""Every reader of text takes a mark of Windows in front, and says of what is not UTF-8 where and what to do."""

from collections.abc import Callable
from pathlib import Path

import pytest

from probewatch.appliance.configuration.config import configuration_text
from probewatch.appliance.configuration.noise_file import read_noise
from probewatch.appliance.storage.calibration_file import read_calibration
from probewatch.drivers.errors import ProbewatchError
from probewatch.drivers.io.byte_log import read_log
from probewatch.drivers.recordings.pose_table import PoseTable
from probewatch.drivers.twins.tool_motion import pose_file

READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "configuration": ("a.toml", configuration_text),
    "noise": ("a.toml", read_noise),
    "calibration": ("a.toml", read_calibration),
    "device set": ("a.xml", lambda path: read_calibration(path, (640, 480))),
    "table of poses": ("a.csv", PoseTable),
    "motion of tools": ("a.csv", pose_file),
    "byte log": ("a.log", read_log),
}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize(
    ("encoding", "said"),
    [
        ("cp1252", "is not UTF-8 text: line 2 has the byte 0xfc"),
        ("utf-16", "is UTF-16 text, not UTF-8"),
    ],
)
def test_text_in_another_encoding_is_named(tmp_path: Path, reader: str, encoding: str, said: str) -> None:
    name, read = READERS[reader]
    text = "<a>\n<b c='Müller'/></a>\n" if name == "a.xml" else "# a\n# Müller\n"
    (tmp_path / name).write_bytes(text.encode(encoding))
    with pytest.raises(ProbewatchError) as refused:
        read(tmp_path / name)
    assert "codec" not in str(refused.value)
    assert said in str(refused.value)
    assert "UTF-8" in refused.value.remedy


def test_xml_may_name_its_encoding(tmp_path: Path) -> None:
    text = (
        '<?xml version="1.0" encoding="ISO-8859-1"?><PlusConfiguration Name="Müller"><CoordinateDefinitions>'
        '<Transform From="Image" To="Probe" Matrix="0 0.08 0 1 -0.08 0 0 1 0 0 0.08 -1 0 0 0 1"/>'
        "</CoordinateDefinitions></PlusConfiguration>"
    )
    (tmp_path / "a.xml").write_bytes(text.encode("latin-1"))
    assert read_calibration(tmp_path / "a.xml", (640, 480)).image_size_px == (640, 480)


def test_a_mark_in_front_is_no_text(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(b"\xef\xbb\xbfconfigured = false\n")
    assert configuration_text(tmp_path / "a.toml") == "configured = false\n"
