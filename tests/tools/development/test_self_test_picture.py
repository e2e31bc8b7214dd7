"""The picture of docs/self-test.md is what the self-test prints today, each figure judged by the limit beside it."""

import re
from xml.etree import ElementTree

import pytest

from probewatch.tools.development.self_test_picture import PICTURE, picture
from probewatch.tools.selftest import items
from tests.tools.selftest.test_items import poses

_MOST = re.compile(r"(-?[\d.]+) (%|ms), at most ([\d.]+) (?:%|ms)")
_LEAST = re.compile(r"([\d.]+) / s, ([\d.]+) / s at least")


def lines(text: str) -> list[str]:
    """Its lines, in their order; raises where the file is no XML."""
    rows: dict[float, list[tuple[float, str]]] = {}
    for one in ElementTree.fromstring(text).iter("{http://www.w3.org/2000/svg}text"):
        rows.setdefault(float(one.get("y", "0")), []).append((float(one.get("x", "0")), one.text or ""))
    return ["".join(said for _, said in sorted(rows[y])).replace("\xa0", " ").rstrip() for y in sorted(rows)]


def shown() -> dict[str, str]:
    """Name of each item of the picture, its mark before it, and what it says."""
    split = [re.split(r"  +", line, maxsplit=1) for line in lines(PICTURE.read_text(encoding="utf-8"))]
    return {parts[0]: parts[1] for parts in split if len(parts) == 2}


def test_no_figure_of_the_picture_is_green_beyond_the_limit_beside_it() -> None:
    """A pause of 1033 ms was green in it, which the self-test calls red since the service calls such a source lost."""
    judged = 0
    for name, said in shown().items():
        good = [float(value) <= float(most) for value, _, most in _MOST.findall(said)]
        good += [float(value) >= float(least) for value, least in _LEAST.findall(said)]
        judged += len(good)
        assert not good or name.startswith("✓") is all(good), (name, said)
    assert judged >= 10
    assert "longest pause" in shown()["✓ video regularity"]


def test_the_picture_says_how_many_lines_are_not_green_and_loads_nothing() -> None:
    text = PICTURE.read_text(encoding="utf-8")
    bad = sum(line.startswith(("✗", "?")) for line in lines(text))
    assert bad == 3, "docs/self-test.md says so"
    assert any(line.startswith(f"{bad} of ") for line in lines(text))
    assert not re.findall(r"(?:href|src)=|url\((?!#)|@import", text)


def test_a_record_is_drawn_as_it_was_judged() -> None:
    found = [items.noise(poses()), items.noise(poses(noise_mm=2.0)), items.noise([])]
    drawn = lines(picture({"items": [item.fields() for item in found]}))
    assert [line[0] for line in drawn if "noise at rest" in line] == ["✓", "✗", "?"]
    assert "2 of 3 are not green." in drawn


@pytest.mark.parametrize("name", ["video", "tracker"])
def test_the_picture_has_the_lines_of_each_source(name: str) -> None:
    assert {f"{name} {what}" for what in ("rate", "losses", "stamps", "regularity")} <= {
        one.split(" ", 1)[1] for one in shown()
    }
