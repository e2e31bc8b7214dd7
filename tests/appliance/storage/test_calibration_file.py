"""Calibration files: conversion, round trips and refusals."""

import os
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from probewatch.appliance.storage.calibration_file import FORMAT, read_calibration, write_calibration
from probewatch.appliance.storage.image_to_probe import image_to_probe
from probewatch.appliance.types import PARAMETERS, Calibration
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.rigid import rotation_from_vector, vector_from_rotation
from tests.support.recordings import plus_file

SIZE_PX = (640, 480)


def calibration(rotvec=(0.1, -0.2, 1.4), polarity=(1, 1), covariance=None, observed=(True,) * 8):
    rotation = rotation_from_vector(np.array(rotvec, dtype=float))
    scale, offset = np.array([0.22, 0.26]), np.array([12.0, -40.0, 3.5])
    return Calibration(rotation, polarity, scale, offset, SIZE_PX, covariance, observed)


def same(first, second, atol=1e-9):
    np.testing.assert_allclose(first.rotation, second.rotation, atol=atol)
    np.testing.assert_allclose(first.scale_mm_per_px, second.scale_mm_per_px, atol=atol)
    np.testing.assert_allclose(first.offset_mm, second.offset_mm, atol=atol)
    assert (first.polarity, first.image_size_px) == (second.polarity, second.image_size_px)
    return True


def test_written_calibration_is_read_again(tmp_path):
    path = tmp_path / "probe.toml"
    sigma = np.array([0.01, 0.02, 0.03, 0.004, 0.005, 0.6, 0.7, np.inf])
    given_one = calibration(polarity=(-1, 1), covariance=np.diag(sigma**2), observed=(True,) * 7 + (False,))
    write_calibration(path, given_one, {"operator": 'A. "Boss" Müller\n', "made at": "2024-05-01T10:00:00Z"})
    read = read_calibration(path, SIZE_PX)
    assert same(read, given_one, 0)
    np.testing.assert_allclose(np.sqrt(np.diag(read.covariance)), sigma)
    assert read.observed == given_one.observed
    assert [entry.name for entry in tmp_path.iterdir()] == ["probe.toml"]


def test_toml_may_give_image_to_probe_instead(tmp_path):
    path = tmp_path / "probe.toml"
    rows = [[float(value) for value in row] for row in image_to_probe(calibration())]
    head = 'format = "probewatch-calibration"\nversion = 1\nimage_size_px = [640, 480]\n'
    path.write_text(f"{head}image_to_probe = {rows}\n")
    assert same(read_calibration(path), calibration())
    assert same(read_calibration(str(path)), calibration())


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(ConfigurationError, match="cannot be written"):
        write_calibration(tmp_path / "none" / "probe.toml", calibration(), {})


