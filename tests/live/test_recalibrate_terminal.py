"""Every step of `probewatch recalibrate --live` that a person takes at a terminal, on a real pseudo-terminal."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.demo_cart import Cart
from tests.support.live_scan import RecalibratingService, Scan
from tests.support.person import Person
from tests.support.polling import until
from tests.tools.recalibration.test_session import truth, wires

ASKED = ["--probe", "L12-5", "--preset", "4 cm", "--made-by", "A. Smith"]
REVIEW = "numbers of views to strike out or take back:"
ZETA = re.compile(r"ζ (-?[\d.]+) ± ([\d.]+) mm")


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
    ("why is there no check at another point:", "the tank stands in a frame"),
    ("name of the second person:", "B. Jones"),
    ("role:", "engineer"),
    ("comment", "good"),
)


def test_a_scan_with_everything_a_person_may_do_on_the_way(cart: Cart, tmp_path: Path) -> None:
    """Latency left out, ended too early, scanned on, a view struck out and taken back, checked, rejected."""
    cart.wait_for("monitoring", 60)
    before = cart.status()["reference"]["sha256"]
    cart.tank.touch()
    with Person(
        "recalibrate", "--live", "--config", cart.config, "--folder", tmp_path, "--latency-first", *ASKED
    ) as person:
        person.sees("'skip' leaves it to the scan")
        cart.wait_for("recalibrating", 30)
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
        answered(person, *SIGNATURE)
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
        person.sees("there is no view 99")
        person.sees(REVIEW)
        person.types("what?")
        person.sees("there is no view 0")
        person.sees(REVIEW)
        person.types("check")
        person.sees("Move the tank by 2 cm and more")
        person.sees("passages through the other crossing")
        person.types("")
        assert "check at another point" in person.sees(REVIEW)
        person.types("reject")
        person.sees("rejected: in the terminal")
        assert person.ends() == 75
    cart.tank.unlink()
    cart.wait_for("monitoring", 60)
    assert cart.status()["reference"]["sha256"] == before
    assert list(tmp_path.glob("*.toml")) == []


@pytest.mark.parametrize("how", ["interrupts", "hangs up"])
def test_who_goes_away_from_the_review_leaves_the_calibration_before(cart: Cart, tmp_path: Path, how: str) -> None:
    cart.wait_for("monitoring", 60)
    before = cart.status()["reference"]["sha256"]
    cart.tank.touch()
    with Person("recalibrate", "--live", "--config", cart.config, "--folder", tmp_path, *ASKED) as person:
        person.sees("1 views in", 120)
        person.types("")
        person.sees(REVIEW)
        assert cart.contact() is False
        if how == "interrupts":
            person.interrupts()
            assert person.ends() == 130
        else:
            person.process.kill()
    cart.tank.unlink()
    cart.wait_for("monitoring", 60)
    assert cart.status()["reference"]["sha256"] == before
    assert cart.status()["recalibration"] is None, "nothing waits any more"


@pytest.fixture
def service(tmp_path: Path) -> Iterator[RecalibratingService]:
    """One that finds the new calibration far from the one in force."""
    with RecalibratingService(tmp_path, truth()) as service:
        service.proposal["confirm"] = True
        yield service


def test_a_difference_is_stated_and_nothing_is_taken_before_it_is_accepted(
    service: RecalibratingService, tmp_path: Path
) -> None:
    with (
        Scan(service, wires(700)),
        Person("recalibrate", "--live", "--socket", service.path, "--folder", tmp_path, *ASKED) as person,
    ):
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
