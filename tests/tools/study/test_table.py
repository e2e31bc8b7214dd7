"""The table of a study: taken up where it was left, and never mixed with something else."""

import re

import pytest

from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.study.table import StudyTable, code_digest, commit

KEYS = ("session", "seed")


def row(seed, closed="0.5"):
    return {"session": "in-plane", "seed": str(seed), "closed": closed, "faults": "scale, or not"}


def table(folder):
    return StudyTable(folder / "study.csv", KEYS)


def test_rows_come_back_and_count_as_done(tmp_path):
    one = table(tmp_path)
    one.add([row(1), row(2)])
    one.add([row(3)])
    again = table(tmp_path)
    assert again.rows == one.rows
    assert again.done == {("in-plane", "1"), ("in-plane", "2"), ("in-plane", "3")}
    assert again.rows[0] == row(1) | {"code": code_digest(), "commit": commit()}


@pytest.mark.thorough
def test_a_row_that_was_cut_is_done_again(tmp_path):
    table(tmp_path).add([row(1), row(2)])
    whole = (tmp_path / "study.csv").read_bytes()
    for cut in range(len(whole) - 1, whole.index(b"\n", whole.index(b"\n") + 1), -1):
        (tmp_path / "study.csv").write_bytes(whole[:cut])
        again = table(tmp_path)
        assert again.done == {("in-plane", "1")}
    again.add([row(2)])
    assert (tmp_path / "study.csv").read_bytes() == whole


def test_a_table_cut_in_its_heading_begins_again(tmp_path):
    (tmp_path / "study.csv").write_bytes(b"session,see")
    one = table(tmp_path)
    one.add([row(1)])
    assert table(tmp_path).done == {("in-plane", "1")}


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (b"a,b\n1,2\n", "not a table of this kind"),
        (b"session,seed,code,commit\nin-plane,1,other,c\n", "rows of other code"),
        (b"session,seed,code,commit\nin-plane\n", "too many or too few"),
        (b"session,seed,code,commit\nin-plane,1,x,y,z\n", "too many or too few"),
        (b'session,seed,code\n"in-plane,1,x\n', "not a table of a study"),
        (b"\xff\xfe\x00\n", "not a table of a study"),
    ],
)
def test_another_file_is_refused_and_stays(tmp_path, text, what):
    (tmp_path / "study.csv").write_bytes(text)
    with pytest.raises(ConfigurationError, match=what):
        table(tmp_path)
    assert (tmp_path / "study.csv").read_bytes() == text


def test_a_row_says_which_commit_made_it():
    """Or of which version, where the package was installed without its history."""
    assert re.fullmatch(r"[0-9a-f]{12,}\+?|version .+", commit())