@pytest.fixture
def toml(tmp_path):
    path = tmp_path / "probe.toml"
    write_calibration(path, calibration((0, 0, 0), covariance=np.eye(8)), {"by": "test"})
    return path


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("version = 1", "version = 2", "version"),
        ("polarity = [1, 1]", "polarity = [1, 0]", "polarity"),
        ("polarity = [1, 1]", "polarty = [1, 1]", "polarty"),
        ("[1.0, 0.0, 0.0]", "[0.9, 0.0, 0.0]", "rotation is not a rotation matrix"),
        ("[1.0, 0.0, 0.0]", "[-1.0, 0.0, 0.0]", "rotation is not a rotation matrix"),
        ("[1.0, 0.0, 0.0]", "[nan, 0.0, 0.0]", "line 12: .rotation. entry 1 entry 1 = nan"),
        ("[1.0, 0.0, 0.0]", "[1.0, 0.0]", "line 12: .rotation. entry 1 entry 3 is missing"),
        ("scale_mm_per_px = [0.22", "scale_mm_per_px = [0.0", "line 17: .scale_mm_per_px. entry 1 = -?0"),
        ("scale_mm_per_px = [0.22", "scale_mm_per_px = [-0.22", "line 17: .scale_mm_per_px. entry 1 = -?0"),
        ("scale_mm_per_px = [0.22, 0.26]", "", "together"),
        ("offset_mm = [12.0", "offset_mm = [inf", "line 18: .offset_mm. entry 1 = inf"),
        ("offset_mm = [12.0", "offset_mm = [12000.0", "line 18: .offset_mm. entry 1 = 12000"),
        ("image_size_px = [640", "image_size_px = [0", "line 10: .image_size_px. entry 1 = 0: input"),
        ("rotation-lateral = 1.0", "rotation-lateral = -1.0", ".sigma. rotation-lateral = -1.0"),
        ("rotation-lateral = 1.0", "", "keys of .sigma."),
        ("not_observed = []", 'not_observed = ["all"]', ": not_observed has 'all'; it may name rotation"),
        ("version = 1", "version 1", "is not valid TOML"),
        ("version = 1", "version = " + 5000 * "1", "is not valid TOML"),
        ("version = 1", "version = " + 5000 * "[", "is not valid TOML"),
        ("offset_mm = [12.0", "offset_mm = [.5", "is not valid TOML: .*line 18.*begins with a digit"),
        (
            "offset_mm = [12.0",
            'offset_mm = ["12.0"',
            "line 18: .offset_mm. entry 1 = '12.0': input should be a valid num",
        ),
        (
            "offset_mm = [12.0",
            "offset_mm = [true",
            "line 18: .offset_mm. entry 1 = true: input should be a valid number",
        ),
        ("scale_mm_per_px = [0.22", 'scale_mm_per_px = ["0.22"', "line 17: .scale_mm_per_px. entry 1 = '0.22'"),
        ("[1.0, 0.0, 0.0]", '["1.0", 0.0, 0.0]', "line 12: .rotation. entry 1 entry 1 = '1.0'"),
        ("image_size_px = [640", 'image_size_px = ["640"', "line 10: .image_size_px. entry 1 = '640'"),
        ("polarity = [1, 1]", "polarity = [true, 1]", "polarity. entry 1 = true: .*must be a number"),
        ("rotation-lateral = 1.0", 'rotation-lateral = "1.0"', ".sigma. rotation-lateral = '1.0'"),
        ("not_observed = []", 'not_observed = []\nsimulated = "no"', "simulated. = 'no': must be true or false"),
    ],
)
def test_bad_toml_is_refused_with_its_key(toml, old, new, complaint):
    text = toml.read_text()
    assert old in text
    toml.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigurationError, match=complaint) as refusal:
        read_calibration(toml)
    assert str(toml) in str(refusal.value)
    assert refusal.value.remedy


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"0.1 0 0 10\n0 0.1 0 5\n0 0 0.1 3\n0 0 0 1\n", "is a bare matrix of 4 x 4 numbers. Write a .toml"),
        (b"1,0,0,0\n0,1,0,0\n0,0,1,0\n0,0,0,1\n", "is a bare matrix of 4 x 4 numbers"),
        (b"[1 0 0 0; 0 1 0 0; 0 0 1 0; 0 0 0 1]", "is a bare matrix of 4 x 4 numbers"),
        (b"#Insight Transform File V1.0\nTransform: Affine\n", "calibration import makes a .toml of it"),
        (b"NRRD0005\ntype: uint8\n\n\x8b", "is an NRRD file, not a calibration. Give a .toml"),
        (b"ObjectType = Image\nNDims = 3\n" + bytes(1_100_000), "is a MetaImage, not a calibration. Give a .toml"),
        (b"\x1aE\xdf\xa3" + bytes(1_100_000), "is a film, not a calibration"),
        (b'{"ImageToProbe": []}\n', "is a JSON file, not a calibration"),
    ],
)
def test_a_file_of_another_kind_is_told_as_that(tmp_path, content, said):
    path = tmp_path / "probe.txt"
    path.write_bytes(content)
    with pytest.raises(ConfigurationError) as told:
        read_calibration(path, (640, 480))
    assert said in str(told.value)


