"""The alarm's sound: its spectrum, and what the real player hands to ALSA."""

import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError, DeviceLost
from probewatch.drivers.outputs.tone import RATE_HZ, tone
from probewatch.drivers.registry import open_output
from tests.support.manual_clock import ManualClock
from tests.support.polling import until

PLAYER = pytest.mark.skipif(shutil.which("aplay") is None, reason="aplay (alsa-utils) is not installed")


@pytest.mark.parametrize("pitch_hz", [150, 440, 1000])
def test_the_tone_has_a_fundamental_and_four_harmonics_within_15_db(pitch_hz: int) -> None:
    samples = tone(pitch_hz, 0, RATE_HZ)
    spectrum = np.abs(np.fft.rfft(samples))
    partials = [spectrum[pitch_hz * order] for order in range(1, 6)]
    assert min(partials) > max(partials) * 10 ** (-15 / 20)
    assert sum(value**2 for value in partials) / np.sum(spectrum**2) > 0.999
    assert np.abs(samples).max() <= 1


def test_blocks_join_without_a_step() -> None:
    joined = np.concatenate([tone(440, first, 100) for first in range(0, 1600, 100)])
    np.testing.assert_allclose(joined, tone(440, 0, 1600), atol=1e-12)


@PLAYER
def test_what_the_player_hands_to_alsa_sounds_only_while_de_energised(tmp_path: Path) -> None:
    recording = tmp_path / "heard.raw"
    clock = ManualClock()
    with open_output(f"tone:file:FILE={recording},FORMAT=raw", clock) as output:
        for energised in [True] * 6 + [False] * 8 + [True] * 6:
            output.write(energised)
            clock.told_ns[0] += 50_000_000
        until(lambda: recording.exists() and recording.stat().st_size >= 2 * RATE_HZ)  # a second of samples
    heard = np.frombuffer(recording.read_bytes(), "<i2").astype(float)
    loud_s = np.flatnonzero(np.abs(heard) > 100) / RATE_HZ
    assert loud_s[0] == pytest.approx(0.4, abs=0.002), "after six writes, 100 ms ahead"
    assert loud_s[-1] == pytest.approx(0.81, abs=0.004), "after eight more and the fade"


@PLAYER
def test_a_player_that_cannot_open_the_card_is_a_lost_device() -> None:
    with open_output("tone:no-such-card", HostClock()) as output:
        time.sleep(0.3)
        with pytest.raises(DeviceLost, match="aplay -L"):
            output.write(False)


@PLAYER
@pytest.mark.parametrize(("url", "part"), [("tone:x?pitch=90", "150 to 1000"), ("tone:x?volume=9", "volume")])
def test_what_can_never_work_is_refused(url: str, part: str) -> None:
    with pytest.raises(ConfigurationError, match=part):
        open_output(url, HostClock())


def test_a_missing_player_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(ConfigurationError, match="alsa-utils"):
        open_output("tone:default", HostClock())


def test_a_player_that_cannot_be_started_is_a_lost_device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as after an upgrade gone wrong: it must not take the other outputs with it."""
    player = tmp_path / "aplay"
    player.write_bytes(b"\x7fELF")
    player.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(DeviceLost, match=r"cannot be started \(Exec format error\)"):
        open_output("tone:default", HostClock())
