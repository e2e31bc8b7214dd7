"""A session of the replay's tests and the calibration of its probe."""

from pathlib import Path

import numpy as np
import pytest

from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.appliance.types import Calibration
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from tests.support.recordings import REPLAYED_PX, items


@pytest.fixture
def session(tmp_path: Path) -> Path:
    """40 pictures."""
    path = tmp_path / "session.igs.mha"
    write_metaimage(path, items(40, REPLAYED_PX), REPLAYED_PX)
    return path


@pytest.fixture
def calibration(tmp_path: Path) -> Path:
    path = tmp_path / "probe.toml"
    reference = Calibration(np.eye(3), (1, 1), np.array([0.2, 0.2]), np.zeros(3), REPLAYED_PX)
    write_calibration(path, reference, {})
    return path
