"""A German cart's recorder answers in German."""

import re
from pathlib import Path
from typing import Any

import pytest

from probewatch.tools.commands import record
from probewatch.tools.german.recorder import GERMAN_OF_RECORDER, recorder_text
from tests.support.german import other_fields
from tests.tools.commands.test_record import ANSWER

OTHERWISE: list[dict[str, Any]] = [
    {},
    {"recording": False, "failing": "No space left", "marked": True},
    {"recording": False, "ring_files": 7, "kept_files": 1, "evicted_files": 3},
    {"lost_samples": 12, "withheld_pictures": 4},
]


@pytest.mark.parametrize("changed", OTHERWISE)
def test_every_row_is_told_in_german(changed: dict[str, Any]) -> None:
    for name, said in record.told({**ANSWER, **changed}):
        assert recorder_text(name, "de") != name or name == "ring"
        assert recorder_text(said, "de") != said or name == "session"
        assert recorder_text(said, "en") == said


def test_each_text_has_the_same_fields_and_is_said() -> None:
    source = Path(record.__file__).read_text()
    assert other_fields(GERMAN_OF_RECORDER) == []
    for english in GERMAN_OF_RECORDER:
        pieces = [one.strip(" ,:") for one in re.split(r"{\w+}", english) if re.search("[a-z]{3}", one)]
        assert all(piece.removesuffix("s") in source for piece in pieces), english