@pytest.mark.parametrize("content", [b"", b"\n \n"])
def test_an_empty_file_is_told_as_that(tmp_path, content):
    path = tmp_path / "probe.xml"
    path.write_bytes(content)
    with pytest.raises(ConfigurationError, match=r"is empty\. Copy it again"):
        read_calibration(path, (640, 480))


def test_pictures_of_another_size_are_refused(toml):
    with pytest.raises(ConfigurationError, match=r"\(640, 480\), the pictures are \(800, 600\)"):
        read_calibration(toml, (800, 600))


def test_sigma_names_are_the_parameters(toml):
    text = toml.read_text()
    assert all(f"{name} = 1.0" in text for name in PARAMETERS)


def test_the_radius_of_the_face_is_kept_and_bounded(tmp_path):
    path = tmp_path / "convex.toml"
    write_calibration(path, replace(calibration(), face_radius_mm=50.8), {})
    assert read_calibration(path).face_radius_mm == 50.8
    write_calibration(path, calibration(), {})
    assert read_calibration(path).face_radius_mm is None
    path.write_text(path.read_text().replace("not_observed", "face_radius_mm = 0.06\nnot_observed"))
    with pytest.raises(ConfigurationError, match="face_radius_mm"):
        read_calibration(path)


@given(at=st.floats(0, 1, exclude_max=True), length=st.integers(0, 30), patch=st.binary(max_size=12))
@settings(max_examples=100, deadline=None)
def test_no_mutation_escapes_as_another_error(tmp_path_factory, at, length, patch):
    path = tmp_path_factory.mktemp("m", numbered=True) / "probe.toml"
    write_calibration(path, calibration((0, 0, 0), covariance=np.eye(8)), {"by": "test"})
    data = path.read_bytes()
    cut = int(at * len(data))
    path.write_bytes(data[:cut] + patch + data[cut + length :])
    with suppress(ConfigurationError):
        read = read_calibration(path)
        assert np.abs(read.rotation @ read.rotation.T - np.eye(3)).max() < 1e-9


XML = """<PlusConfiguration><CoordinateDefinitions>
<Transform From="Image" To="Probe" Matrix="0 0.07 0 11  -0.08 0 0 48  0 0 0.075 0  0 0 0 1"/>
<Transform From="Image" To="TransducerOriginPixel" Matrix="1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"/>
</CoordinateDefinitions></PlusConfiguration>"""


