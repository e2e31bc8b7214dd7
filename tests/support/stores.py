"""Configurations and stores of references in a folder, without a service around them."""

import io
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import structlog

from probewatch.appliance.configuration.config import Config, load_config
from probewatch.appliance.service.control.references import References
from probewatch.appliance.service.host.log import configure
from probewatch.appliance.storage.alarm_chain import digest_of
from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.appliance.storage.reference import Reference
from probewatch.appliance.storage.reference_store import FOLDER, HISTORY, History, read_history
from probewatch.appliance.types import Calibration
from tests.support.polling import until

SIZE_PX = (640, 480)
PLUS = """<PlusConfiguration><CoordinateDefinitions>
<Transform From="Image" To="Probe" Matrix="0 0.07 0 11  -0.08 0 0 48  0 0 0.075 0  0 0 0 1"/>
</CoordinateDefinitions></PlusConfiguration>"""


@pytest.fixture
def log() -> Iterator[io.StringIO]:
    """The log so far. The thread of the references shares no open file with the test, so it cannot print it itself."""
    stream = io.StringIO()
    with configure("info", stream):
        yield stream
    structlog.reset_defaults()


def calibration(*shift_mm: float, simulated: bool = False) -> Calibration:
    """Scales of 0.2 mm/px and an offset of (1, 2, 3) mm, shifted."""
    offset_mm = np.array([1.0, 2.0, 3.0]) + (shift_mm or (0, 0, 0))
    return Calibration(np.eye(3), (1, 1), np.array([0.2, 0.2]), offset_mm, SIZE_PX, simulated=simulated)


def written(path: Path, *shift_mm: float, simulated: bool = False) -> Path:
    write_calibration(path, calibration(*shift_mm, simulated=simulated), {"of": path.stem})
    return path


def configuration(folder: Path, file: str = "probe.toml", video: str = "v4l2:/dev/video0", more: str = "") -> Config:
    """A configuration whose alarm folder is folder/state; the named calibration is made where it is missing."""
    if file.endswith(".toml") and not (folder / file).exists():
        written(folder / file)
    path = folder / "probewatch.toml"
    path.write_text(
        f'video.url = "{video}"\ntracker.url = "ndi:/dev/ttyUSB0"\noutput = [{{ url = "relay:/dev/ttyUSB1" }}]\n'
        f'alarm.folder = "state"\ncalibration.file = "{file}"\n{more}'
    )
    return load_config(path)


def started(config: Config) -> References:
    """As a service starts it: everything that is known now is on the disk when this returns."""
    references = References(config)
    references.begin()
    if references.current is not None:
        until(lambda: references.on_disk, otherwise=lambda: references.waits)
    return references


def first_reference(folder: Path) -> Reference:
    """Of a new cart."""
    written(folder / "probe.toml")
    references = started(configuration(folder))
    references.close()
    assert references.current is not None
    return references.current


def settled(references: References) -> References:
    """As a service ends it."""
    references.close()
    if references.failure is not None:
        raise references.failure
    assert references.on_disk, references.waits
    return references


def kept(config: Config) -> History:
    history = read_history(config.alarm.folder)
    assert history is not None
    return history


def place(config: Config) -> Path:
    return config.alarm.folder / FOLDER


def forge(config: Config, **changes: object) -> None:
    """A history with other fields and a checksum that fits them."""
    file = place(config) / HISTORY
    fields = {**json.loads(file.read_text()), **changes}
    del fields["check"]
    file.write_text(json.dumps({**fields, "check": digest_of(fields)}))
