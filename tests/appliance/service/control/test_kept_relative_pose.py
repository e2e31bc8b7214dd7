"""The relative pose of two marker bodies is kept with the calibration, through reload and restart, not beyond."""

from pathlib import Path

import numpy as np
import pytest

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.core.exact_fields import settings_fields, settings_of
from probewatch.appliance.limits import Limits
from probewatch.appliance.service.control.references import References
from probewatch.appliance.service.estimator.link import EstimatorReport
from probewatch.appliance.service.estimator.process_host import EstimatorHost
from probewatch.appliance.storage.reference_store import FOLDER, HISTORY
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import rigid, rotation_from_vector
from probewatch.drivers.samples import Matrix4
from tests.appliance.service.test_daemon import moved
from tests.support.polling import until
from tests.support.simulated_cart import SimulatedCart
from tests.support.stand_in_daemon import TrustingLine
from tests.support.stores import configuration, kept, log, started, written

pytestmark = pytest.mark.usefixtures("log")
__all__ = ["log"]

RELATIVE_POSE = rigid(rotation_from_vector(np.array([0.1, 0.2, 0.3])), np.array([80.0, 0.1, 1 / 3]))
REFERENCE = Calibration(np.eye(3), (1, 1), np.array([0.1, 0.1]), np.zeros(3), (64, 48))


def said(host: EstimatorHost, generation: int, relative_pose: np.ndarray | None) -> None:
    report = EstimatorReport(generation, 0, (), 0, 0, 0, 0, relative_pose)
    host._received_reports = lambda: [report]
    host.poll()


@pytest.fixture
def host() -> EstimatorHost:
    made = EstimatorHost(REFERENCE, Limits(), 500, command=["sleep", "9"])
    made._look_after = lambda now_s: None
    return made


def test_the_next_process_and_other_limits_go_on_with_it_and_another_reference_without(host: EstimatorHost) -> None:
    said(host, 1, RELATIVE_POSE)
    assert host._settings is not None
    assert np.array_equal(host._settings.relative_pose, RELATIVE_POSE)  # what a new process is sent
    host.set_limits(Limits(witness_mm=2.0), 500)
    assert np.array_equal(host.relative_pose, RELATIVE_POSE)
    said(host, 1, RELATIVE_POSE + 1)
    assert np.array_equal(host.relative_pose, RELATIVE_POSE), "of a line before the present one"
    host.set_reference(Calibration(np.eye(3), (1, 1), np.array([0.2, 0.1]), np.zeros(3), (64, 48)))
    assert host.relative_pose is None
    said(host, 3, RELATIVE_POSE)
    said(host, 3, None)
    assert host.relative_pose is None
    host.close()


def test_settings_keep_it_bit_for_bit() -> None:
    settings = EstimatorSettings(3, REFERENCE, Limits(), 500, RELATIVE_POSE)
    assert np.array_equal(settings_of(settings_fields(settings)).relative_pose, RELATIVE_POSE)
    fields = settings_fields(EstimatorSettings(3, REFERENCE, Limits(), 500))
    assert settings_of(fields).relative_pose is None
    del fields["relative_pose"]
    assert settings_of(fields).relative_pose is None, "as of a file from before"


def test_it_is_on_the_disk_with_the_reference_and_voided_with_it(tmp_path: Path) -> None:
    config = configuration(tmp_path)
    references = started(config)
    current = references.current
    assert current is not None
    assert current.relative_pose is None
    assert '"relative_pose"' not in (config.alarm.folder / FOLDER / HISTORY).read_text(), (
        "so that an older version reads it"
    )
    references.note_relative_pose(REFERENCE, RELATIVE_POSE)
    assert references.current is current, "of a reference that is not in force"
    references.note_relative_pose(current.calibration, RELATIVE_POSE)
    until(lambda: kept(config).in_force.relative_pose is not None)
    references.close()
    again: References = started(config)
    assert again.current is not None
    assert np.array_equal(again.current.relative_pose, RELATIVE_POSE)
    assert again.current.entry.number == current.entry.number
    again.take(again.from_content(written(tmp_path / "new.toml", 1, 0, 0).read_bytes(), "new.toml"), "recalibration")
    assert again.current.relative_pose is None
    until(lambda: kept(config).in_force.number == current.entry.number + 1)
    assert [entry.relative_pose is None for entry in kept(config).entries] == [False, True]
    again.close()


def learning(given: list[Matrix4 | None]) -> type[TrustingLine]:
    """Lines that learn RELATIVE_POSE where they are given none; each notes in `given` what it was given."""

    class Line(TrustingLine):
        def __init__(
            self, reference: Calibration, limits: Limits, stale_ns: int, relative_pose: Matrix4 | None = None
        ) -> None:
            super().__init__(reference, limits, stale_ns, relative_pose, lambda: "")
            given.append(relative_pose)
            self.relative_pose = RELATIVE_POSE if relative_pose is None else relative_pose

    return Line


def test_a_cart_that_restarts_or_whose_estimator_dies_goes_on_with_it(tmp_path: Path) -> None:
    given: list[Matrix4 | None] = []
    with SimulatedCart(tmp_path, learning(given)) as cart:
        cart.monitoring()
        assert [one is None for one in given] == [True]
        cart.kill_estimator()
        cart.until(lambda: len(given) == 2)
        cart.monitoring()
        assert cart.daemon is not None
        cart.config.write_text(cart.config.read_text() + "\n[limits]\nwitness_mm = 2.0\n")
        cart.daemon.reload_soon()
        cart.until(lambda: len(given) == 3)
        cart.end_daemon()
        cart.start_daemon()
        cart.monitoring()
    assert len(given) == 4
    assert all(np.array_equal(one, RELATIVE_POSE) for one in given[1:])


def test_a_service_that_goes_back_to_a_calibration_goes_on_with_what_it_knew_under_it(tmp_path: Path) -> None:
    """It shows a slide during a recalibration that was given up; one that a person takes begins without it."""
    given: list[Matrix4 | None] = []
    with SimulatedCart(tmp_path, learning(given)) as cart:
        cart.monitoring()
        with cart.client() as client:
            client.begin_recalibration()
            client.end_recalibration(moved(cart, tmp_path / "new.toml", 1))
            client.abort_recalibration()
        cart.monitoring()
        back = cart.status()["reference"]
        cart.run(1)
        assert [one is None for one in given] == [True, True, False]
        with cart.client() as client:
            client.begin_recalibration()
            client.end_recalibration(tmp_path / "new.toml")
        cart.monitoring()
    assert back["origin"] == "went back to 1"
    assert np.array_equal(np.reshape(back["relative_pose"], (4, 4)), RELATIVE_POSE)
    assert given[-1] is None


def test_a_body_that_moved_halts_and_holds_until_a_person_acknowledges(tmp_path: Path) -> None:
    with SimulatedCart(tmp_path) as cart:
        cart.monitoring()
        cart.say("marker-body-moved")
        told = cart.wait_for("halt", 3.0)
        assert (told["fault"], told["energised"]) == ("marker-body-moved", False)
        cart.say(None)
        cart.run(5.0)
        assert cart.status()["state"] == "halt"
        cart.end_daemon()
        cart.start_daemon()
        cart.run(5.0)
        assert cart.status()["energised"] is False
        assert cart.acknowledge()
        cart.monitoring()
