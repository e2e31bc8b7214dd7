"""The self-test of the first use: kept once it is green, and told beside every later one."""

from pathlib import Path
from typing import Any

import pytest

from probewatch.tools.commands.self_test import _kept
from probewatch.tools.selftest.baseline import beside, chosen, first_use
from probewatch.tools.selftest.items import Item
from probewatch.tools.selftest.records import read_self_tests

STATUS: dict[str, Any] = {"software": "0.2.0", "reference": None, "simulated": []}


def measured(rate_hz: float, noise_mm: float = 0.1, green: bool = True) -> list[Item]:
    return [
        Item("video rate", green, f"{rate_hz:.1f} / s", "", rate_hz, "/ s"),
        Item("noise at rest", True, f"{noise_mm:.2f} mm", "", noise_mm, "mm"),
        Item("disk", True, "3 GB free"),
    ]


def compared(folder: Path, items: list[Item]) -> dict[str, Item]:
    return {item.name: item for item in beside(items, first_use(read_self_tests(folder).kept))}


def test_without_a_first_use_nothing_is_compared(tmp_path: Path) -> None:
    _kept(tmp_path, measured(30.0), STATUS, "A. Smith", False)
    assert [*compared(tmp_path, measured(25.0)).values()] == measured(25.0)


@pytest.mark.parametrize(("rate_hz", "green"), [(30.0, True), (28.6, True), (31.4, True), (28.0, False), (60.0, False)])
def test_each_figure_is_told_beside_that_of_the_first_use_and_another_rate_is_red(
    tmp_path: Path, rate_hz: float, green: bool
) -> None:
    _kept(tmp_path, measured(30.0), STATUS, "A. Smith", True)
    _kept(tmp_path, measured(rate_hz, 0.3), STATUS, "B. Jones", False)
    found = compared(tmp_path, measured(rate_hz, 0.3))
    assert found["video rate"].what == f"{rate_hz:.1f} / s; first use 30 / s"
    assert (found["video rate"].green, bool(found["video rate"].remedy)) == (green, not green)
    assert (found["noise at rest"].what, found["noise at rest"].green) == ("0.30 mm; first use 0.1 mm", True)
    assert found["disk"].what == "3 GB free"
    assert found["first use"].what.startswith("compared with the self-test of 20")


def test_one_that_is_not_green_is_no_first_use(tmp_path: Path) -> None:
    bad = [*measured(5.0, green=False), chosen(measured(5.0, green=False))]
    assert (bad[-1].green, "not kept to compare with" in bad[-1].what) == (False, True)
    _kept(tmp_path, bad, STATUS, "A. Smith", True)
    assert first_use(read_self_tests(tmp_path).kept) is None
    assert chosen(measured(30.0)).green


def test_the_newest_first_use_counts_and_the_chain_stays_whole(tmp_path: Path) -> None:
    for rate_hz in (30.0, 60.0):
        _kept(tmp_path, measured(rate_hz), STATUS, "A. Smith", True)
    assert compared(tmp_path, measured(60.0))["video rate"].green
    assert read_self_tests(tmp_path).faults == []


def test_a_record_of_an_earlier_version_has_no_figures_to_compare_with() -> None:
    old = {"utc": "2026-01-01T07:00:00+00:00", "first_use": True, "items": [{"name": "video rate", "green": True}]}
    assert beside(measured(5.0), old)[:-1] == measured(5.0)
