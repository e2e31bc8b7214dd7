"""The moving picture of the README."""

import re
from xml.etree import ElementTree

from probewatch.tools.development.status_film import LARGEST_BYTES, PICTURE, Look, film
from tests.tools.shared.test_status_view import status

ROOT = PICTURE.parents[2]
STATES = ("NOT VERIFIED", "MONITORING", "WARNING", "HALT")


def pictures(text: str) -> list[str]:
    """Words of each picture, in their order; raises where the file is no XML."""
    root = ElementTree.fromstring(text)
    frames = [one for one in root.iter() if one.get("class") == "f"]
    return ["".join(one.itertext()).replace("\xa0", " ") for one in frames]


def test_each_look_is_shown_for_as_long_as_it_lasted() -> None:
    looks = [Look(t_s, f"caption {t_s:g}", status()) for t_s in (10.0, 11.0, 13.0)]
    text = film(looks)
    assert ["caption 10" in one for one in pictures(text)] == [True, False, False]
    shown = [
        [float(at) for at in re.findall(r"([\d.]+)%\{visibility:visible", one)] for one in text.split("@keyframes")
    ]
    hidden = [
        [float(at) for at in re.findall(r"([\d.]+)%\{visibility:hidden", one) if float(at)]
        for one in text.split("@keyf")
    ]
    assert shown[1:] == [[0.0], [16.67], [50.0]]
    assert hidden[1:] == [[16.67], [50.0], []]


def test_the_picture_of_the_readme_goes_from_not_verified_to_a_halt_and_loads_nothing() -> None:
    text = PICTURE.read_text(encoding="utf-8")
    assert len(text.encode()) <= LARGEST_BYTES
    said = [next(state for state in STATES if f" {state} " in one) for one in pictures(text)]
    assert list(dict.fromkeys(said)) == [*STATES]
    assert "Marker body or tracker has turned" in pictures(text)[-1]
    assert not re.findall(r"(?:href|src)=|url\(|@import", text)
    assert f"({PICTURE.relative_to(ROOT)})" in (ROOT / "README.md").read_text(encoding="utf-8")
