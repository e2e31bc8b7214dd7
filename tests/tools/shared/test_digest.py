"""The files of a recording: the one that is named, and the one beside it that has its pictures."""

from pathlib import Path

import pytest

from probewatch.tools.shared.digest import with_pictures


@pytest.mark.parametrize(
    ("name", "header", "pictures"),
    [
        ("a.mhd", "ObjectType = Image\nElementDataFile = a.raw\n", True),
        ("a.mhd", "ObjectType = Image\nElementDataFile = ./a.raw\n", True),
        ("a.mha", "ObjectType = Image\nElementDataFile = a.raw\n", True),
        ("a.nhdr", "NRRD0005\ntype: uchar\ndata file: ./a.raw\n", True),
        ("a.nrrd", "NRRD0005\ndatafile: a.raw\n\n", True),
        ("a.nrrd", "NRRD0005\ntype: uchar\n\ndata file: a.raw\n", False),
        ("a.mha", "ObjectType = Image\nElementDataFile = LOCAL\n", False),
        ("a.mhd", "ObjectType = Image\nElementDataFile = ../a.raw\n", False),
        ("a.mhd", "ObjectType = Image\nElementDataFile = gone.raw\n", False),
        ("a.mkv", "ElementDataFile = a.raw\n", False),
    ],
)
def test_the_pictures_beside_a_header_belong_to_it(tmp_path: Path, name: str, header: str, pictures: bool) -> None:
    """Those that a header names with ./, or an .mha or .nrrd names at all, were left out of SHA-256 and state."""
    path, beside = tmp_path / name, tmp_path / "a.raw"
    path.write_text(header)
    beside.write_bytes(b"pictures")
    assert with_pictures(path) == ((path, beside) if pictures else (path,))
