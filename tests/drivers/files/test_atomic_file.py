"""A file that cannot be written is refused with the remedy for its own cause."""

import errno
import os
from pathlib import Path

import pytest

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.atomic_file import writing


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_is_no_missing_folder(tmp_path: Path, number: int) -> None:
    with pytest.raises(ConfigurationError) as refusal, writing(tmp_path / "new.csv"):
        raise OSError(number, os.strerror(number))
    assert refusal.value.remedy == "Make room on its disk, or name a file on another one"
    assert list(tmp_path.iterdir()) == []
