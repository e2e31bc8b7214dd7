"""What other programs are given says the same as our file, and what they give is read or refused by name."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813  as its documentation does

from probewatch.appliance.storage.calibration_exchange import device_set_text, itk_text, read_itk
from probewatch.appliance.storage.calibration_file import read_calibration
from probewatch.appliance.storage.image_to_probe import image_to_probe
from probewatch.drivers.errors import ConfigurationError
from tests.support.crossings import SIZE_PX, TRUE

FAR = replace(TRUE, offset_mm=np.array([-812.25, 1420.5, 333.125]), scale_mm_per_px=np.array([0.0123, 0.31]))


@pytest.mark.parametrize("calibration", [TRUE, FAR])
def test_a_device_set_keeps_every_number(tmp_path: Path, calibration) -> None:
    file = tmp_path / "probe.xml"
    file.write_text(device_set_text(calibration, "My Probe & co"))
    read = read_calibration(file, SIZE_PX, "My Probe & co")
    np.testing.assert_allclose(image_to_probe(read), image_to_probe(calibration), rtol=0, atol=1e-9)


@pytest.mark.parametrize("calibration", [TRUE, FAR])
def test_an_itk_transform_keeps_every_number(tmp_path: Path, calibration) -> None:
    file = tmp_path / "probe.tfm"
    file.write_text(itk_text(calibration))
    np.testing.assert_allclose(image_to_probe(read_itk(file, SIZE_PX)), image_to_probe(calibration), rtol=0, atol=1e-9)


def test_slicer_counts_to_the_left_and_to_the_back() -> None:
    """Its loader inverts the matrix and turns x and y round; the result must map a pixel to the marker body's frame."""
    words = itk_text(TRUE).split("Parameters: ")[1].split("\n")[0].split()
    stored = np.eye(4)
    stored[:3, :3], stored[:3, 3] = np.array(words[:9], float).reshape(3, 3), np.array(words[9:], float)
    lps = np.diag([-1, -1, 1, 1])
    to_parent = np.linalg.inv(lps @ stored @ lps)
    np.testing.assert_allclose(to_parent @ [100, 50, 0, 1], image_to_probe(TRUE) @ [100, 50, 0, 1], atol=1e-9)


def test_a_centre_of_rotation_is_taken_into_account(tmp_path: Path) -> None:
    plain = itk_text(TRUE)
    words = plain.split("Parameters: ")[1].split("\n")[0]
    M = np.array(words.split()[:9], float).reshape(3, 3)
    t, centre = np.array(words.split()[9:], float), np.array([3.0, -4.0, 5.0])
    moved = " ".join(repr(float(v)) for v in [*M.ravel(), *(t - centre + M @ centre)])
    file = tmp_path / "centred.tfm"
    file.write_text(plain.replace(words, moved).replace("FixedParameters: 0 0 0", "FixedParameters: 3 -4 5"))
    np.testing.assert_allclose(image_to_probe(read_itk(file, SIZE_PX)), image_to_probe(TRUE), atol=1e-9)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda text: text.replace("#Insight", "#Outsight"), "is not an ITK text transform"),
        (lambda text: text.replace("Affine", "BSpline"), "not one linear transform"),
        (lambda text: text + text, "not one linear transform"),
        (lambda text: text.replace("Parameters: ", "Parameters: 7 ", 1), "Parameters are not 12 numbers"),
        (lambda text: text.replace("FixedParameters: 0", "FixedParameters: nan"), "FixedParameters are not 3 numbers"),
        (lambda text: text[: text.index("Parameters")], "FixedParameters are not 3 numbers"),
        (lambda text: f"{text[: text.index('Param')]}Parameters: {'0 ' * 12}\nFixedParameters: 0 0 0\n", "turned back"),
        (lambda text: text + "#" * 30_000, "is not an ITK text transform"),
        (lambda text: "", "is not an ITK text transform"),
    ],
)  # fmt: skip
def test_what_is_no_linear_transform_is_refused_by_name(tmp_path: Path, change, what: str) -> None:
    file = tmp_path / "bad.tfm"
    file.write_text(change(itk_text(TRUE)))
    with pytest.raises(ConfigurationError, match=what):
        read_itk(file, SIZE_PX)


@pytest.mark.parametrize("calibration", [TRUE, FAR])
def test_by_itk_itself_it_becomes_hdf5_and_comes_back(tmp_path: Path, calibration) -> None:
    """docs/recalibration.md says so to whoever needs .h5; on the way its reader finds the same numbers in our text."""
    text, hdf5, back = (str(tmp_path / name) for name in ("probe.tfm", "probe.h5", "back.tfm"))
    Path(text).write_text(itk_text(calibration))
    sitk.WriteTransform(sitk.ReadTransform(text), hdf5)
    found = sitk.AffineTransform(sitk.ReadTransform(hdf5))
    to_parent = np.linalg.inv(np.array(found.GetMatrix()).reshape(3, 3))
    pixel = to_parent @ (np.zeros(3) - np.array(found.GetTranslation()))
    lps = np.diag([-1, -1, 1])
    np.testing.assert_allclose(lps @ pixel, image_to_probe(calibration)[:3, 3], rtol=0, atol=1e-9)
    sitk.WriteTransform(sitk.ReadTransform(hdf5), back)
    read = read_itk(Path(back), SIZE_PX)
    np.testing.assert_allclose(image_to_probe(read), image_to_probe(calibration), rtol=0, atol=1e-9)
