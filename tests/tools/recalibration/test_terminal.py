"""Every step of `probewatch recalibrate --live` that a person takes at a terminal, on a real pseudo-terminal.

Before a service that recalibrates, whose feed is as fast as a scan is looked at; beside a whole cart:
tests/live/test_recalibrate_live.py.
"""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import pytest

from probewatch.appliance.service.control.server import ControlRefused
from probewatch.tools.recalibration.terminal import _answer
from tests.support.live_scan import RecalibratingService, Scan
from tests.support.person import Person
from tests.support.polling import until
from tests.tools.recalibration.test_session import truth, wires

pytestmark = pytest.mark.thorough

ASKED = ["--probe", "L12-5", "--preset", "4 cm", "--made-by", "A. Smith"]
REVIEW = "numbers of views to strike out or take back:"
ZETA = re.compile(r"ζ (-?[\d.]+) ± ([\d.]+) mm")


@pytest.fixture
def service(tmp_path: Path) -> Iterator[RecalibratingService]:
    """One that finds the new calibration far from the one in force."""
    with RecalibratingService(tmp_path, truth()) as service:
        service.proposal["confirm"] = True
        yield service


def reviewed(person: Person) -> str:
    """ζ of the review, as it stands there."""
    found = ZETA.findall(person.sees(REVIEW))
    assert found
    return " ± ".join(found[-1])


def answered(person: Person, *pairs: tuple[str, str]) -> None:
    for question, answer in pairs:
        person.sees(question)
        person.types(answer)


SIGNATURE = (
    ("name of the second person:", "a.  smith"),
    ("made it and cannot sign it as well", "B. Jones"),
    ("role:", "engineer"),
    ("why is there no check at another point:", "the tank stands in a frame"),
    ("comment", "good"),
)


def scanning(service: RecalibratingService, folder: Path, *more: str) -> Person:
    return Person("recalibrate", "--live", "--socket", service.path, "--folder", folder, *more, *ASKED)


def test_a_scan_with_everything_a_person_may_do_on_the_way(service: RecalibratingService, tmp_path: Path) -> None:
    """Latency left out, ended too early, scanned on, a view struck out and taken back, checked, rejected."""
    with Scan(service, wires(1500)), scanning(service, tmp_path, "--latency-first") as person:
        person.sees("'skip' leaves it to the scan")
        assert service.is_held
        person.sees("not known yet")
        person.types("")
        person.sees("the motion does not show how late the tracker is")
        person.types("skip")
        person.sees("Scan the crossing; Enter when it is complete")
        person.sees("too few views", 60)
        person.sees("3 views in", 120)
        person.types("")
        assert "too few views" in person.sees(REVIEW)
        person.types("accept")
        person.sees("usable views of the crossing")
        person.sees(REVIEW)
        person.types("scan on")
        person.sees("The scan is complete: press Enter", 240)
        person.types("")
        zeta = reviewed(person)
        person.types("2")
        assert reviewed(person) != zeta, "a view is struck out"
        person.types("2")
        assert reviewed(person) == zeta, "and taken back"
        person.types("99")
        person.sees("'99' is no answer")
        person.sees(REVIEW)
        person.types("what?")
        person.sees("'what?' is no answer")
        person.sees(REVIEW)
        person.types("check")
        person.sees("Move the tank by 2 cm and more")
        person.sees("passages through the other crossing")
        person.types("")
        assert "check at another point" in person.sees(REVIEW)
        person.types("reject")
        person.sees("rejected: in the terminal")
        assert person.ends() == 75
    assert (service.state, service.sha256, service.taken) == ("not verified", "before", None)
    assert list(tmp_path.glob("*.toml")) == []


@pytest.mark.parametrize("how", ["interrupts", "hangs up"])
def test_who_goes_away_from_the_review_leaves_the_calibration_before(
    service: RecalibratingService, tmp_path: Path, how: str
) -> None:
    with Scan(service, wires(300)), scanning(service, tmp_path) as person:
        person.sees("1 views in", 120)
        person.types("")
        person.sees(REVIEW)
        assert (service.state, service.is_held) == ("recalibrating", True)
        if how == "interrupts":
            person.interrupts()
            assert person.ends() == 130
            assert "stopped: nothing was changed, reference" in person.text
            assert service.asked[-1] == "abort-recalibration"
        else:
            person.process.kill()
        until(lambda: not service.is_held)
    assert (service.sha256, service.taken) == ("before", None)
    assert list(tmp_path.glob("*.toml")) == []


def test_a_difference_is_stated_and_nothing_is_taken_before_it_is_accepted(
    service: RecalibratingService, tmp_path: Path
) -> None:
    with Scan(service, wires(700)), scanning(service, tmp_path) as person:
        person.sees("The scan is complete: press Enter", 240)
        person.types("")
        for answer in ("", "n"):  # no is what Enter says
            person.sees(REVIEW)
            person.types("accept")
            answered(person, *SIGNATURE)
            assert "hardly" in person.sees("Accept that? Nothing of it is verified then. [y/N]:")
            person.types(answer)
        person.sees(REVIEW)
        assert service.taken is None
        assert list(tmp_path.glob("*.toml")) == []
        person.types("accept")
        answered(person, *SIGNATURE, ("Accept that?", "y"))
        person.sees("Now move the probe over tissue")
        until(lambda: service.taken is not None)
        service.state = "monitoring"
        person.sees("the service has verified the new calibration")
        person.sees("written:")
        assert person.ends() == 0
    said = tomllib.loads(service.taken.decode())
    assert said["provenance"]["check"] == "not made: the tank stands in a frame"


@pytest.mark.parametrize(
    ("said", "refused"),
    [("foo", "'foo'"), ("yes", "'yes'"), ("0", "'0'"), ("1 4", "'4'"), ("2, acept", "'acept'")],
)
def test_an_answer_that_is_none_is_told_what_is_accepted_and_changes_nothing(said: str, refused: str) -> None:
    class Session:
        struck: ClassVar[list[tuple[int, bool]]] = []

        def strike(self, index: int, struck: bool) -> None:
            self.struck.append((index, struck))

    session: Any = Session()
    fields = {"scan": {"views": [{"struck": False}, {"struck": True}, {"struck": False}]}}
    with pytest.raises(ControlRefused) as error:
        _answer(session, said, fields)
    assert f"{refused} is no answer. Type accept, check, scan on or reject, or numbers of views from 1 to 3" in str(
        error.value
    )
    assert session.struck == []
    _answer(session, "1, 2", fields)
    assert session.struck == [(0, True), (1, False)]
    session.struck.clear()
