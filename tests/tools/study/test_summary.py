"""What rows say together, against tables in books and by hand; and the page that shows it."""

import re
from math import nan
from xml.etree import ElementTree

import pytest

from probewatch.appliance.core.parameters import MEASURED
from probewatch.tools.study.outcome import Outcome
from probewatch.tools.study.page import write_page
from probewatch.tools.study.summary import Share, coverages, detections, false_rate_per_hour, healthy_hours


@pytest.mark.parametrize(
    ("k", "n", "low", "high"),
    [(0, 10, 0, 0.3085), (1, 10, 0.0025, 0.4450), (5, 10, 0.1871, 0.8129), (10, 10, 0.6915, 1)],
)
def test_intervals_of_clopper_and_pearson(k, n, low, high):
    assert Share(k, n).interval == pytest.approx((low, high), abs=1e-4)


def test_no_event_in_three_hours_is_fewer_than_one_an_hour():
    assert false_rate_per_hour(0, 3.0) == pytest.approx(0.9986, abs=1e-3)  # the rule of three
    assert false_rate_per_hour(2, 1.0) == pytest.approx(6.296, abs=1e-2)  # Poisson, upper 95 %


def row(session="in-plane", seed=1, hazard="none", tissue="still", **changed):
    outcome = Outcome(frames=1800, closed=0.9, closed_s=2.0)
    for name, value in changed.items():
        setattr(outcome, name, value)
    for name in MEASURED:
        scores = outcome.scores[name]
        scores.last, scores.sigma, scores.bound, scores.looks, scores.squares, scores.worst = 0.1, 0.2, 0.1, 50, 200, 4
    key = {
        "session": session,
        "tissue": tissue,
        "seed": str(seed),
        "duration_s": "60",
        "noise_mm": "0.1",
        "draw": "1",
        "asked": "everything",
        "profile": "coarse",
    }
    return key | {"hazard": hazard} | outcome.row() | {"code": "abc"}


def test_coverage_is_of_healthy_runs_alone():
    rows = [row(seed=1, closed=0.2), row(seed=2, closed=0.8, closed_s=nan), row(hazard="depth=7@start", closed=0.0)]
    (one,) = coverages(rows)
    assert (one.session, one.closed, one.closed_s) == ("in-plane", (0.2, 0.8), 2.0)
    assert (one.scores["latency"].rms, one.scores["latency"].ratio) == (2.0, 2.0)
    assert healthy_hours(rows, 30.0) == pytest.approx(2 / 60)


def test_pictures_that_several_profiles_judge_are_one_hour(tmp_path):
    """Three profiles made three independent hours of one, and a bound three times too good."""
    rows = [row() | {"profile": profile} for profile in ("coarse", "clinical", "fine")]
    assert healthy_hours(rows, 30.0) == pytest.approx(1 / 60)
    write_page(tmp_path / "study.html", rows)
    text = (tmp_path / "study.html").read_text()
    assert text.count("Runs with a FAULT, everything, ") == 3
    assert text.count(f": 0; under {false_rate_per_hour(0, 1 / 60):.2g} per hour") == 3


def test_a_hazard_is_named_rightly_where_its_own_name_comes_first():
    rows = [
        row(hazard="depth=7@sudden", seed=1, faults="scale offset", fault_s=2.0, opened_s=1.0),
        row(hazard="depth=7@sudden", seed=2, faults="offset scale", fault_s=4.0, opened_s=3.0),
        row(hazard="depth=7@sudden", seed=3, ok_gross_s=0.5),
    ]
    (one,) = detections(rows)
    assert (one.found, one.named, one.gross) == (Share(2, 3), Share(1, 3), Share(1, 3))
    assert (one.fault_s, one.opened_s) == (3.0, 2.0)


def test_each_profile_is_told_apart():
    tight = {"profile": "clinical"}
    rows = [row(closed=0.9), row(closed=0.4) | tight, row(hazard="depth=4@start"), row(hazard="depth=4@start") | tight]
    assert [(one.profile, one.closed) for one in coverages(rows)] == [("clinical", (0.4,)), ("coarse", (0.9,))]
    assert [(one.profile, one.found.n) for one in detections(rows)] == [("clinical", 1), ("coarse", 1)]


def test_metal_has_no_limit_of_which_it_could_be_twice_and_hides_none_of_what_is_beside_it():
    (one,) = detections([row(hazard="metal=6@sudden")])
    assert (str(one.found), str(one.gross)) == ("0 of 1 (0 to 98 %)", "–")
    (one,) = detections([row(hazard="depth=10@start/metal=6@sudden", ok_gross_s=0.5)])
    assert one.gross == Share(1, 1)


def test_two_at_once_are_named_rightly_where_both_are_and_nothing_else():
    two = "latency=120@start/depth=7@start"
    rows = [
        row(hazard=two, seed=1, faults="latency", fault_s=2.0, named_s=5.0),
        row(hazard=two, seed=2, faults="latency scale", fault_s=2.0, named_s=5.0),
        row(hazard=two, seed=3, faults="latency", fault_s=2.0),
        row(hazard=two, seed=4, faults="latency rotation", fault_s=2.0, named_s=5.0),
    ]
    (one,) = detections(rows)
    assert (one.hazard, one.found, one.named) == (two, Share(4, 4), Share(2, 4))


def test_the_page_is_whole_and_asks_no_network(tmp_path):
    rows = [row(seed=1, faults="<scale>"), row("fan", 1, closed=0.0, closed_s=nan), row("fan", 2, tissue="breathing")]
    rows += [row(hazard="latency=450@sudden", fault_s=nan, ok_gross_s=1.0), row(hazard="depth=7@sudden", fault_s=1.0)]
    write_page(tmp_path / "study.html", rows)
    text = (tmp_path / "study.html").read_text()
    plots = re.findall(r"<svg.*?</svg>", text, re.DOTALL)
    assert len(plots) == 3
    for plot in plots:
        ElementTree.fromstring(plot)
    assert not re.findall(r"(?:src|href)\s*=\s*[\"']?https?:|@import|url\(http", text)
    assert "fan, breathing, 0.1 mm" in text
    assert '<td class="figure bad">1 of 1' in text
    assert "<th>hazard<th class=figure>FAULT" in text


def test_a_page_of_nothing_is_a_page(tmp_path):
    write_page(tmp_path / "study.html", [])
    assert "0 runs" in (tmp_path / "study.html").read_text()