def test_plus_device_set(tmp_path):
    path = tmp_path / "set.xml"
    path.write_text(XML)
    read = read_calibration(path, SIZE_PX)
    np.testing.assert_allclose(read.scale_mm_per_px, [0.08, 0.07])
    np.testing.assert_allclose(read.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(image_to_probe(read)[:3, 3], [11, 48, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('To="Probe"', 'To="Needle"', "no way from Image to Probe .* it has Image to Needle"),
        ("CoordinateDefinitions", "Elsewhere", "it has none"),
        ('To="TransducerOriginPixel"', 'To="Probe"', "two transforms Image to Probe"),
        ("0 0.07 0 11", "0 0.07 0", "sixteen numbers"),
        ("0 0.07 0 11", "0 x 0 11", "sixteen numbers"),
        ("0 0.07 0 11", "0 0.07 0 1_1", "sixteen numbers"),
        ("0 0.07 0 11", "0 0.07 0 \N{FULLWIDTH DIGIT ONE}1", "sixteen numbers"),
        ("0 0.07 0 11", "0 nan 0 11", "not finite"),
        ("0 0.07 0 11", "0 0 0 11", "scales"),
        ("0 0.07 0 11", "0.08 0.07 0 11", "sheared"),
        ("0 0.07 0 11", "0 -0.07 0 11", "mirrored"),
        ("</PlusConfiguration>", "", "not well-formed"),
        ("<PlusConfiguration>", "<!DOCTYPE a [<!ENTITY b SYSTEM 'file:///etc/passwd'>]><PlusConfiguration>", "DOCTYPE"),
    ],
)
def test_bad_device_sets_are_refused(tmp_path, old, new, complaint):
    path = tmp_path / "set.xml"
    assert old in XML
    path.write_text(XML.replace(old, new))
    with pytest.raises(ConfigurationError, match=complaint) as refusal:
        read_calibration(path, SIZE_PX)
    assert str(path) in str(refusal.value)


CHAIN = """<PlusConfiguration><CoordinateDefinitions>
<Transform From="Transducer" To="Probe" Matrix="0 1 0 12  -1 0 0 50  0 0 1 0  0 0 0 1"/>
<Transform From="Image" To="Transducer" Matrix="0.08 0 0 -25  0 0.07 0 3  0 0 0.08 0  0 0 0 1"/>
<Transform From="Probe" To="Image" Matrix="1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"/>
<Transform From="LeftImage" To="Probe" Matrix="0 0.07 0 11  -0.08 0 0 48  0 0 0.075 0  0 0 0 1"/>
</CoordinateDefinitions></PlusConfiguration>"""
"""In any order, and in a circle."""


def test_a_chain_of_transforms_is_composed_as_plus_does(tmp_path):
    """Image → Transducer → Probe: (column, row) → (.08 column − 25, .07 row + 3) → (.07 row + 15, −.08 column + 75)."""
    path = tmp_path / "chain.xml"
    path.write_text(CHAIN)
    wanted = [[0, 0.07, 0, 15], [-0.08, 0, 0, 75]]
    np.testing.assert_allclose(image_to_probe(read_calibration(path, SIZE_PX))[[0, 1]][:, [0, 1, 3]],
                               np.array(wanted)[:, [0, 1, 3]], atol=1e-12)  # fmt: skip


BACKWARDS = """<PlusConfiguration><CoordinateDefinitions>
<Transform From="Image" To="Transducer" Matrix="0.08 0 0 -25  0 0.07 0 3  0 0 0.08 0  0 0 0 1"/>
<Transform From="Probe" To="Transducer" Matrix="0 -1 0 50  1 0 0 -12  0 0 1 0  0 0 0 1"/>
</CoordinateDefinitions></PlusConfiguration>"""
"""CHAIN with its second transform stored the other way round."""


def test_a_transform_that_is_stored_the_other_way_round_is_turned(tmp_path):
    for name, text in (("forth.xml", CHAIN), ("back.xml", BACKWARDS)):
        (tmp_path / name).write_text(text)
    forth, back = (image_to_probe(read_calibration(tmp_path / name, SIZE_PX)) for name in ("forth.xml", "back.xml"))
    np.testing.assert_allclose(back, forth, atol=1e-12)
    wide = '<Transform From="Probe" To="Image" Matrix="12.5 0 0 100  0 10 0 50  0 0 10 0  0 0 0 1"/>'
    (tmp_path / "image.xml").write_text(
        f"<PlusConfiguration><CoordinateDefinitions>{wide}</CoordinateDefinitions></PlusConfiguration>"
    )
    read = read_calibration(tmp_path / "image.xml", SIZE_PX)
    np.testing.assert_allclose(read.scale_mm_per_px, [0.08, 0.1])
    np.testing.assert_allclose(image_to_probe(read)[:2, 3], [-8, -5], atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("0 -1 0 50  1 0 0 -12", "0 0 0 50  0 0 0 -12", "From Probe To Transducer: Matrix cannot be turned back"),
        ("0 -1 0 50  1 0 0 -12", "0 nan 0 50  1 0 0 -12", "not finite"),
        (
            "</Coord",
            '<Transform From="Probe" To="Transducer" Matrix="0"/></Coord',
            "two transforms Probe to Transducer",
        ),
    ],
)
def test_what_cannot_be_turned_round_is_refused(tmp_path, old, new, complaint):
    assert old in BACKWARDS
    (tmp_path / "back.xml").write_text(BACKWARDS.replace(old, new))
    with pytest.raises(ConfigurationError, match=complaint):
        read_calibration(tmp_path / "back.xml", SIZE_PX)


