"""Figures and pages of the evidence, from rows made by hand; the plans are what they say."""

import re
from functools import cache
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner

from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.development import evidence
from probewatch.tools.development.evidence import PLANS, coverage_plan, full_plan, main, short_plan
from probewatch.tools.development.evidence_figures import Figures, Score, figures
from probewatch.tools.development.evidence_pages import pages
from probewatch.tools.study.hand import PROGRAMS
from probewatch.tools.study.hazard import FAULTS
from tests.tools.study.test_summary import row

ROWS = [
    *(row("fan", seed, closed=0.2 * seed) | {"commit": "c1"} for seed in (1, 2, 3)),
    row("fan", 4, faults="scale", warnings=2, halts=1, closed=0.9) | {"commit": "c2"},
    *(row(seed=seed, hazard="depth=7@start", faults="scale", fault_s=2.0 * seed) | {"commit": "c1"} for seed in (1, 2)),
    row(seed=3, hazard="depth=7@start", faults="offset scale", fault_s=20.0, ok_gross_s=0.3) | {"commit": "c1"},
    row(seed=4, hazard="depth=7@start") | {"commit": "c1"},
    row(seed=1, hazard="flip-lateral@sudden", faults="polarity", fault_s=0.0, opened_s=0.05) | {"commit": "c1"},
]

for one in ROWS:
    one["duration_s"] = "6"


@cache
def measured() -> Figures:
    return figures(ROWS)


def test_figures_of_healthy_runs_and_of_each_hazard() -> None:
    found = measured()
    (fan,) = found.healthy
    assert (fan.runs, fan.closed, fan.faulted, fan.warnings, fan.halts) == (4, [0.2, 0.4, 0.6, 0.9], 1, 2, 1)
    assert fan.hours == pytest.approx(4 / 60, abs=1e-4)
    assert (fan.origin.seeds, fan.origin.commits) == ("1–4", ["c1", "c2"])
    depth, flip = found.found
    assert (depth.hazard, depth.runs, depth.named, depth.soon, depth.gross) == ("depth=7@start", 4, 2, 2, 1)
    assert depth.told == {"": 1, "offset": 1, "scale": 2}
    assert depth.fault_s == [2.0, 4.0, 20.0]
    assert depth.bound_s is not None
    assert 0.3 < depth.bound_s < 2.0
    assert (flip.bound_s, flip.open_s) == (None, [0.05])


def test_figures_outlive_json() -> None:
    found = measured()
    assert Figures.parse(found.plain()) == found


def test_pages_show_shares_with_intervals_bounds_confusion_and_origin() -> None:
    written = {path.name: text for path, text in pages(measured()).items()}
    text = written["evidence.md"]
    assert "| `depth=7@start` | 3/4 | 4.00 (2.00–20.00) | " in text
    assert re.search(r"`depth=7@start` .* \| 2/4 in 10 s, 2/4 rightly \|\n", text)
    assert "Unless a row says otherwise: in-plane, still, 6 s, 0.1 mm, " in text
    assert "2/4 7–93 %, 3/4 19–99 %" in text
    assert "| all | 0.07 | 4 | 1 | 71 | 2 | 1 | 71 |" in text, "Poisson: 4.74 ÷ hours"
    assert "| `scale` | 2/4 (7–93 %) | 1 nothing, 1 `offset` |" in text
    assert "`c1`" in text
    assert "| fan, still | 50 | 20–90 | 52 (5–100) |" in written["coverage.md"]
    for name in ("coverage.svg", "sensitivity.svg", "delay.svg", "roc.svg"):
        assert ElementTree.fromstring(written[name]).tag.endswith("svg")


def test_a_row_says_what_is_unusual_and_quiet_sessions_share_a_sentence() -> None:
    other = [row(seed=seed, hazard="depth=7@unseen") | {"commit": "c3"} for seed in range(1, 5)]
    other += [row(seed=seed, hazard="flip-axial@unseen") | {"commit": "c1"} for seed in range(1, 5)]
    other += [row(seed=seed, hazard="flip-lateral@unseen") | {"commit": "c1"} for seed in range(1, 5)]
    quiet = row("hold") | {"commit": "c1"}
    text = next(text for path, text in pages(figures([*ROWS, *other, quiet])).items() if path.name == "evidence.md")
    assert re.search(r"\| `flip-lateral@unseen` \|[^`\n]*\n", text)
    assert re.search(r"\| `depth=7@unseen` \|.*\| `c3` \|\n", text)
    usual = (
        "Unless a row says otherwise: in-plane, still, 60 s, 0.1 mm, seeds 1–4, `c1`; start: 6 s; sudden: 6 s, seeds 1;"
    )
    assert usual in text
    assert "| fan | 0.07 | 4 | 1 |" in text
    assert "Sessions without any: hold." in text


def with_nats(row: dict[str, str], nats: str) -> dict[str, str]:
    return row | {"nats": nats}


