"""Tables of the pages."""

from probewatch.tools.development.markdown import shared_aside

HEAD = ("hazard", "session", "seeds")


def test_what_all_rows_say_is_said_once() -> None:
    lines = shared_aside(HEAD, [("a", "gesture", "1"), ("b", "gesture", "2")], ("session", "seeds"))
    assert lines == [
        "Unless a row says otherwise, session: gesture.",
        "",
        "| hazard | seeds |",
        "| --- | --- |",
        "| a | 1 |",
        "| b | 2 |",
        "",
    ]


def test_what_most_rows_say_is_said_once_and_the_others_keep_theirs() -> None:
    lines = shared_aside(HEAD, [("a", "gesture", "1"), ("b", "fan", "1"), ("c", "gesture", "1")], ("session", "seeds"))
    assert lines[0] == "Unless a row says otherwise, session: gesture; seeds: 1."
    assert lines[2:] == ["| hazard | session |", "| --- | --- |", "| a |  |", "| b | fan |", "| c |  |", ""]


def test_one_row_stays_whole_and_so_do_columns_that_are_not_named() -> None:
    assert shared_aside(HEAD, [("a", "gesture", "1")], HEAD)[0] == "| hazard | session | seeds |"
    assert shared_aside(HEAD, [("a", "x", "1"), ("a", "y", "2")], ("session",))[0] == "| hazard | session | seeds |"
