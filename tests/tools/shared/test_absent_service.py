"""Programs that run beside the service warn at their start if no service answers."""

from pathlib import Path

import pytest

from probewatch.tools.shared.absent_service import warn_if_absent
from tests.support.answering import Answering


def test_a_missing_service_is_told_and_one_that_answers_is_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Answering(tmp_path / "control"):
        warn_if_absent(tmp_path / "control")
    assert capsys.readouterr() == ("", "")
    warn_if_absent(tmp_path / "control")
    told = capsys.readouterr()
    assert (told.out, f"{tmp_path / 'control'}: no service answers" in told.err) == ("", True)