def test_a_picture_of_another_name_is_named_with_its_transform(tmp_path):
    path = tmp_path / "chain.xml"
    path.write_text(CHAIN.replace('"Image"', '"RightImage"'))
    np.testing.assert_allclose(read_calibration(path, SIZE_PX, "LeftImageToProbe").scale_mm_per_px, [0.08, 0.07])
    with pytest.raises(ConfigurationError, match=r"no way from Image to Probe .*name its transform, such as LeftImage"):
        read_calibration(path, SIZE_PX)


@pytest.mark.parametrize("matrix", ["1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", "0 1 0 12 -1 0 0 50 0 0 1 0 0 0 0 1"])
def test_the_placeholder_of_a_probe_that_was_never_calibrated_is_none(tmp_path, matrix):
    """The identity, or a rotation of unit scale: in a device set, our own file, and an ITK transform."""
    (tmp_path / "set.xml").write_text(XML.replace("0 0.07 0 11  -0.08 0 0 48  0 0 0.075 0  0 0 0 1", matrix))
    rows = [list(map(float, matrix.split()))[k : k + 4] for k in (0, 4, 8, 12)]
    of_ours = f'format = "{FORMAT}"\nversion = 1\nimage_size_px = [640, 480]\nimage_to_probe = {rows}\n'
    (tmp_path / "own.toml").write_text(of_ours)
    for name in ("set.xml", "own.toml"):
        with pytest.raises(ConfigurationError, match="the placeholder of a probe that was never calibrated"):
            read_calibration(tmp_path / name, (640, 480))


def test_a_device_set_needs_the_size_of_the_pictures(tmp_path):
    path = tmp_path / "set.xml"
    path.write_text(XML)
    with pytest.raises(ConfigurationError, match="size of the pictures"):
        read_calibration(path)


def test_absent_directory_and_oversized_files_are_refused(tmp_path):
    big = tmp_path / "big.xml"
    big.write_bytes(b"<" + 5_000_000 * b" ")
    long = tmp_path / "long.toml"
    long.write_text("x = [" + 10_000 * "1," + "]")
    pipe = tmp_path / "pipe.toml"
    os.mkfifo(pipe)
    refused = [(tmp_path, "not a file"), (tmp_path / "none", "cannot be read"), (big, "too large")]
    refused += [(long, "too large"), (pipe, "not a file"), (Path("/dev/zero"), "it is a device")]
    for path, complaint in refused:
        with pytest.raises(ConfigurationError, match=complaint):
            read_calibration(path, SIZE_PX)


def test_the_real_device_set():
    path = plus_file("PlusDeviceSet_fCal_Sim_VolumeReconstruction.xml")
    read = read_calibration(path, (820, 616))
    np.testing.assert_allclose(read.scale_mm_per_px, [0.0803, 0.0745], atol=1e-4)
    np.testing.assert_allclose(vector_from_rotation(read.rotation), [0.026, 0.007, 1.575], atol=1e-3)
    np.testing.assert_allclose(image_to_probe(read)[:3, 3], [11.2, 48.4, -0.3], atol=0.15)
    assert read.polarity == (1, 1)


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b"\x89HDF\r\n\x1a\n" + bytes(400), "is an HDF5 file, not a calibration"),
        (b"\x89PNG\r\n\x1a\n" + bytes(400), r"is a single picture \(PNG\), not a calibration"),
        (b"image_to_probe = '\xb5'\n", "is not UTF-8 text: line 1 has the byte 0xb5"),
    ],
)
def test_a_file_of_another_kind_is_named_by_its_kind(tmp_path: Path, data: bytes, what: str) -> None:
    (tmp_path / "given").write_bytes(data)
    with pytest.raises(ConfigurationError, match=what):
        read_calibration(tmp_path / "given")
