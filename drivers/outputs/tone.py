"""Opens `tone:default`: the alarm's sound, through ALSA's own player `aplay`. Energised means silent.

The target is a PCM of ALSA, such as `default` or `plughw:1,0`; option pitch=HZ, 150 to 1000. The writes, twenty a
second, make the pattern of pulses; this output only sounds or is silent. Harmonics are as IEC 60601-1-8 requires: a
fundamental from 150 to 1000 Hz and four more partials, so that a room or an ear that swallows one passes the others.

Release: when the process dies, the sound ends with it: a loudspeaker cannot fail safe. Where that matters, connect a
sounder to the normally closed contact of a relay, as `signal = "tone"` of a `relay:` or `gpio:` output.
"""

import os
import select
import shutil
import subprocess

import numpy as np
from numpy.typing import NDArray

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable
from probewatch.drivers.device_api import Description
from probewatch.drivers.errors import ConfigurationError, DeviceLost
from probewatch.drivers.outputs import TONE
from probewatch.drivers.printable import printable_bytes

RATE_HZ = 16_000
"""Samples a second: over twice the fifth partial of the highest pitch, 5 kHz. More makes more bytes, no other sound."""

_LATENCY_US = 100_000
"""Buffer of the sound card, microseconds. More starts and stops the sound later; less crackles when the host is busy.
Not measured.
"""

_LEAD_NS, _LONGEST_NS = 150_000_000, 300_000_000
"""How far ahead of the clock the player is fed, ns: three writes of 50 ms, so that two may be late; and the most at
once, after a pause. More starts and stops the sound later; less has gaps. Not measured on a busy cart.
"""

_HARMONICS = (1.0, 0.7, 0.5, 0.35, 0.25)
"""Amplitudes of fundamental and partials. IEC 60601-1-8 requires four partials within 15 dB of the fundamental;
tests/drivers/outputs/test_tone.py measures it. The sound of other series was not compared.
"""

_LEVEL = 0.5
"""Share of full scale for the peak of all partials together. The volume is the sound card's; the rest is headroom,
which resampling may need.
"""

_FADE = RATE_HZ // 100
"""Samples of a ramp, 10 ms. Shorter ramps click; longer ones blur pulses of 150 ms."""

_STALL_S = 0.5
"""Seconds for which the player's pipe may stay full. More reports a hung sound card later; less, a busy host as one."""


def open_output(target: str, options: dict[str, str], clock: HostClock) -> "ToneOutput":
    """Opens the sound card; see drivers.registry for what is raised. It is silent until the first write."""
    return ToneOutput(*checked(target, options), clock)


def checked(target: str, options: dict[str, str]) -> tuple[str, str, int]:
    """Returns (player, target, pitch, Hz). Raises ConfigurationError that names the option, or the player that is not
    installed.
    """
    given = TONE.given(options, f"tone:{target}")
    pitch_hz = given.integer("pitch")
    player = shutil.which("aplay")
    if player is None:
        raise ConfigurationError("the player aplay is not installed", given.where, "Install it: apt install alsa-utils")
    return player, target, pitch_hz


def tone(pitch_hz: int, first: int, count: int) -> NDArray[np.float64]:
    """Returns (count,) samples from sample `first` on, −1 … 1, of the fundamental and its harmonics."""
    phase = 2 * np.pi * pitch_hz * (first + np.arange(count)) / RATE_HZ
    waves = sum(weight * np.sin(order * phase) for order, weight in enumerate(_HARMONICS, 1))
    return np.asarray(_LEVEL * waves / sum(_HARMONICS))


class ToneOutput(Closable):
    """Keeps the player _LEAD_NS ahead of the clock; sound fades in and out over 10 ms so that it does not click."""

    def __init__(self, player: str, target: str, pitch_hz: int, clock: HostClock) -> None:
        self._where, self._pitch_hz, self._clock = f"tone:{target}", pitch_hz, clock
        self._at = 0
        self._fed_until_ns = clock.now_ns()
        self._sounding = False
        command = [player, "--quiet", "--device", target, "--file-type", "raw", "--format", "S16_LE"]
        command += ["--rate", str(RATE_HZ), "--channels", "1", "--buffer-time", str(_LATENCY_US)]
        self._player = self._started(command)
        assert self._player.stdin is not None
        os.set_blocking(self._player.stdin.fileno(), False)

    def _started(self, command: list[str]) -> subprocess.Popen[bytes]:
        try:
            return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        except OSError as error:
            what = f"the player cannot be started ({error.strerror})"
            raise DeviceLost(what, self._where, f"Check {command[0]}") from None

    def close(self) -> None:
        """See Closable."""
        self._player.kill()
        self._player.communicate()

    def describe(self) -> Description:
        """See drivers.device_api.Identified."""
        return Description(f"tone of {self._pitch_hz} Hz through aplay", remarks=("it falls silent with the service",))

    def write(self, energised: bool) -> None:
        """Plays silence when energised, else sound, until the next write. Raises DeviceLost."""
        due_ns = self._clock.now_ns() + _LEAD_NS
        count = min(due_ns - self._fed_until_ns, _LONGEST_NS) * RATE_HZ // 1_000_000_000
        if count < _FADE:
            return
        samples = self._block(count, not energised)
        self._fed_until_ns, self._at, self._sounding = due_ns, self._at + count, not energised
        self._feed((samples * 32767).astype("<i2").tobytes())

    def read_back(self) -> bool | None:
        """Returns None, because a loudspeaker reports nothing."""
        return None

    def _block(self, count: int, sounding: bool) -> NDArray[np.float64]:
        if not sounding and not self._sounding:
            return np.zeros(count)
        samples = tone(self._pitch_hz, self._at, count)
        ramp = np.linspace(0.0, 1.0, _FADE)
        if sounding and not self._sounding:
            samples[:_FADE] *= ramp
        elif not sounding:
            samples[:_FADE] *= ramp[::-1]
            samples[_FADE:] = 0
        return samples

    def _feed(self, data: bytes) -> None:
        """Feeds the player. A pipe that stays full means that the sound card takes no samples; it holds a few
        blocks.
        """
        assert self._player.stdin is not None
        fd = self._player.stdin.fileno()
        try:
            if not select.select([], [fd], [], _STALL_S)[1]:
                raise DeviceLost("the sound card takes no samples", self._where, "Check the sound card")
            os.write(fd, data)
        except OSError:
            raise self._ended() from None
        if self._player.poll() is not None:
            raise self._ended()

    def _ended(self) -> DeviceLost:
        assert self._player.stderr is not None
        self._player.kill()
        said = self._player.stderr.read().strip().splitlines()
        what = f"the player ended ({printable_bytes(said[-1]) if said else 'without a word'})"
        return DeviceLost(what, self._where, "Name a device that `aplay -L` lists")
