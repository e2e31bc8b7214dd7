"""The whole service in simulated time on a computer that other programs keep busy: told as that, once, and safe."""

from collections import Counter

from probewatch.appliance.storage.alarm_chain import read_log
from tests.support.simulated_cart import SimulatedCart

BUSY_S = 15.0
MOST_ENTRIES = 15
"""The overload, its end, one for each kind of change, and those from before it is known: two seconds at most."""


def test_an_overload_is_said_once_and_blames_no_cable(monitoring: SimulatedCart) -> None:
    """Ticks come late, and now and then a device is not heard for want of time."""
    began_s = monitoring.now_s()
    monitoring.pressure, monitoring.lateness_s = 1.0, 0.3
    while monitoring.now_s() < began_s + BUSY_S:
        for device in (monitoring.scanner, monitoring.tracker):
            device.plugged = False
            monitoring.run(1.0)
            device.plugged = True
            monitoring.run(1.0)
    assert monitoring.contact(began_s) is False
    assert monitoring.said(event="overloaded")
    monitoring.pressure = monitoring.lateness_s = 0.0
    monitoring.until(lambda: monitoring.status()["load"]["overloaded_s"] is None, 30)
    monitoring.wait_for("monitoring", 30)
    said = Counter(event["event"] for event in monitoring.said())
    assert (said["overloaded"], said["overload ended"]) == (1, 1)
    assert monitoring.status()["counters"]["device_losses"] > 6
    assert said["device lost"] <= 4, "one of each before it is known, and one after"
    reading = read_log(monitoring.alarms)
    entries = Counter(entry.event for entry in reading.entries)
    assert reading.damages == ()
    assert (entries["overloaded"], entries["overload-ended"]) == (1, 1)
    assert entries["state"] <= MOST_ENTRIES, entries
    (ended,) = (entry.data for entry in reading.entries if entry.event == "overload-ended")
    assert ended["repeated"], "what came again is counted, and has no entry of its own"
    explained = [entry for entry in reading.entries if "overloaded" in str(entry.data.get("reason"))]
    assert explained, "a silent device is told with the overload"
