"""Healthy paths without pictures: they are what a registration would tell, and a wrong one is noticed."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from probewatch.tools.development import false_alarm_pages, false_alarms
from probewatch.tools.development.false_alarm_pages import false_alarm_lines, interval
from probewatch.tools.development.false_alarms import KEYS, NOISES, Quiet, main, planned, tracker_noise, written
from probewatch.tools.study.session import Session
from probewatch.tools.study.summary import Row

ROW: Row = {
    "session": "gesture-fan", "tissue": "still", "noise": "t5", "seed": "1", "duration_s": "1800", "signs": "2",
    "withdrawn": "1", "choices": "0", "faults": "1", "warnings": "1", "halts": "0", "ok_s": "450", "names": "scale",
    "peaks": "7.00 12.00", "bent": "3.00", "commit": "c1",
}  # fmt: skip


@pytest.mark.parametrize("kind", NOISES)
def test_every_noise_has_the_same_size_and_only_one_is_alike(kind: str) -> None:
    rows = tracker_noise(kind, 40_000, np.random.default_rng(2))
    assert np.std(rows) == pytest.approx(1.0, abs=0.03)
    alike = np.mean(rows[1:] * rows[:-1])
    assert alike == pytest.approx(0.9 if kind == "ar1" else 0.0, abs=0.03)
    assert (np.mean(rows**4) > 4) == (kind == "t5"), "the tails of Student's t"


@pytest.mark.thorough
def test_a_gesture_is_verified_and_raises_nothing() -> None:
    (row,) = Quiet(Session("gesture-in-plane", "still", 5001, 9.0), "gaussian").rows()
    assert [row[name] for name in ("signs", "choices", "faults", "warnings", "halts", "names")] == ["0"] * 5 + [""]
    assert float(row["ok_s"]) > 3


@pytest.mark.thorough
def test_a_path_that_the_calibration_does_not_explain_is_never_ok(monkeypatch: pytest.MonkeyPatch) -> None:
    """A registration that wanders by 5 mm per root second: this measurement must not call it verified."""
    monkeypatch.setattr(false_alarms, "_PICTURE_PX", 3.0)
    monkeypatch.setattr(false_alarms, "_WALK_MM", 5.0)
    (row,) = Quiet(Session("gesture-in-plane", "still", 5001, 6.0), "gaussian").rows()
    assert float(row["ok_s"]) == 0


def test_the_plan_is_every_session_tissue_and_noise_once_the_first_seed_first() -> None:
    plan = planned(2)
    keys = [quiet.key for quiet in plan]
    assert len(set(keys)) == len(plan) == 2 * 8 * 2 * 3
    assert all(len(key) == len(KEYS) for key in keys)
    seeds = [key[KEYS.index("seed")] for key in keys]
    assert seeds == sorted(seeds)


def test_rates_have_poisson_intervals_as_in_tables() -> None:
    """Garwood 1936: 0 events up to 3.689, 5 events 1.623 to 11.668."""
    assert interval(0, 1.0) == pytest.approx((0.0, 3.689), abs=1e-3)
    assert interval(5, 2.0) == pytest.approx((1.623 / 2, 11.668 / 2), abs=1e-3)


def test_totals_add_up_sessions_of_each_kind() -> None:
    other = ROW | {"noise": "ar1", "seed": "2", "faults": "0", "warnings": "0", "names": "", "peaks": "15.00"}
    figures = written([ROW, other])
    totals = figures["totals"]
    assert isinstance(totals, dict)
    assert totals["everything"] == {
        "rows": 2, "hours": 1.0, "ok_h": 0.25, "signs": 4, "withdrawn": 2, "choices": 0, "faults": 1, "warnings": 1,
        "halts": 0,
    }  # fmt: skip
    assert (totals["t5"]["faults"], totals["ar1"]["faults"], totals["fan"]["rows"]) == (1, 0, 2)
    assert figures["bent"] == [3.0, 3.0]
    assert (figures["seeds"], figures["names"], figures["peaks"]) == (2, {"scale": 1}, [15.0, 12.0, 7.0])


def test_the_command_goes_on_where_it_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each run plays what is left; the page is written of all that was played."""
    played: list[Quiet] = []

    def rows(quiet: Quiet) -> list[Row]:
        played.append(quiet)
        return [ROW | dict(zip(KEYS, quiet.key, strict=True))]

    figures = tmp_path / "figures.json"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Quiet, "rows", rows)
    for module in (false_alarms, false_alarm_pages):
        monkeypatch.setattr(module, "FIGURES", figures)
    for arguments, total in ((["--most-minutes", "0"], 1), ([], 48), ([], 48)):
        done = CliRunner().invoke(main, ["--seeds", "1", "--jobs", "1", *arguments])
        assert done.exit_code == 0, done.output
        assert len(played) == total
    text = "\n".join(false_alarm_lines())
    assert "| everything | 2.40 | 96 (32 to 49) |" in text
    assert "96 above 6, 48 above 8, 48 above 10, 0 above 13.5" in text
    assert "the highest 12.0. Of a distorted field: 0 above 6" in text
