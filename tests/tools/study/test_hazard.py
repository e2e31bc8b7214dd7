"""Hazards: what is told to be wrong is wrong, from when on it is told to be, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.parameters import limit_of_each
from probewatch.appliance.limits import Limits
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.rigid import inverse, rigid, rotation_from_vector
from probewatch.drivers.samples import Frame, PoseStatus
from probewatch.tools.study.hazard import CREEP_S, FAULTS, HIDDEN_S, ONSET_S, STANDARD, WITHIN, Hazard, Manner
from probewatch.tools.study.samples import Conditions, Tracker, samples, seconds
from probewatch.tools.study.session import Session

EXACT = Tracker(0.0, 0.0)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "not a known hazard"),
        ("bent", "not a known hazard"),
        ("bend-lateral", "has no size"),
        ("flip-lateral=3", "has a size"),
        ("bend-lateral=1..2", "not a number"),
        ("bend-lateral=5@night", "not a manner"),
        ("latency=5@sudden@start", "not KIND=SIZE@MANNER"),
        ("latency=soon@sudden", "not KIND=SIZE@MANNER"),
        ("bend-latral=6@start", "Did you mean 'bend-lateral'?"),
        ("bend-lateral=600@start", "bend-lateral=600 is out of bounds. Give up to 90 deg"),
        ("latency=-50000", "up to 5000 ms"),
    ],
)
def test_what_is_not_a_hazard_is_refused_by_name(text, what):
    with pytest.raises(ConfigurationError) as told:
        Hazard.parse(text)
    assert what in str(told.value)


def test_every_standard_hazard_reads_back_and_ought_to_be_named():
    assert [Hazard.parse(str(one)) for one in STANDARD] == list(STANDARD)
    assert len(set(STANDARD)) == len(STANDARD)
    assert {one.fault for one in STANDARD} == {None, *FAULTS.values()}


@pytest.mark.parametrize("manner", list(Manner))
def test_a_hazard_comes_as_its_manner_says(manner):
    t_s = np.array([0.0, ONSET_S - 0.1, ONSET_S + 0.1, ONSET_S + CREEP_S / 2, ONSET_S + CREEP_S])
    share = Hazard("bend-lateral", 5, manner).share(t_s)
    expected = {
        Manner.START: [1, 1, 1, 1, 1],
        Manner.SUDDEN: [0, 0, 1, 1, 1],
        Manner.CREEPING: [0, 0, 0.1 / CREEP_S, 0.5, 1],
        Manner.UNSEEN: [0, 0, 0, 1, 1],
    }[manner]
    assert share == pytest.approx(expected)


def of(hazard, duration_s=3.0):
    session = Session("in-plane", "still", 1, duration_s)
    blank = [np.zeros((300, 400), np.uint8)] * round(duration_s * 30)
    return session, list(samples(Conditions(session, Hazard.parse(hazard), EXACT), blank))


def poses(stream):
    return {pose.stamp.t_ns: pose.matrix for pose in stream if not isinstance(pose, Frame)}


@pytest.mark.parametrize(
    ("hazard", "turn_deg", "shift_mm"),
    [("bend-axial=5", (0, 5, 0), (0, 0, 0)), ("slide-axial=-3", (0, 0, 0), (0, -3, 0))],
)
def test_a_body_moves_on_the_probe_by_its_size_about_the_picture_axes(hazard, turn_deg, shift_mm):
    session, stream = of(f"{hazard}@start")
    healthy = poses(of("none")[1])
    X = rigid(session.reference.rotation, session.reference.offset_mm)
    true = rigid(
        rotation_from_vector(np.deg2rad(turn_deg)) @ X[:3, :3], session.reference.offset_mm + np.array(shift_mm)
    )
    for t_ns, matrix in poses(stream).items():
        assert np.allclose(matrix @ inverse(true), healthy[t_ns] @ inverse(X), atol=1e-9)


def test_a_late_tracker_tells_where_the_probe_was():
    healthy, late = poses(of("none")[1]), poses(of("latency=100@start")[1])
    assert all(np.allclose(late[t_ns + 100_000_000], healthy[t_ns]) for t_ns in list(healthy)[:60])


def test_an_unseen_change_shows_neither_picture_nor_pose():
    _, stream = of("slide-lateral=5@unseen", ONSET_S + HIDDEN_S + 1)
    away = [one for one in stream if ONSET_S <= seconds(one.stamp.t_ns) < ONSET_S + HIDDEN_S]
    assert len(away) == round(HIDDEN_S * 90)
    assert all(one.image.max() < 5 if isinstance(one, Frame) else one.status is PoseStatus.MISSING for one in away)


@pytest.mark.parametrize(
    ("kind", "place"), [("depth", (261, 311)), ("scale-lateral", (250, 311)), ("scale-axial", (261, 300))]
)
def test_pixels_a_tenth_smaller_show_the_picture_a_ninth_larger_about_its_middle(kind, place):
    image = np.zeros((301, 401), np.uint8)
    image[150 + 100, 200 + 100] = 255
    shown = Hazard(kind, -10.0, Manner.START).shown(image, 1.0)
    assert np.unravel_index(np.argmax(shown), shown.shape) == place


def test_two_at_once_are_each_alone_and_read_back():
    both = Hazard.parse("latency=120@start/depth=-10@sudden/flip-lateral@start")
    assert str(both) == "latency=120@start/depth=-10@sudden/flip-lateral@start"
    assert both.faults == {"latency", "scale", "polarity"}
    assert both.onset_s == ONSET_S, "from when on all of it is there"
    t_s = np.array([0.0, ONSET_S + 1])
    assert both.change(t_s)[:, [3, 4, 8]] == pytest.approx(np.array([[0, 0, 0.12], [-0.1, -0.1, 0.12]]))
    image = np.random.default_rng(1).integers(0, 255, (300, 400), np.uint8)
    assert np.array_equal(both.shown(image, 0.0), image[:, ::-1])
    zoomed = Hazard("depth", -10.0).shown(image, 0.0)
    assert np.array_equal(both.shown(image, ONSET_S + 1), zoomed[:, ::-1])


@pytest.mark.parametrize("text", ["none/latency=120", "latency=120/none", "latency=120/none/depth=5"])
def test_nothing_beside_a_hazard_is_refused(text):
    with pytest.raises(ConfigurationError, match="'none' beside a hazard"):
        Hazard.parse(text)


@pytest.mark.parametrize("text", ["latency=120/", "/latency=120", "latency=120/bent"])
def test_a_second_hazard_that_is_none_is_refused(text):
    with pytest.raises(ConfigurationError, match="not a known hazard"):
        Hazard.parse(text)


def test_no_hazard_leaves_every_picture_alone():
    image = np.random.default_rng(1).integers(0, 255, (300, 400), np.uint8)
    later = [one for one in STANDARD if one.onset_s > 0]
    assert all(np.array_equal(one.shown(image, ONSET_S - 1), image) for one in later)
    assert np.array_equal(replace(Hazard(), kind="flip-lateral").shown(image, 1.0), image[:, ::-1])


def test_what_lies_within_the_limits_is_of_all_nine_and_none_beyond_half() -> None:
    shares = np.abs([one.change(np.array([1.0]))[0] for one in WITHIN]) / limit_of_each(Limits())
    assert shares.max() <= 0.501
    assert np.all(shares.max(axis=0) > 0.25)
    assert len(set(WITHIN)) == len(WITHIN)
