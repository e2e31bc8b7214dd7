"""The transform from picture to probe as PLUS has it: conversion, both ways, and what is no such matrix."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe, image_to_probe
from probewatch.appliance.types import Calibration
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.rigid import vector_from_rotation
from tests.appliance.storage.test_calibration_file import SIZE_PX, calibration, same


def test_image_to_probe_takes_the_picture_centre_to_the_offset():
    """With R_x = 1 the centre lies at −t_x, and one pixel right of it λx mm further along x."""
    plain = Calibration(np.eye(3), (1, 1), np.array([0.2, 0.3]), np.array([5.0, 6.0, 7.0]), (101, 51))
    matrix = image_to_probe(plain)
    np.testing.assert_allclose(matrix @ [50, 25, 0, 1], [-5, -6, -7, 1])
    np.testing.assert_allclose(matrix @ [51, 25, 0, 1], [-4.8, -6, -7, 1])
    np.testing.assert_allclose(matrix @ [50, 26, 0, 1], [-5, -5.7, -7, 1])


def test_rotation_is_sensor_to_picture():
    """A sensor turned so that its y runs along the picture's x: R_x takes sensor y to picture x."""
    turned = calibration((0, 0, -np.pi / 2))
    np.testing.assert_allclose(turned.rotation @ [0, 1, 0], [1, 0, 0], atol=1e-12)
    direction = image_to_probe(turned) @ [1, 0, 0, 0]
    np.testing.assert_allclose(direction, [0, 0.22, 0, 0], atol=1e-12)


@given(
    rotvec=st.tuples(*[st.floats(-1.7, 1.7)] * 3),
    polarity=st.tuples(st.sampled_from([-1, 1]), st.sampled_from([-1, 1])),
)
@settings(max_examples=60, deadline=None)
def test_matrix_and_calibration_are_inverse(rotvec, polarity):
    given_one = calibration(rotvec, polarity)
    assert same(calibration_from_image_to_probe(image_to_probe(given_one), SIZE_PX, polarity), given_one)


def test_a_mirrored_matrix_is_refused_unless_polarity_explains_it():
    matrix = image_to_probe(calibration(polarity=(-1, 1)))
    with pytest.raises(ConfigurationError, match="mirrored"):
        calibration_from_image_to_probe(matrix, SIZE_PX)
    assert same(calibration_from_image_to_probe(matrix, SIZE_PX, (-1, 1)), calibration(polarity=(-1, 1)))


def test_a_missing_third_column_does_not_matter():
    matrix = image_to_probe(calibration())
    matrix[:3, 2] = 0
    assert same(calibration_from_image_to_probe(matrix, SIZE_PX), calibration())


def test_small_skew_is_shared_between_the_axes():
    matrix = image_to_probe(calibration((0, 0, 0)))
    matrix[:3, 1] = 0.26 * np.array([np.sin(0.02), np.cos(0.02), 0])
    vector = vector_from_rotation(calibration_from_image_to_probe(matrix, SIZE_PX).rotation)
    np.testing.assert_allclose(vector, [0, 0, 0.01], atol=1e-9)


@pytest.mark.parametrize(
    ("row", "column", "value", "complaint"),
    [
        (0, 0, np.nan, "not finite"),
        (3, 3, 2.0, "last row"),
        (0, 1, 0.03, "sheared"),
        (0, 2, 2.0, "sheared: its third axis"),
        (2, 2, -1.0, "mirrored"),
        (0, 0, 0.0, "scales 0 and"),
        (1, 1, 260.0, "scales 0.22 and 260"),
    ],
)
def test_what_is_not_scale_times_rotation_is_refused(row, column, value, complaint):
    matrix = image_to_probe(calibration((0, 0, 0)))
    matrix[row, column] = value
    with pytest.raises(ConfigurationError, match=complaint):
        calibration_from_image_to_probe(matrix, SIZE_PX, where="here")


PIXELS = np.diag([0.08, 0.07, 0.08, 1.0])
PIXELS[:3, 3] = 10, 20, 1


@pytest.mark.parametrize(
    ("matrix", "what", "remedy"),
    [
        (np.diag([1e-3, 1e-3, 1e-3, 1]) @ PIXELS, "scales 8e-05 and 7e-05", "in metres? Multiply"),
        (np.diag([1e3, 1e3, 1e3, 1]) @ PIXELS, "scales 80 and 70", "divide its upper three rows by 1000"),
        (np.linalg.inv(PIXELS), "scales 12.5 and 14.29", "the inverse, ProbeToImage"),
        (np.linalg.inv(np.diag([4.0, 4.0, 4.0, 1.0]) @ PIXELS), "the picture 2 m large", "the inverse, ProbeToImage"),
        (PIXELS.T, "the last row 10 20 1 1, not 0 0 0 1", "transposed"),
        (np.diag([0.08, 0.08, 0.08, 2]), "the last row 0 0 0 2", "Calibrate the probe again"),
        (np.diag([np.nan, 0.08, 0.08, 1]), "not finite", "Calibrate the probe again"),
        (PIXELS + 1e5 * np.eye(4, k=3), "puts the picture 100 m from", "its last column in mm"),
    ],
)
def test_a_matrix_of_another_unit_or_form_is_told_with_what_to_do_about_it(matrix, what, remedy):
    with pytest.raises(ConfigurationError) as told:
        calibration_from_image_to_probe(matrix, (640, 480))
    assert what in told.value.what
    assert remedy in told.value.remedy
