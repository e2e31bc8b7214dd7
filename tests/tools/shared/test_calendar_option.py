"""What is typed for a day, and what is said of what is none."""

import pytest

from tests.support.answers import answered


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("report", "--of", "15.01.2026"), "'15.01.2026' is not a day of the calendar, written as 2026-01-15"),
        (("report", "--of", "2026-02-30"), "'2026-02-30' is not a day of the calendar"),
        (
            ("log", "--since", "yesterday"),
            "'yesterday' is not a day or a time, written as 2026-01-15 or 2026-01-15T07:30",
        ),
        (("recalibrate", "--simulated", "--due", "May"), "'May' is not a day of the calendar"),
    ],
)
def test_what_is_no_day_is_refused_with_one_that_is(words: tuple[str, ...], said: str) -> None:
    answer = answered(*words)
    assert (answer.returncode, said in answer.stderr) == (2, True), answer.stderr
    assert "%" not in answer.stderr


def test_a_time_without_seconds_is_one(tmp_path) -> None:
    answer = answered("log", str(tmp_path), "--since", "2026-01-15T07:30")
    assert "holds no alarm log" in answer.stderr
