"""The whole line on the whole machine: scanner → vivid → V4L2, tracker → serial port, verdict → GPIO line.

Software emulation is too slow for the rates of a cart, so this cart's time passes slower, as slow as this host needs:
service, scanner and tracker share one clock. Every check, limit and timeout is the default of every cart.
"""

import time
from collections.abc import Iterator

import pytest

from tests.cart.bench import (
    CONTACT,
    RELAY,
    HostTwins,
    await_device_events,
    await_gpio,
    configure,
    device_events,
    gpio,
    journal,
    log_tail,
    show,
    wait_status,
)
from tests.cart.guest import PYTHON, SCRIPTS, Guest, Ports
from tests.support.polling import until

FASTEST, SLOWEST = 0.06, 0.02
"""Seconds of the cart in a second."""
MEASURE = "python3 -c 'for i in range(600000): i * i'"
ENOUGH_S = 2.0
"""As long as this may take in the guest, on both of its processors at once, for the fastest of these rates."""
FPS = 16.0
"""Pictures of the scanner in a second of the cart."""
GRABBER_HZ = 4
"""Pictures of vivid in a real second, 60 or more in one of the cart. Its pixel clock has a lower bound, so only large
pictures may be this slow; what repeats a picture of the scanner costs the emulation and shows nothing new.
"""
SCREEN, PLACE = (2560, 1440), (640, 300)
"""Of the scanner's whole output, and where in it the B-mode picture is, px."""
SHRUNK = 2
"""The picture has a quarter of the usual pixels, as registration costs by the pixel."""
LOOP_S = 0.35
"""Real time that pictures spend between scanner and capture, a period of vivid and the feed's own; the scanner is ahead
of the tracker by that.
"""
VERIFIED_S, ALARM_S = 40.0, 12.0
"""Of the cart."""
VIDEO = f"v4l2:/dev/video0?format=GREY&input=1&size={SCREEN[0]}x{SCREEN[1]}&crop={PLACE[0]},{PLACE[1]},320,240"
TRACKER = "ndi:/dev/ttyS1?probe=/etc/probewatch/probe.rom"
TIMINGS = f"--set-dv-bt-timings cvt,width={SCREEN[0]},height={SCREEN[1]},fps={GRABBER_HZ},reduced-blanking=1"
SLOWER = """[Service]
ExecStart=
ExecStart=/usr/bin/env probewatch run --clock-rate {rate} --config /etc/probewatch/probewatch.toml
TimeoutStartSec=300
"""


@pytest.fixture
def cart(guest: Guest) -> Iterator[Guest]:
    """Started; the twins run on this host."""
    guest.restore()
    guest.rate = _bearable_rate(guest)
    with HostTwins(guest.folder, FPS, LOOP_S, guest.rate) as twins:
        guest.ports = Ports(serial=twins.tracker, scanner=twins.scanner)
        guest.restore()
        guest.qmp("watchdog-set-action", {"action": "none"})  # units are read again for longer than its 10 s here
        guest.put_scripts()
        configure(guest, VIDEO, TRACKER, [CONTACT], shrunk=SHRUNK)
        guest.sh("mkdir -p /run/systemd/system/probewatch.service.d")
        guest.put("/run/systemd/system/probewatch.service.d/slower.conf", SLOWER.format(rate=guest.rate))
        for node, direction in ((0, "video"), (1, "video-out")):
            size = f"--set-fmt-{direction} width={SCREEN[0]},height={SCREEN[1]},pixelformat=GREY"
            guest.sh(f"v4l2-ctl -d /dev/video{node} {TIMINGS} && v4l2-ctl -d /dev/video{node} {size}")
        screen = " ".join(map(str, (*SCREEN, *PLACE, SHRUNK)))
        feed = f"{SCRIPTS}/feed.py /dev/virtio-ports/cart.scanner /dev/video1 {screen}"
        guest.sh(f"systemd-run -q --unit=feed {PYTHON} {feed}")
        guest.reload_units()
        guest.sh("systemctl start probewatch", timeout_s=300)
        yield guest


def _bearable_rate(guest: Guest) -> float:
    took_s = guest.sh(f"{MEASURE} & {MEASURE}; wait").seconds
    rate = round(max(SLOWEST, FASTEST * min(1.0, ENOUGH_S / took_s)), 3)
    print(f"two loops took {took_s:.2f} s: {rate:g} s of the cart in a second")
    return rate


