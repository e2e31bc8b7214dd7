"""Echoes of an N-wire phantom in a real recording, against the phantom's own geometry; and latency of real sessions."""

import numpy as np
import pytest

from probewatch.appliance.crosswire.crossing import find_echoes
from probewatch.appliance.crosswire.drawings import Drawings
from probewatch.appliance.crosswire.latency import BottomLine
from probewatch.drivers.recordings.replay import open_recording
from tests.support.recordings import plus_file, with_late_poses

SCALE_MM_PER_PX = (0.0803, 0.0745)
"""Of the published calibration of this recording."""


@pytest.mark.thorough
def test_nine_wires_lie_where_the_phantom_has_them() -> None:
    """Three rows 10 mm apart; the outer wires of each are parallel, 30, 30 and 25 mm apart. A plane aslant sees them
    further apart, in the same ratio.
    """
    recording = open_recording(plus_file("fCal_Test_Validation_3NWires_fCal2.0.igs.mha"))
    images = [frame.image for frame in recording.frame_samples()]
    drawings = Drawings()
    drawn = [drawings.step(image) for image in images][-1]
    outer, down = [], []
    for image in images:
        places = np.array([echo.centre_px for echo in find_echoes(image, drawn, SCALE_MM_PER_PX)]) * SCALE_MM_PER_PX
        rows = places[np.argsort(places[:, 1])]
        if len(rows) != 9 or any(np.ptp(rows[first : first + 3, 1]) > 4 for first in (0, 3, 6)):
            continue  # a wire in shadow, or the phantom's wall
        rows = [row[np.argsort(row[:, 0])] for row in rows.reshape(3, 3, 2)]
        outer.append([np.linalg.norm(row[2] - row[0]) for row in rows])
        down.append(np.linalg.norm(rows[1][0] - rows[0][0]))
    apart = np.array(outer)
    assert len(apart) >= 35
    np.testing.assert_allclose(apart.mean(axis=0), [30, 30, 25], rtol=0.03)
    np.testing.assert_allclose((apart[:, 2] / apart[:, 1]).mean(), 25 / 30, rtol=0.01)
    assert apart[:, :2].std(axis=0).max() < 0.25
    assert np.mean(down) == pytest.approx(10, abs=0.3)


@pytest.mark.parametrize("more_s", [0.0, -0.4, 0.45, 0.9])
def test_the_bottom_of_a_water_tank_tells_the_latency_that_plus_finds(more_s: float) -> None:
    """PLUS: −64.8 ± 5 ms. more_s: added to the stamps of the poses. A stroke takes .5 s, as some of these."""
    video = plus_file("WaterTankBottomTranslationVideoBuffer.igs.mha")
    tracker = plus_file("WaterTankBottomTranslationTrackerBuffer-trimmed.igs.mha")
    bottom = BottomLine()
    for sample in with_late_poses(open_recording(video, poses=tracker).samples(), more_s):
        bottom.step(sample)
    found = bottom.latency()
    assert found is not None
    assert bottom.seen > 150
    assert found.value_s == pytest.approx(-0.065 + more_s, abs=0.010)
    assert abs(found.value_s + 0.0648 - more_s) < 2 * found.sigma_s < 0.03