def test_the_roc_is_of_runs_that_kept_the_ratio_and_says_how_many_did_not() -> None:
    healthy, sick = ROWS[:4], ROWS[4:8]
    kept = [
        with_nats(row, nats)
        for row, nats in zip([*healthy, *sick], ["0", "0", "12", "7", "25", "19", "7", "0"], strict=True)
    ]
    now = figures(kept)
    assert (now.healthy[0].nats, now.found[0].nats) == ([0, 0, 7, 12], [0, 7, 19, 25])
    text = next(text for path, text in pages(now).items() if path.name == "evidence.md")
    # By hand: 16 pairs; 25 and 19 beat all four, 7 beats two and ties one, 0 ties two.
    assert "| `scale` | 2/4 (7–93 %) | 2/4 (7–93 %) | 0.719 |" in text
    assert "| healthy | 1/4 (1–81 %) | 0/4 (0–60 %) | – |" in text
    assert " 0 of 8 runs, without a ratio" in text
    before = [{name: cell for name, cell in row.items() if name != "nats"} for row in kept]
    old = figures(before)
    text = next(text for path, text in pages(old).items() if path.name == "evidence.md")
    assert " 8 of 8 runs, without a ratio" in text
    assert "Not measured." in text
    assert Figures.parse(old.plain()) == old


def test_figures_from_before_the_ratio_was_kept_are_read() -> None:
    plain = measured().plain()
    for one in (*plain["healthy"], *plain["found"]):  # type: ignore[misc]
        del one["nats"]
    assert Figures.parse(plain).healthy[0].nats == []  # type: ignore[arg-type]


def test_scores_are_of_all_looks_of_all_runs() -> None:
    looks = [("4", "1", "0.9"), ("12", "15", "3.2"), ("0", "0", "0"), ("0", "0", "0")]
    rows = [
        row | dict(zip((f"latency {one}" for one in ("looks", "squares", "worst")), cells, strict=True))
        for row, cells in zip(ROWS[:4], looks, strict=True)
    ]
    now = figures(rows)
    assert now.healthy[0].scores["latency"] == Score(1.0, 3.2)
    text = next(text for path, text in pages(now).items() if path.name == "coverage.md")
    assert re.search(r"\| still \(1\) \| .*; 4.0 \| 1.00; 3.2 \|\n", text)
    never = figures([row | {"latency looks": "0", "latency squares": "0"} for row in ROWS[:4]])
    assert "latency" not in never.healthy[0].scores
    for one in (now, never):
        assert Figures.parse(one.plain()) == one


def test_the_coverage_has_the_scores_of_every_check_in_every_world() -> None:
    measured_rows = [
        row(session, 1, tissue=tissue)
        | {"commit": "c1", "latency looks": "4", "latency squares": squares, "latency worst": worst}
        for session, tissue, squares, worst in (
            ("fan", "still", "1", "0.9"),
            ("hold", "still", "4", "2.5"),
            ("hold", "ribs-1", "16", "4.1"),
        )
    ]
    text = next(text for path, text in pages(figures(measured_rows)).items() if path.name == "coverage.md")
    assert "| offset-elevational | latency |\n" in text
    assert "| still (2) | 2.00; 4.0 |" in text
    assert "| 0.75 (0.50–1.00); 2.5 |\n" in text
    assert "| 2.00; 4.1 |\n" in text


def test_pages_of_nothing_say_so() -> None:
    written = {path.name: text for path, text in pages(Figures([], [])).items()}
    assert "Not measured." in written["coverage.md"]
    assert "| all |" not in written["evidence.md"]


def test_plans() -> None:
    short, full, coverage = short_plan(1), full_plan(1), coverage_plan(1)
    assert {one.hazard.kind for one in short} == {"none", *FAULTS}
    assert {one.session.name for one in coverage} == {*PROGRAMS, *(f"gesture-{name}" for name in PROGRAMS)}
    hours = sum(one.session.duration_s for one in full if one.hazard.kind == "none") / 3600
    assert PLANS["full"][1] * hours >= 1000
    for plan in (short, full, coverage):
        assert len({one.key for one in plan}) == len(plan)


def test_a_table_of_something_else_is_refused(tmp_path) -> None:
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    answer = CliRunner().invoke(main, ["--table", str(tmp_path / "other.csv")])
    assert isinstance(answer.exception, ConfigurationError)
    assert CliRunner().invoke(main, []).exit_code == 2


def test_what_was_not_measured_again_stays(tmp_path, monkeypatch) -> None:
    before = [row | {"commit": "before"} for row in ROWS]
    written: list[Figures] = []
    monkeypatch.setattr(evidence, "DATA", tmp_path / "evidence.json")
    monkeypatch.setattr(evidence, "read_figures", lambda: figures(before))
    monkeypatch.setattr(evidence, "pages", lambda now: written.append(now) or {})
    (tmp_path / "evidence.json").write_text("{}")
    again = [row for row in ROWS if row["hazard"] == "none"]
    evidence.write(again)
    (now,) = written
    assert [one.origin.commits for one in now.found] == [["before"]] * 2
    assert now.healthy == figures(again).healthy
    evidence.write([row | {"session": "hold"} for row in again])
    assert len(written[-1].healthy) == 2, "of other conditions"
