"""The whole service with its real line over rendered pictures, in simulated time: what it lost, and what is far."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from probewatch.appliance.storage.calibration_file import read_calibration, write_calibration
from probewatch.appliance.types import Fault
from tests.support.answers import answered
from tests.support.simulated_cart import WorldCart

ALARM_S = 2.0


@pytest.fixture
def real(tmp_path: Path) -> Iterator[WorldCart]:
    """It monitors; whatever is done to it, nothing is found wrong with its calibration."""
    with WorldCart(tmp_path, 3) as cart:
        cart.monitoring(40)
        checks = {check["name"]: check for check in cart.status()["checks"]}
        assert {check["fault"] for check in checks.values()} <= {*Fault}
        assert checks["polarity"]["verdict"] == "OK"
        assert checks["scale-lateral"]["ratio"] < 1
        yield cart
        assert not {"halt", "recalibration requested"} & {line["state"] for line in cart.said(event="state")}


@pytest.mark.thorough
@pytest.mark.parametrize("part", ["estimator", "scanner", "tracker"])
def test_the_real_line_verifies_again_after_every_loss(real: WorldCart, part: str) -> None:
    began_s = real.now_s()
    if part == "estimator":
        real.kill_estimator()
    else:
        getattr(real, part).plugged = False
    real.open_contact(began_s, ALARM_S)
    if part == "estimator":
        real.wait_for("not verified", 15)
    else:
        getattr(real, part).plugged = True
    real.wait_for("monitoring", 60)


@pytest.mark.slow
def test_a_far_reference_opens_the_contact_until_all_of_it_is_shown(real: WorldCart, tmp_path: Path) -> None:
    """30 mm off in ζ never closes it; the way back closes it once the tilts and ζ are shown."""
    right = read_calibration(real.folder / "probe.toml")
    wrong = tmp_path / "wrong.toml"
    write_calibration(wrong, replace(right, offset_mm=right.offset_mm + np.array([0, 0, 30])), {})
    real.run(0.2)
    began_s = real.now_s()
    with real.served():
        taken = answered("calibration", "use", wrong, "--yes", "--wait", 5, "--socket", real.socket)
    assert taken.returncode == 75
    real.run(40)
    assert not any(closed for _, closed in real.switched(began_s))
    with real.client() as client:
        client.abort_recalibration()
    real.until(lambda: "offset-elevational" in (real.status().get("reference_waits") or ""))
    status = real.wait_for("monitoring", 180)
    assert (status["reference"]["origin"], status["reference_waits"]) == ("went back to 1", None)
    shown = {check["name"] for check in status["checks"] if check["verdict"] == "OK"}
    assert "offset-elevational" in shown
