"""The dates of a calibration in service: what has expired stays expired until there is a new calibration."""

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from probewatch.appliance.service.control import references
from tests.appliance.service.test_daemon import MovedLine, calibration, moved
from tests.support.answers import answered
from tests.support.simulated_cart import SimulatedCart

EXPIRES = 'calibration.due_days = 30\ncalibration.overdue = "expires"\n'


@pytest.fixture
def cart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SimulatedCart:
    """Its calibration may be used for 30 days; the history has the cart's calendar."""
    cart = SimulatedCart(tmp_path, more=EXPIRES)

    def now() -> str:
        return datetime.fromtimestamp(cart._wall_ns() / 1e9, UTC).isoformat(timespec="seconds")

    monkeypatch.setattr(references, "_now", now)
    return cart


@pytest.fixture
def expired(cart: SimulatedCart) -> Iterator[SimulatedCart]:
    """Its calibration was verified 40 days ago."""
    with cart:
        cart.monitoring()
        cart.utc += timedelta(days=40)
        cart.run(3)
        assert cart.contact() is False
        yield cart


def expect_expired(cart: SimulatedCart, origin: str) -> None:
    cart.say(None)
    cart.run(15)
    status = cart.status()
    assert status["reference"]["origin"] == origin
    assert status["reference_overdue"]
    assert cart.contact() is False


def give_another(cart: SimulatedCart, file: Path) -> None:
    """It is near, and motion contradicts it."""
    with cart.client() as client:
        client.begin_recalibration()
        cart.say("offset")
        client.end_recalibration(moved(cart, file, 1))


def test_it_stays_expired_when_a_person_gives_another_one_up(expired: SimulatedCart, tmp_path: Path) -> None:
    give_another(expired, tmp_path / "new.toml")
    with expired.client() as client:
        client.abort_recalibration()
    expect_expired(expired, "went back to 1")


def test_it_stays_expired_when_the_service_goes_back_to_it_by_itself(expired: SimulatedCart, tmp_path: Path) -> None:
    """A device is lost while the other one is to be verified."""
    expired.tracker.plugged = False
    give_another(expired, tmp_path / "new.toml")
    expired.wait_for("device lost")
    expired.tracker.plugged = True
    expect_expired(expired, "went back to 1")


@pytest.mark.parametrize(("words", "origin"), [(["back", 1], "went back to 1"), (["use"], "file of reference 1")])
def test_it_stays_expired_when_a_person_takes_the_same_file_again(
    expired: SimulatedCart, words: list[str | int], origin: str
) -> None:
    """The refusal names the remedy, and another file still comes in force."""
    file = expired.folder / "probe.toml"
    used = calibration(expired, *words, *([file] if words == ["use"] else []), "--yes", "--wait", 3)
    assert used.returncode == 75
    assert "expired" in used.stderr or "due since" in used.stderr, used.stderr
    expect_expired(expired, origin)
    with expired.client() as client:
        client.begin_recalibration()
        client.end_recalibration(moved(expired, expired.folder / "new.toml", 1))
    assert expired.monitoring().status()["reference_overdue"] is None


@pytest.mark.parametrize("remedy", ["changed file", "reset"])
def test_a_first_use_under_a_clock_that_was_behind_names_what_ends_it(cart: SimulatedCart, remedy: str) -> None:
    """Status and refusal said since when it was due, and each way that they led to left it so."""
    right, file = cart.utc, cart.folder / "probe.toml"
    cart.utc = datetime(1970, 1, 1, tzinfo=UTC)
    with cart:
        cart.monitoring()
        cart.utc = right
        cart.run(3)
        words = (
            "it is due since 1970-01-31 00:00 UTC; it counts from 1970-01-01, when its file was first used; "
            "if the clock was wrong then: use a changed file, or probewatch calibration reset"
        )
        assert cart.status()["reference_overdue"] == words
        assert words in calibration(cart, "use", file, "--yes", "--wait", 3).stderr
        if remedy == "reset":
            cart.end_daemon()
            reset = answered("calibration", "reset", "--folder", cart.alarms, "--socket", cart.socket, "--yes")
            assert reset.returncode == 0, reset.stderr
            cart.start_daemon()
        else:
            file.write_text(f"{file.read_text()}# checked\n")
            assert calibration(cart, "use", file, "--yes").returncode == 0
        assert cart.monitoring().status()["reference_overdue"] is None


@pytest.mark.parametrize("step", [timedelta(days=40), timedelta(days=-40)])
def test_after_a_wrong_clock_was_put_right_only_new_motion_verifies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: timedelta
) -> None:
    """The probe rests meanwhile: what was shown before the date had passed closed the contact."""
    with SimulatedCart(tmp_path, MovedLine, more=EXPIRES) as cart:
        cart.monitoring()
        monkeypatch.setattr(MovedLine, "moving", False)
        cart.run(5)
        stepped_s = cart.now_s()
        cart.utc += step
        cart.run(10)
        assert cart.contact(stepped_s) is False
        cart.utc -= step
        cart.run(5)
        assert [closed for _, closed in cart.switched(stepped_s)] == [False]
        assert cart.status()["reference_overdue"] is None
        monkeypatch.setattr(MovedLine, "moving", True)
        cart.monitoring()
