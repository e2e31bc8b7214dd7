"""Slips are suggested by one rule, in one form; what is like nothing suggests nothing."""

import pytest

from probewatch.drivers.suggestion import did_you_mean, suggested

KNOWN = (
    "halt",
    "hot",
    "bump",
    "url",
    "video",
    "offset",
    "offset-axial",
    "offset-lateral",
    "relay",
    "replay",
    "Box.mcap",
)


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("hlat", ["halt"]),
        ("hto", ["hot"]),
        ("bmup", ["bump"]),
        ("ulr", ["url"]),
        ("VIDEO", ["video"]),
        ("box.mcp", ["Box.mcap"]),
        ("relais", ["relay"]),
        ("re", ["relay", "replay"]),
        ("offset-axail", ["offset-axial"]),
        ("offset-", ["offset-axial", "offset-lateral"]),
        ("offset-of-everything", ["offset"]),
        ("colour", []),
        ("", []),
    ],
)
def test_what_a_slip_suggests(typed: str, meant: list[str]) -> None:
    assert suggested(typed, KNOWN) == meant


def test_of_many_names_with_one_beginning_only_the_most_similar_is_asked_about() -> None:
    assert suggested("ab", ["abcdef", "abx", "abcdeg", "abcdeh"]) == ["abx"]
    assert suggested("a", ["abcdef", "abcdeg", "abcdeh", "abcdei"]) == []


@pytest.mark.parametrize(
    ("meant", "question"),
    [([], ""), (["halt"], "Did you mean 'halt'?"), (["relay", "replay"], "Did you mean 'relay' or 'replay'?")],
)
def test_the_question(meant: list[str], question: str) -> None:
    assert did_you_mean(meant) == question
