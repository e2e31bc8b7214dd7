"""Tables of the pages."""

from tools.development.markdown import shared_aside

HEAD = ("hazard", "session", "seeds")


def test_what_all_rows_say_is_said_once() -> None:
    lines = shared_aside(HEAD, [("a", "gesture", "1"), ("b", "gesture", "2")], ("session", "seeds"))
    assert lines == [
        "In all rows session: gesture.",
        "",
        "| hazard | seeds |",
        "| --- | --- |",
        "| a | 1 |",
        "| b | 2 |",
        "",
    ]


def test_one_row_stays_whole_and_so_do_columns_that_are_not_named() -> None:
    assert shared_aside(HEAD, [("a", "gesture", "1")], HEAD)[0] == "| hazard | session | seeds |"
    assert shared_aside(HEAD, [("a", "x", "1"), ("a", "y", "2")], ("session",))[0] == "| hazard | session | seeds |"
