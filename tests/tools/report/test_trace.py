"""What a page draws is what the recording holds."""

from dataclasses import replace
from math import isfinite

import numpy as np
import pytest

from probewatch.appliance.core.line import Line
from probewatch.appliance.limits import Limits
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.drivers.samples import Pose
from probewatch.drivers.twins.faults import Schedule
from probewatch.drivers.twins.scene.world import WorldSettings
from probewatch.tools.report.svg import Plot, ticks
from probewatch.tools.report.trace import Trace
from tests.support.sessions import kept, session

SMALL = WorldSettings(width_px=400, height_px=300, scale_mm_per_px=(0.09, 0.08))
BENT = '[{"fault": "bend-marker", "from_s": 3.0, "to_s": null}]'


def traced(schedule: str = "[]") -> Trace:
    world, trace = kept(3, settings=SMALL), Trace()
    line = Line(calibration_from_image_to_probe(world.image_to_probe, (400, 300)), Limits())
    for sample in session(world, 4.0, Schedule.parse(schedule)):
        trace(sample, line.step(sample), line)
    return trace


def apart_mm(trace: Trace, from_s: float) -> float:
    """RMS between both paths since then, as they lie on one another there."""
    rows = [
        (one[0] - two[0], one[1] - two[1])
        for t_s, one, two in zip(trace.paths.t_s, trace.paths.picture, trace.paths.tracker, strict=True)
        if t_s >= from_s and isfinite(one[0])
    ]
    apart = np.array(rows) - rows[0]
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


@pytest.mark.thorough
def test_both_paths_lie_on_one_another_until_the_marker_body_is_bent() -> None:
    sound, bent = traced(), traced(BENT)
    assert len(sound.paths.t_s) > 100
    assert apart_mm(sound, 0.5) < 0.5
    assert apart_mm(bent, 2.5) > 3 * apart_mm(sound, 2.5)


def test_curves_and_the_first_picture_are_there() -> None:
    trace = traced()
    assert trace.duration_s == pytest.approx(4.0, abs=0.1)
    assert {"polarity", "latency", "scale-axial", "offset-elevational"} <= set(trace.curves)
    assert trace.curves["latency"].unit == "ms"
    assert 35 <= len(trace.curves["latency"].t_s) <= 41
    assert trace.first is not None
    image, mask, u_px = trace.first
    assert image.shape == mask.shape == (300, 400)
    assert 0 < np.count_nonzero(~mask) < 0.2 * mask.size
    assert np.isfinite(u_px).all()


@pytest.mark.parametrize(
    ("low", "high", "wanted"),
    [(0, 10, [0, 2, 4, 6, 8, 10]), (-0.3, 0.3, [-0.2, 0, 0.2]), (5, 5, [5]), (0, 31, [0, 10, 20, 30])],
)
def test_ticks_are_round_numbers(low: float, high: float, wanted: list[float]) -> None:
    found = ticks(low, high)
    assert found == pytest.approx(wanted) or len(found) >= len(wanted)
    assert all(low - 1e-6 <= one <= high + 1e-6 for one in found)


def test_a_name_beside_a_row_ends_before_the_plot_begins() -> None:
    """In the plot it lay across the bars."""
    plot = Plot((0, 3), (0, 2), "s", "", left=150)
    plot.block(0, 3, 0, 1, "good", "shown")
    plot.row(0.5, "rotation-elevational")
    drawn = plot.svg("coverage")
    assert '<rect class="good" x="150.0"' in drawn
    assert '<text class="left" x="144"' in drawn


def test_a_plot_breaks_where_nothing_is_known_and_escapes_what_it_is_told() -> None:
    plot = Plot((0, 3), (0, 1), "s", "<b>")
    plot.line([0, 1, 2, 3], [0, float("nan"), 1, 1], "a")
    plot.band([0, 1, 2, 3], [0, float("nan"), 0, 0], [1, 1, 1, 1], "a")
    svg = plot.svg('a "title" & more')
    assert svg.count("<polyline") == 2
    assert svg.count("<polygon") == 2
    assert "<b>" not in svg
    assert 'aria-label="a &quot;title&quot; &amp; more"' in svg


def test_poses_with_the_stamps_of_their_pictures_have_paths() -> None:
    """The page of every PLUS sequence said that no picture was followed."""
    world, trace = kept(3, settings=SMALL), Trace()
    line = Line(calibration_from_image_to_probe(world.image_to_probe, (400, 300)), Limits())
    pose: Pose | None = None
    for sample in session(world, 2.0, Schedule.parse("[]")):
        if isinstance(sample, Pose):
            pose = sample
            continue
        if pose is None:
            continue
        for one in (replace(pose, stamp=sample.stamp), sample):
            trace(one, line.step(one), line)
    assert len(trace.paths.t_s) > 30
