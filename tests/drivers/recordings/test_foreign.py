"""A file that is no sequence is told by what it is, and never as one that is cut."""

from pathlib import Path

import pytest

from probewatch.drivers.errors import RecordingError
from probewatch.drivers.recordings.sequence import read_sequence


def test_what_is_named_as_a_film_and_is_none_is_told_as_that(tmp_path: Path) -> None:
    """It was "no PLUS sequence", with the advice to give a film."""
    path = tmp_path / "scan.mp4"
    path.write_bytes(b"hello")
    with pytest.raises(RecordingError, match=r"is no film: it does not begin as \.mp4 does\. Copy or export it again"):
        read_sequence(path)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b"hello", "its first line 'hello' is not 'key = value'"),
        (b"1 2 3\n4 5 6\n", "its first line '1 2 3'"),
        (b"\x93NUMPY\x01\x00v\x00{'descr': '|u1'}\n", "a NumPy array"),
        (b"\x5c\x01\x00\x00" + bytes(340) + b"n+1\x00", "a NIfTI volume"),
        (bytes(344) + b"n+1\x00", "a NIfTI volume"),
        (b"II*\x00" + bytes(20), "a TIFF picture"),
        (b"BM" + bytes(20), "a single picture (BMP)"),
        (b"GIF89a" + bytes(20), "a GIF"),
        (b"II+\x00" + bytes(20), "a TIFF picture"),
        (b"\x1c\x02\x00\x00n+2\x00" + bytes(540), "a NIfTI volume"),
        (b"# vtk DataFile Version 3.0\nscan\nBINARY\n", "a VTK file"),
        (b"\x80\x05\x95" + bytes(20), "a pickle of Python"),
        (b'{"frames": [1, 2]}\n', "a JSON file"),
        (b"\x30\x26\xb2\x75" + bytes(20), "a Windows Media film (WMV)"),
        (b"FLV\x01" + bytes(20), "a Flash film"),
        (b"OggS" + bytes(20), "an Ogg film"),
        (b"YUV4MPEG2 W320 H240 F30:1\nFRAME\n", "a YUV4MPEG film"),
        (b"\x06\x0e\x2b\x34" + bytes(20), "an MXF film"),
        ((b"G" + bytes(187)) * 3, "an MPEG transport stream"),
        ((bytes(4) + b"G" + bytes(187)) * 3, "an MPEG transport stream"),
        ("ObjectType = Image\n".encode("utf-16"), "is UTF-16 text: an editor has saved it anew"),
        (b"\xef\xbb\xbfNRRD0004\n", "an NRRD file behind a byte order mark"),
        (b"\xd0\xcf\x11\xe0" + bytes(20), "an Office file (XLS)"),
        (b"t_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n", "its name does not end in .csv"),
        (bytes(400), "is of a kind that is not known here"),
    ],
)
def test_it_says_what_it_is_and_not_that_it_is_cut(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "scan.mha"
    path.write_bytes(content)
    with pytest.raises(RecordingError) as told:
        read_sequence(path)
    assert said in str(told.value)
    assert "cut" not in str(told.value)
    assert told.value.remedy


def test_a_folder_is_told_to_name_a_recording_in_it(tmp_path: Path) -> None:
    """Its permissions were to be checked."""
    with pytest.raises(RecordingError, match=r"it is a folder, not a file\. Name a recording in it"):
        read_sequence(tmp_path)
