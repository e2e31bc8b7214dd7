"""Schedules of faults, and what each fault does to a picture or a pose."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.twins.faults import (
    CART_FAULTS,
    Episode,
    Schedule,
    blank_image,
    pose_time_s,
    spoil_image,
    spoil_pose,
)
from probewatch.drivers.twins.ndi.measurement import faults_of
from probewatch.drivers.twins.scene.metal import COMES_IN_S, DISPLACED_MM, LEAVES_AT_S, PLACE_MM, near_metal
from probewatch.drivers.twins.scene.world import World

IMAGE = np.random.default_rng(1).integers(0, 256, (48, 64), np.uint8)


def test_a_fault_is_on_from_its_start_up_to_its_end() -> None:
    schedule = Schedule.parse(
        '[{"fault": "depth", "from_s": 2, "to_s": 3.5}, {"fault": "latency", "from_s": 3, "to_s": null},'
        ' {"fault": "lose-video", "from_s": 9}]'
    )
    assert schedule.active(1.999) == frozenset()
    assert schedule.active(2.0) == {"depth"}
    assert schedule.active(3.0) == {"depth", "latency"}
    assert schedule.active(3.5) == {"latency"}
    assert schedule.active(1e6) == {"latency", "lose-video"}


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("[", "not JSON"),
        ("[" * 100_000, "not JSON"),
        ("{}", "not a list"),
        ("[7]", "each entry"),
        ('[{"fault": "depth"}]', "from_s"),
        ('[{"fault": "depth", "from_s": 1, "until": 2}]', "nothing else"),
        ('[{"fault": "dropped", "from_s": 1}]', "flip-lateral"),
        ('[{"fault": ["depth"], "from_s": 1}]', "flip-lateral"),
        ('[{"fault": "depth", "from_s": "1"}]', "from_s must"),
        ('[{"fault": "depth", "from_s": true}]', "from_s must"),
        ('[{"fault": "depth", "from_s": -1}]', "from_s must"),
        ('[{"fault": "depth", "from_s": NaN}]', "from_s must"),
        ('[{"fault": "depth", "from_s": 1' + "0" * 400 + "}]", "from_s must"),
        ('[{"fault": "depth", "from_s": 1, "to_s": Infinity}]', "to_s must"),
        ('[{"fault": "depth", "from_s": 2, "to_s": 2}]', "later"),
    ],
)
def test_a_faulty_schedule_is_refused_by_name(text: str, names: str) -> None:
    with pytest.raises(ConfigurationError, match=names) as refused:
        Schedule.parse(text)
    assert refused.value.exit_code == 78
    assert "fault schedule" in str(refused.value)


@given(
    st.text()
    | st.recursive(
        st.none() | st.floats() | st.text(),
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
        max_leaves=20,
    ).map(json.dumps)
)
def test_no_text_breaks_the_parser(text: str) -> None:
    try:
        Schedule.parse(text)
    except ConfigurationError:
        return


SECONDS = st.floats(0, 1e6)


@given(
    st.lists(
        st.builds(Episode, st.sampled_from(sorted(CART_FAULTS)), SECONDS, st.none() | SECONDS.map(lambda s: s + 2e6))
    )
)
def test_a_schedule_survives_being_written(episodes: list[Episode]) -> None:
    schedule = Schedule(tuple(episodes))
    assert Schedule.parse(schedule.to_json()) == schedule


def test_flips_and_zoom() -> None:
    assert np.array_equal(spoil_image(IMAGE, {"flip-lateral"}), IMAGE[:, ::-1])
    assert np.array_equal(spoil_image(IMAGE, {"flip-vertical", "latency"}), IMAGE[::-1])
    assert np.array_equal(spoil_image(IMAGE, {"lose-tracker"}), IMAGE)
    ramp = np.tile(np.arange(64, dtype=np.uint8) * 3, (48, 1))
    zoomed = spoil_image(ramp, {"depth"})
    assert zoomed.dtype == np.uint8
    expected = 3 * (31.5 + (np.arange(4, 60) - 31.5) / 1.1)
    np.testing.assert_allclose(zoomed[10, 4:60], expected, atol=0.6)
    down = spoil_image(np.ascontiguousarray(ramp.T), {"depth"}, top_row_px=5.0)
    np.testing.assert_allclose(down[:, 20], 3 * (5 + (np.arange(64) - 5) / 1.1), atol=0.6)


def test_pose_faults_are_of_the_promised_size_and_oblique_to_the_picture() -> None:
    world = World()
    pose = world.probe_pose(1.0)
    bent = np.linalg.inv(pose) @ spoil_pose(pose, {"bend-marker"})
    turn_deg = np.degrees(Rotation.from_matrix(bent[:3, :3]).as_rotvec())
    assert np.linalg.norm(turn_deg) == pytest.approx(5)
    assert np.abs(bent[:3, 3]).max() < 1e-9
    in_picture_deg = np.abs(world.sensor_to_picture[:3, :3] @ turn_deg)
    assert in_picture_deg.min() > 1.5
    assert in_picture_deg[2] > 3.5
    slid = np.linalg.inv(pose) @ spoil_pose(pose, {"slide-marker"})
    assert np.linalg.norm(slid[:3, 3]) == pytest.approx(10, abs=0.05)
    assert np.allclose(slid[:3, :3], np.eye(3))
    assert np.array_equal(spoil_pose(pose, {"depth"}), pose)


def test_a_blank_picture_is_black_but_for_faint_noise_that_changes() -> None:
    blank = blank_image(IMAGE.shape, 7)
    assert (blank.shape, blank.dtype, blank.max()) == (IMAGE.shape, np.uint8, 3)
    assert np.array_equal(blank, blank_image(IMAGE.shape, 7))
    assert not np.array_equal(blank, blank_image(IMAGE.shape, 9))


def test_sparse_poses_hide_the_tool_but_for_one_measurement_in_twelve() -> None:
    seen = ["missing" not in faults_of({"sparse-poses": 2.0, "bend-marker": 3.0}, count) for count in range(24)]
    assert seen == [count in (0, 12) for count in range(24)]
    assert faults_of({"sparse-poses": 2.0}, 1)["missing"] == 2.0
    assert faults_of({"bend-marker": 3.0}, 1) == {"bend-marker": 3.0}


def test_latency_reports_an_older_pose() -> None:
    assert pose_time_s(3.0, {"latency"}) == pytest.approx(2.9)
    assert pose_time_s(3.0, {"depth"}) == 3.0


def test_metal_comes_lies_and_leaves_and_bends_what_is_near_most() -> None:
    here = World(1).probe_pose(1.0)
    for t_s, share in (
        (0.0, 0.0),
        (COMES_IN_S / 2, 0.5),
        (COMES_IN_S, 1.0),
        (LEAVES_AT_S, 1.0),
        (LEAVES_AT_S + COMES_IN_S, 0.0),
    ):
        pushed = near_metal(here, here, t_s)[:3, 3] - here[:3, 3]
        assert np.linalg.norm(pushed) == pytest.approx(share * DISPLACED_MM)
        assert pushed @ PLACE_MM <= 0, "away from the metal"
    further = here.copy()
    further[:3, 3] -= PLACE_MM
    measured = near_metal(further, here, COMES_IN_S)
    assert np.linalg.norm(measured[:3, 3] - further[:3, 3]) == pytest.approx(DISPLACED_MM / 8), "at twice the distance"
    assert np.linalg.det(measured[:3, :3]) == pytest.approx(1.0)
