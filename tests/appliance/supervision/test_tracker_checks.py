"""What a simulated tracker does wrong, as the device watchers name it: through driver, tracker thread and limits."""

import math
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from probewatch.appliance.limits import Limits
from probewatch.appliance.service.devices.source_thread import TrackerThread
from probewatch.appliance.supervision.device_health import DeviceHealth, Timeouts
from probewatch.appliance.supervision.device_watchers import watch_devices
from probewatch.appliance.types import Check, Kind, VerdictKind
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.registry import open_tracker
from probewatch.drivers.samples import PoseStatus
from probewatch.drivers.twins.ndi.models import AURORA, SPECTRA, VEGA, Model
from probewatch.drivers.twins.ndi.tool_definitions import MARKERS_MM, REFERENCE
from tests.support.polling import until
from tests.support.simulated_ndi import Bench, bench
from tests.support.simulated_optotrak import bench as simulated_optotrak

_TRACKER = {"tracker-alert", "tracker-lost", "tracker-stale", "line-of-sight", "marker-body", "field-distortion"}


class Watch:
    """The tracker thread, and what the watchers make of it now."""

    def __init__(self, thread: TrackerThread, clock: HostClock) -> None:
        self.thread, self._clock, self._started_ns = thread, clock, clock.now_ns()
        limit_ns = round(500e6 * clock.rate)
        self._timeouts = Timeouts(tracker_ns=limit_ns, stale_ns=limit_ns)

    def checks(self) -> dict[str, Check]:
        """By name, those about the tracker."""
        thread = self.thread
        health = DeviceHealth(
            self._started_ns,
            replies=thread.replies,
            body=thread.body,
        )
        found = watch_devices(self._clock.now_ns(), health, self._timeouts, Limits())
        return {check.name: check for check in found if check.fault in _TRACKER}

    def failing(self) -> list[str]:
        """Names of the checks that fail; the first one names the alarm."""
        return [
            name
            for name, check in self.checks().items()
            if check.verdict is VerdictKind.FAULT
            or (check.fault.kind is Kind.SIGHT and check.verdict is not VerdictKind.OK)
        ]

    def healthy(self) -> bool:
        return self.thread.replies.status is PoseStatus.OK and self.thread.body is not None and not self.failing()


def known(watch: Watch, name: str) -> float:
    """Value of a check, 0 while it is not known."""
    value = watch.checks()[name].value
    return 0.0 if math.isnan(value) else value


@contextmanager
def watched(url: str, clock: HostClock) -> Iterator[Watch]:
    thread = TrackerThread("tracker", url, open_tracker, lambda sample: None, clock)  # type: ignore[arg-type]
    thread.start()
    try:
        watch = Watch(thread, clock)
        until(watch.healthy)
        yield watch
        assert thread.failure is None
        assert thread.losses == 0
    finally:
        thread.stop()
        thread.join()


@contextmanager
def ndi(folder: Path, model: Model, query: str = "") -> Iterator[tuple[Bench, Watch]]:
    wired = ("probe", "reference") if model.electromagnetic else ()
    with bench(folder, model, wired=wired) as cart:
        tools = "" if wired else f"&probe={cart.rom('probe')}"
        url = f"{cart.place}?deadline_ms=2000{tools}{query}"
        with watched(url, cart.clock) as watch:
            yield cart, watch


@pytest.mark.parametrize("model", [SPECTRA, VEGA], ids=lambda model: model.name)
def test_a_marker_that_works_loose_is_named_by_geometry_and_fit(model: Model, tmp_path: Path) -> None:
    with ndi(tmp_path, model) as (cart, watch):
        assert until(lambda: known(watch, "marker geometry")) < 0.05, "to single precision"
        cart.faults("marker-drift")
        until(lambda: watch.failing() == ["marker fit", "marker geometry"])
        check = watch.checks()["marker geometry"]
        assert (check.fault, check.verdict) == ("marker-body", VerdictKind.FAULT)
        cart.faults()
        until(watch.healthy)


def test_metal_near_the_field_is_named_before_the_tracker_itself_notices(tmp_path: Path) -> None:
    with ndi(tmp_path, AURORA) as (cart, watch):
        assert until(lambda: known(watch, "field indicator")) == pytest.approx(AURORA.fit_mm)
        cart.faults("em-distortion")
        first = until(watch.failing)
        assert first == ["field indicator"]
        until(lambda: set(watch.failing()) == {"field indicator", "tracker alert"})
        assert watch.checks()["marker geometry"].verdict is VerdictKind.NOT_VERIFIED, "it has no markers"
        cart.faults()
        until(watch.healthy)


@pytest.mark.parametrize("fault", ["hot", "interference"])
def test_a_complaint_of_the_tracker_is_an_alert_and_no_loss(fault: str, tmp_path: Path) -> None:
    with ndi(tmp_path, VEGA) as (cart, watch):
        cart.faults(fault)
        assert until(watch.failing) == ["tracker alert"]
        assert watch.checks()["tracker alert"].fault == "tracker-alert"
        assert {"hot": "too hot", "interference": "infrared"}[fault] in watch.thread.remarks[0]
        cart.faults()
        until(watch.healthy, 20)


def test_a_low_battery_is_said_and_alarms_nobody(tmp_path: Path) -> None:
    with ndi(tmp_path, SPECTRA) as (cart, watch):
        cart.twin.device.raise_alert(0x100000)
        until(lambda: "low battery" in watch.thread.remarks)
        assert watch.healthy()


@pytest.mark.parametrize("model", [SPECTRA, VEGA], ids=lambda model: model.name)
def test_a_bump_alarms_until_a_person_has_checked_and_cleared_it(model: Model, tmp_path: Path) -> None:
    with ndi(tmp_path, model) as (cart, watch):
        cart.faults("bump")
        until(lambda: watch.failing() == ["tracker alert"])
        cart.faults()
        before = watch.thread.samples
        until(lambda: watch.thread.samples > before + 60)
        assert watch.failing() == ["tracker alert"], "nothing but a person ends it"
        assert watch.thread.remarks[0] == "the position sensor was bumped"
        assert watch.thread.clear_bump()
        until(watch.healthy)
        assert not cart.twin.device.bumped
        until(lambda: "the position sensor was bumped" not in watch.thread.remarks)


def test_the_reference_is_watched_like_the_probe(tmp_path: Path) -> None:
    with ndi(tmp_path, SPECTRA, f"&reference={tmp_path / 'reference.rom'}") as (cart, watch):
        rom = cart.twin.device.ports[cart.handle(REFERENCE)].rom
        x_mm, y_mm, z_mm = MARKERS_MM[1]
        struct.pack_into("<3f", rom, 0x48 + 12, x_mm, y_mm + 4, z_mm)
        until(lambda: "marker geometry" in watch.failing())


def test_the_fit_of_an_optotrak_is_watched() -> None:
    with simulated_optotrak() as device, watched(f"optotrak://{device.target}", device.clock) as watch:
        until(lambda: watch.checks()["marker fit"].value < 0.3)
        device.show("marker-drift")
        until(lambda: watch.failing() == ["marker fit"])
        device.show()
        until(watch.healthy)
