"""The plugs of the emulated machine: each fault of the grabber, its signal, the tracker's cable; lost once, back once.

Scanner and tracker have a cart's own rates here, for which another emulated machine beside it leaves too little:
`make test-cart` runs it last and alone.
"""

import time
from collections.abc import Callable

import pytest

from tests.cart.bench import (
    CONTACT,
    LONGER_TIMEOUTS,
    HostTwins,
    await_device_events,
    configure,
    device_events,
    log_tail,
)
from tests.cart.guest import Guest, Ports
from tests.cart.image import Image
from tests.support.polling import until

START_S, BACK_S = 150.0, 60.0
VIDEO = "v4l2:/dev/video0?format=GREY&input=1&size=640x480"
PASSING = ("disconnect=1", "inject_fatal_streaming_error=1", "inject_vidioc_qbuf_error=1")
"""Faults of vivid after which the grabber works again once it has been opened again."""


def test_unplugged_serial_and_lost_signal_are_said_once_and_come_back(
    guest_image: Image, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("plugs")
    with HostTwins(folder, 4.0, 0.1) as twins:
        ports = Ports(usb_serial=twins.tracker, scanner=twins.scanner)
        with Guest(guest_image, folder, ports) as guest:
            guest.restore()
            guest.plug_usb_serial()
            tracker = "ndi:/dev/ttyUSB0?probe=/etc/probewatch/probe.rom&deadline_ms=5000"
            configure(guest, VIDEO, tracker, [CONTACT], LONGER_TIMEOUTS)
            guest.sh("systemctl start probewatch", timeout_s=START_S)
            await_samples(guest)
            signal = "v4l2-ctl -d /dev/video0 -c dv_timings_signal_mode="
            _lost_and_back(guest, "video", lambda: guest.sh(f"{signal}1"), lambda: guest.sh(f"{signal}0"))
            for fault in PASSING:
                _lost_and_back(guest, "video", lambda fault=fault: guest.sh(f"v4l2-ctl -d /dev/video0 -c {fault}"))
            _lost_and_back(guest, "tracker", guest.unplug_usb_serial, guest.plug_usb_serial)


def await_samples(guest: Guest) -> None:
    """Both devices deliver."""

    def counted() -> dict[str, int]:
        counters: dict[str, int] = guest.script("status")["counters"]
        return {name: counters[name] for name in ("frames", "poses")}

    until(lambda: min(counted().values()) > 5, START_S, 1.0, lambda: f"{counted()}\n{log_tail(guest)}")


def _lost_and_back(
    guest: Guest, role: str, lose: Callable[[], object], give_back: Callable[[], object] | None = None
) -> None:
    """One line of the log says that the device is lost, one that it is back, and no more.

    give_back: None where opening the device again is all that it needs.
    """
    losses, backs = device_events(guest, role)
    began_s = time.monotonic()
    lose()
    if give_back is not None:
        await_device_events(guest, role, losses + 1, backs, BACK_S)
        print(f"{role} lost: said within {time.monotonic() - began_s:.1f} s")
        time.sleep(3)
        began_s = time.monotonic()
        give_back()
    await_device_events(guest, role, losses + 1, backs + 1, BACK_S)
    print(f"{role} back: said within {time.monotonic() - began_s:.1f} s")
    time.sleep(2)
    assert device_events(guest, role) == (losses + 1, backs + 1), log_tail(guest)
