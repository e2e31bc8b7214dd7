"""What motion recovers, and changes of the reference that are interrupted."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from probewatch.appliance.core.parameters import QUANTITIES, class_of
from probewatch.appliance.core.quality.calibration_difference import difference
from probewatch.appliance.core.quality.proposal import proposal_fields, propose
from probewatch.appliance.service.control.server import ControlRefused, Peer
from probewatch.appliance.storage.calibration_file import read_calibration
from probewatch.appliance.storage.image_to_probe import image_to_probe
from probewatch.appliance.types import Calibration, Check, VerdictKind
from probewatch.drivers.rigid import rotation_from_vector
from tests.support.answering import Answering
from tests.support.answers import answered
from tests.support.stores import written
from tests.tools.commands.test_calibration import Interrupted


@contextmanager
def service_that_says(path: Path, status: dict[str, Any]) -> Iterator[Path]:
    """The control socket of a service that answers with this status."""
    with Answering(path, lambda: status):
        yield path


def proposing(values: list[tuple[str, float]], simulated: tuple[str, ...] = ()) -> dict[str, Any]:
    """Status of a service that has found these faults of SHOWN."""
    checks = [
        Check(name, class_of(name), value, 0.4, QUANTITIES[class_of(name)].unit, 1.0, VerdictKind.FAULT)
        for name, value in values
    ]
    found = propose(checks, SHOWN, 0.0)
    matrix = None if found is None or found.calibration is None else image_to_probe(found.calibration).tolist()
    return {
        "proposal": None if found is None else {**proposal_fields(found), "image_to_probe": matrix},
        "reference": {"image_size_px": [640, 480], "polarity": [-1, 1], "simulated": False},
        "simulated": [*simulated],
    }


SHOWN = Calibration(
    rotation_from_vector(np.array([0.1, 0.2, 1.5])), (-1, 1), np.array([0.08, 0.07]), np.arange(3.0), (640, 480)
)


@pytest.mark.parametrize("simulated", [(), ("sim:/run/scanner",)])
def test_what_motion_recovers_is_written_down_for_a_person_to_take(tmp_path: Path, simulated: tuple[str, ...]) -> None:
    file = tmp_path / "new.toml"
    status = proposing([("rotation-axial", 8.0), ("offset-lateral", -6.0)], simulated)
    with service_that_says(tmp_path / "control", status) as socket:
        answer = answered("calibration", "recover", "--output", file, "--socket", socket)
        again = answered("calibration", "recover", "--output", file, "--socket", socket)
    assert (answer.returncode, again.returncode) == (0, 78), "nothing is overwritten"
    assert "rotation-axial 0 → 8 ± 0.4 deg; offset-lateral 0 → -6 ± 0.4 mm" in answer.stdout
    found = read_calibration(file)
    change = difference(SHOWN, found)
    assert change.rotation_deg == pytest.approx(8.0, abs=1e-6)
    assert change.offset_mm == pytest.approx((-6.0, 0.0, 0.0), abs=1e-6)
    assert (change.same_polarity, found.simulated) == (True, bool(simulated))


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ([], "proposes nothing"),
        ([("scale-axial", 9.0)], "recalibrate with 'probewatch recalibrate --live'"),
        ([("rotation-axial", 9.0), ("offset-elevational", 9.0)], "recalibrate with"),
        ([("latency", 90.0)], "set latency_ms=90 in the tracker's URL"),
    ],
)
def test_what_motion_does_not_recover_is_refused_with_what_to_do(
    tmp_path: Path, values: list[tuple[str, float]], why: str
) -> None:
    with service_that_says(tmp_path / "control", proposing(values)) as socket:
        answer = answered("calibration", "recover", "--output", tmp_path / "new.toml", "--socket", socket)
    assert answer.returncode == 78
    assert why in answer.stderr
    assert not (tmp_path / "new.toml").exists()


@pytest.mark.parametrize(
    ("at", "said"),
    [
        ("propose-calibration", "stopped: nothing was changed, reference 1 is in force, as before"),
        ("begin-recalibration", "stopped: nothing was changed, reference 1 is in force, as before"),
        ("end-recalibration", "stopped: the calibration before is in force again, as reference 3"),
        ("proof", "stopped: reference 2 was taken, and the contact stays open until motion has verified it; back to"),
    ],
)
@pytest.mark.parametrize("command", ["use", "back"])
def test_one_who_interrupts_a_change_is_told_what_became_of_it(
    tmp_path: Path, command: str, at: str, said: str
) -> None:
    wanted = written(tmp_path / "new.toml", 0, 0, 1.5) if command == "use" else 1
    with Interrupted(tmp_path / "control", at) as service:
        shown = answered("calibration", command, wanted, "--socket", service.path)
    assert shown.returncode == 130
    assert f"probewatch: {said}" in shown.stderr


def test_one_who_interrupts_and_cannot_be_told_is_told_that(tmp_path: Path) -> None:
    with Interrupted(tmp_path / "control", "propose-calibration") as service:
        told = service._answer

        def silent_afterwards(do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
            if service._at == "":
                raise ControlRefused("too many ask")
            return told(do, request, who)

        service._answer = silent_afterwards
        shown = answered("calibration", "back", 1, "--socket", service.path)
    assert "stopped: whether the reference was changed is not known (too many ask)" in shown.stderr
