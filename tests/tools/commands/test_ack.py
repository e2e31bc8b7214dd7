"""`probewatch ack`: what it says where there was nothing to acknowledge."""

from pathlib import Path
from typing import Any

import pytest

from appliance.service.control.server import ControlRefused, Peer
from appliance.supervision.alarms import ACKNOWLEDGED
from tests.support.answering import Answers
from tests.support.answers import answered


class _Refusing(Answers):
    """A service that grants no acknowledgement. why: as its supervisor says it."""

    def __init__(self, path: Path, why: str) -> None:
        super().__init__(path)
        self._why = why

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        raise ControlRefused(self._why)


@pytest.mark.parametrize(
    ("why", "said"),
    [
        ("not possible while not verified", "there is nothing to acknowledge: not possible while not verified"),
        (ACKNOWLEDGED, f"probewatch: already {ACKNOWLEDGED}"),
    ],
)
def test_a_person_is_told_whether_there_is_anything_to_acknowledge(tmp_path: Path, why: str, said: str) -> None:
    with _Refusing(tmp_path / "control", why) as service:
        answer = answered("ack", "--socket", service.path)
    assert (answer.returncode, said in answer.stderr) == (75, True), answer


class _Granting(Answers):
    """A service that grants what it is asked for."""

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        return {}


def test_that_a_sensor_was_checked_claims_no_bump_that_nobody_has_seen(tmp_path: Path) -> None:
    """The service does not say whether there was one."""
    with _Granting(tmp_path / "control") as service:
        answer = answered("ack", "--bump", "--socket", service.path)
    assert answer.returncode == 0, answer
    assert answer.stdout.startswith("recorded: the tracker's position sensor was checked; an alert of a bump, if")