def test_a_cart_is_verified_halts_is_acknowledged_loses_its_grabber_and_is_verified_each_time(cart: Guest) -> None:
    """One test, as each verification takes minutes here."""
    _await_verified(cart, "started")
    _step_the_wall_clock(cart)
    _mirror_and_acknowledge(cart)
    _lose_grabber_and_signal(cart)
    assert show(cart, "NRestarts") == "0"


def _mirror_and_acknowledge(cart: Guest) -> None:
    """The halt stands until a person has acknowledged it and the line has verified the calibration again."""
    cart.sh("touch /run/cart-flip")
    _await_relay(cart, "mirrored", 0)
    wait_status(cart, ("halt", "recalibration requested"), ALARM_S / cart.rate)
    status = cart.script("status")
    assert (status["fault"], status["energised"]) == ("polarity", False)
    cart.sh("rm /run/cart-flip; probewatch ack")
    assert cart.script("status")["acknowledged"]
    assert gpio(cart) == 0
    _await_verified(cart, "acknowledged")
    assert cart.script("status")["latched"] is None


def _lose_grabber_and_signal(cart: Guest) -> None:
    """Disconnected, vivid says ENODEV until it is opened again; that is done within the timeouts of this cart, so the
    log tells it and no alarm need. Without a signal its pictures go on, but are none of the scanner: that ends the
    verification, and the next one shows that both are back.
    """
    lost, back = device_events(cart, "video")
    control = "v4l2-ctl -d /dev/video0 -c"
    cart.sh(f"{control} disconnect=1")
    await_device_events(cart, "video", lost + 1, back + 1, ALARM_S / cart.rate)
    cart.sh(f"{control} dv_timings_signal_mode=1")
    _await_relay(cart, "signal lost", 0)
    wait_status(cart, "device lost", ALARM_S / cart.rate)
    cart.sh(f"{control} dv_timings_signal_mode=0")
    await_device_events(cart, "video", lost + 2, back + 2, ALARM_S / cart.rate)
    _await_verified(cart, "grabber and signal back")
    assert device_events(cart, "video") == (lost + 2, back + 2)


def _step_the_wall_clock(cart: Guest) -> None:
    """Monitoring goes on, and the log says each step."""
    steps = ("+1 hour", "-2 hours", "+1 hour", "+3 years")
    for number, step in enumerate(steps, 1):
        cart.sh(f"date -s '{step}' >/dev/null")
        until(lambda number=number: len(_stepped_h(cart)) == number, ALARM_S / cart.rate, cart.look_s)
        assert gpio(cart) == 1, f"{step}\n{log_tail(cart)}"
    assert show(cart, "StatusText").startswith("monitoring")
    stepped_h = _stepped_h(cart)
    print(f"wall clock stepped by {steps}: said by {stepped_h} h, the line stayed high")
    assert [round(hours) for hours in stepped_h[:3]] == [1, -2, 1]
    assert stepped_h[3] > 3 * 365 * 24 - 1


def _stepped_h(cart: Guest) -> list[float]:
    said = journal(cart, "probewatch", "PROBEWATCH_EVENT='wall clock stepped'")
    return [float(entry["PROBEWATCH_BY_S"]) / 3600 for entry in said]


def _await_relay(cart: Guest, what: str, level: int) -> None:
    waited_s = await_gpio(cart, RELAY, level, ALARM_S / cart.rate)
    print(f"{what}: line {'high' if level else 'low'} after {waited_s:.1f} s, {waited_s * cart.rate:.1f} s of the cart")


def _await_verified(cart: Guest, since: str) -> None:
    """Until the service says that it monitors and the line is high."""
    before, began_s = cart.script("status")["counters"], time.monotonic()
    try:
        took_s = wait_status(cart, "monitoring", VERIFIED_S / cart.rate)
    finally:
        rates = _rates(before, cart.script("status")["counters"], (time.monotonic() - began_s) * cart.rate)
        print(f"{since}, at {rates}")
    print(f"{since}: verified after {took_s:.0f} s, {took_s * cart.rate:.0f} s of the cart")
    _await_relay(cart, "verified", 1)


def _rates(before: dict[str, int], after: dict[str, int], elapsed_s: float) -> str:
    """Whether the emulation keeps up."""
    frames, poses, dropped = (after[name] - before[name] for name in ("frames", "poses", "dropped_frames"))
    rates = f"{frames / elapsed_s:.0f} pictures and {poses / elapsed_s:.0f} poses a second of the cart"
    return f"{rates}, {1 - dropped / max(frames, 1):.0%} of the pictures taken"
