"""The drivers on the kernel's own devices: vivid, gpio-sim, the 8250 serial port."""

import pytest

from tests.cart.guest import Guest


@pytest.fixture
def idle(guest: Guest) -> Guest:
    """Booted, from the snapshot; nobody uses the devices."""
    guest.restore()
    return guest


@pytest.mark.parametrize("format_", ["GREY", "YUYV"])
def test_what_the_scanner_writes_is_captured_to_the_last_bit(idle: Guest, format_: str) -> None:
    seen = idle.script("video", "exact", format_, "5")
    print(seen)
    assert seen["frames"] >= 30
    assert seen["exact"] == seen["frames"]
    assert seen["different"] >= 10
    assert seen["backward"] == 0
    assert seen["period_ms"] == pytest.approx(1e3 / 59.94, rel=0.02), "kernel stamps over kernel sequence numbers"
    assert seen["err_ms"] == pytest.approx(1e3 / 59.94 / 2, abs=0.5)
    assert 0 < seen["delay_ms"] < 200


LOSSES = {
    "fatal": "reports an error",
    "queue": "does not take a buffer back",
    "disconnect": "unplugged",
    "unbound": "unplugged",
    "still unbound": "no such video device",
    "no buffers": "gives no buffers",
    "no start": "does not start to stream",
    "no signal": "no signal at the video input",
    "still no signal": "no signal at the video input",
    "no lock": "is not steady",
    "still no lock": "is not steady",
    "out of range": "out of the grabber's range",
    "still out of range": "out of the grabber's range",
    "busy": "in use by another program",
}
WORKING = ("healthy", "damaged", "lossy", "sequence wraps", "time wraps", "end of frame")


def test_every_fault_of_the_grabber_is_named_and_passes(idle: Guest) -> None:
    seen = idle.script("video", "faults", timeout_s=300)
    for name, words in LOSSES.items():
        assert words in (seen[name]["what"] or "nothing"), f"{name}: {seen[name]}"
    for name in [*WORKING, *(name for name in seen if name.startswith("after "))]:
        assert seen[name]["what"] is None, f"{name}: {seen[name]}"
        assert seen[name]["frames"] > 0, f"{name}: {seen[name]}"
    waited_s = {name: told["after_s"] for name, told in seen.items() if told.get("after_s") is not None}
    print("seconds from the fault to its notice:", waited_s)
    assert max(waited_s.values()) < 1.0
    assert seen["damaged"]["damaged"] == 1
    assert any("were lost" in remark for remark in seen["lossy"]["remarks"])
    assert any("without a time of this host" in remark for remark in seen["time wraps"]["remarks"])
    assert seen["time wraps"]["err_ms"] > seen["healthy"]["err_ms"]
    assert any("later than they arrived" in remark for remark in seen["end of frame"]["remarks"])


def test_outputs_drive_their_lines_and_are_dropped_with_their_process(idle: Guest) -> None:
    seen = idle.script("outputs")
    gpio, serial, killed = seen["gpio"], seen["serial"], seen["killed"]
    assert (gpio["idle"], gpio["high"], gpio["low"]) == (0, [0, 1, 0, 1], [1, 0, 1, 0])
    assert gpio["high read back"] is gpio["low read back"] is True
    assert gpio["busy"] == "the line is in use by another program"
    assert gpio["no line"] == ["no such line", "no such line"]
    assert gpio["stuck"] == "the contact did not follow, it stays inactive"
    assert gpio["followed"] is True
    wave = "".join(map(str, gpio["wave"]))
    assert wave[40:] == "0" * 10
    assert wave.startswith("1")
    assert 5 <= wave[:40].count("01") + wave[:40].count("10") <= 9, wave
    for pin in ("rts", "dtr"):
        assert serial[f"{pin} opened"] is False
        assert serial[pin] == [[True, True], [False, False], [True, True]]
        assert "in use by another program" in serial[f"{pin} busy"]
        assert serial[f"{pin} stuck"] == "the contact did not follow, it stays closed"
    print("GPIO line released", killed["gpio_ms"], "ms after SIGKILL")
    assert killed["before"] == [1, True]
    assert (killed["gpio"], killed["rts"]) == (0, False)
    assert killed["gpio_ms"] < 250
