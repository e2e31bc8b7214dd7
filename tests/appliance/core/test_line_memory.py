"""Ten minutes of pictures through the line: what it keeps is bounded, so nothing may grow with the pictures."""

import gc
import resource
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from probewatch.appliance.core.line import Line
from probewatch.appliance.limits import Limits
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.drivers.samples import Frame, Sample, Stamp
from probewatch.drivers.twins.scene.world import World
from tests.support.rendered import SMALL
from tests.support.sessions import session

_MINUTES = 10
_LOOP_S, _FPS = 12.0, 30
_SETTLED_MINUTES, _GROWTH_BYTES_PER_PICTURE = 3, 300


def played(samples: list[Sample], loops: int) -> Iterator[Sample]:
    """The same seconds again and again, with stamps and numbers that go on."""
    for loop in range(loops):
        later_ns, later = round(loop * _LOOP_S * 1e9), loop * len(samples)
        for sample in samples:
            stamp = Stamp(sample.stamp.t_ns + later_ns, sample.stamp.err_ns)
            yield replace(sample, stamp=stamp, sequence=sample.sequence + later)


def resident_bytes() -> int:
    """Of this process, after what nobody refers to has gone."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


@pytest.mark.slow
def test_ten_minutes_of_pictures_leave_no_more_memory_than_three() -> None:
    world = World(1, settings=SMALL)
    line = Line(calibration_from_image_to_probe(world.image_to_probe, (320, 240)), Limits())
    loops = round(60 * _MINUTES / _LOOP_S)
    held: list[int] = []
    pictures = 0
    for sample in played(list(session(world, _LOOP_S)), loops):
        line.step(sample)
        if isinstance(sample, Frame):
            pictures += 1
            if pictures % (60 * _FPS) == 0:
                held.append(resident_bytes())
    assert pictures == 60 * _FPS * _MINUTES
    print(f"{np.array(held) / 1e6} MB after each minute")
    later = (_MINUTES - _SETTLED_MINUTES) * 60 * _FPS
    assert max(held[_SETTLED_MINUTES:]) - held[_SETTLED_MINUTES - 1] < _GROWTH_BYTES_PER_PICTURE * later
