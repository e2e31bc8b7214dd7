"""`probewatch self-test` without a service; that of a cart is in tests/live/test_feed.py."""

import io
from pathlib import Path

import pytest

from tests.support.answering import Answering, recorded
from tests.support.answers import answered
from tests.support.person import Person


@pytest.mark.parametrize("arguments", [("--socket", "/nowhere/control"), ("--config", "/nowhere.toml")])
def test_without_a_service_it_says_so(arguments: tuple[str, str]) -> None:
    shown = answered("self-test", *arguments, "--yes")
    assert shown.returncode in (69, 78)
    assert shown.stderr.count("\n") == 1


def test_where_nobody_can_be_asked_it_refuses_and_measures_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A probe that nobody laid down, and then moved, makes red lines that mean nothing."""
    monkeypatch.setattr("sys.stdin", io.StringIO())
    with Answering(tmp_path / "control") as service:
        shown = answered("self-test", "--socket", service.path, "--folder", tmp_path)
    assert (shown.returncode, shown.stdout) == (78, "")
    assert "needs an operator to lay the probe down" in shown.stderr
    assert "give --yes and --lamps" in shown.stderr
    assert service.asked == {}


def test_into_a_pipe_each_item_is_one_line_with_tabs_and_the_path_is_whole(tmp_path: Path) -> None:
    folder = tmp_path / ("long" * 20)
    with Answering(tmp_path / "control") as service:
        shown = answered("self-test", "--socket", service.path, "--folder", folder, "--yes", "--lamps", "skip")
    *items, judged, kept = shown.stdout.splitlines()
    assert {line.count("\t") for line in items} == {2}, shown
    assert {line.split("\t")[0] for line in items} <= {"✓", "✗", "?"}
    assert (judged.endswith("not green."), Path(kept.removeprefix("kept: ")).parent) == (True, folder)


def test_a_cart_without_lamps_is_not_asked_whether_they_were_seen(tmp_path: Path) -> None:
    """It asked "All seen and heard?" of nothing, and then said that this cart has none."""
    with Answering(tmp_path / "control") as service:
        service.changes = {"outputs": [{**recorded()["outputs"][0], "signal": "contact"}]}
        given = ("self-test", "--socket", service.path, "--folder", tmp_path / "kept", "--yes")
        with Person(*given) as person:
            shown = person.sees("kept: ")
            assert person.ends() == 1
    assert "this cart has none, only the contact" in shown
    assert "heard?" not in shown
