"""One-time tokens: once, not for long, and not by trying."""

from pathlib import Path

import pytest

from probewatch.drivers.errors import ConfigurationError, DeviceLost
from probewatch.tools.commands.page import _how_to_ask, _warn_if_useless
from probewatch.tools.page.token_socket import Door
from probewatch.tools.page.tokens import TOKEN_S, Tokens
from tests.support.answers import answered

HOUR_S = 3600.0


def test_a_token_becomes_a_cookie_once_however_it_is_typed() -> None:
    tokens = Tokens()
    token = tokens.issue("smith", 0.0)
    cookie = tokens.redeem(f" {token.lower().replace('-', ' ')} ", 1.0)
    assert tokens.visitor(cookie, 2.0).name == "smith"
    assert tokens.redeem(token, 3.0) is None
    assert tokens.visitor(None, 2.0) is tokens.visitor("", 2.0) is tokens.visitor("x", 2.0) is None


def test_tokens_and_cookies_end() -> None:
    tokens = Tokens()
    late, early = tokens.issue("a", 0.0), tokens.issue("b", 0.0)
    assert tokens.redeem(late, TOKEN_S + 1) is None
    cookie = tokens.redeem(early, TOKEN_S)
    assert tokens.visitor(cookie, TOKEN_S + 11 * HOUR_S) is not None
    assert tokens.visitor(cookie, TOKEN_S + 13 * HOUR_S) is None


def test_nobody_finds_one_by_trying() -> None:
    tokens = Tokens()
    token = tokens.issue("a", 0.0)
    for _ in range(10):
        assert tokens.redeem("wrong", 1.0) is None
    assert tokens.locked(2.0)
    assert tokens.redeem(token, 2.0) is None, "the right one is not looked at either"
    assert not tokens.locked(62.0)
    assert tokens.redeem(token, 62.0) is not None


def test_who_guesses_locks_no_other_address_out() -> None:
    tokens = Tokens()
    token = tokens.issue("a", 0.0)
    for number in range(200):
        assert tokens.redeem("wrong", 1.0, f"10.0.0.{number // 40}") is None
    assert tokens.locked(2.0, "10.0.0.1")
    assert tokens.redeem(token, 2.0, "10.0.0.9") is not None


def test_many_addresses_guess_no_more_than_is_stated() -> None:
    tokens = Tokens()
    for number in range(100):
        assert not tokens.locked(1.0, f"10.0.0.{number}")
        tokens.redeem("wrong", 1.0, f"10.0.0.{number}")
    assert tokens.locked(2.0, "10.0.1.1")
    assert not tokens.locked(62.0, "10.0.1.1")


def test_many_tokens_push_out_the_oldest() -> None:
    tokens = Tokens()
    issued = [tokens.issue(str(number), 0.0) for number in range(9)]
    assert len({*issued}) == 9
    assert tokens.redeem(issued[0], 1.0) is None
    assert tokens.redeem(issued[1], 1.0) is not None


def test_whoever_starts_a_page_is_told_how_to_get_a_token_of_it(tmp_path: Path) -> None:
    """Without a door, and without the package's, nobody can ask for one: it says so, and what gives one."""
    assert "start it with --door FILE" in _how_to_ask(None)
    assert _how_to_ask(tmp_path / "door") == f"a token: probewatch page --token --door {tmp_path / 'door'}"
    shown = answered("page", "--token", "--door", tmp_path / "door")
    assert shown.returncode == 69
    assert "no page answers (No such file or directory). Start it: " in shown.stderr
    assert f"probewatch page --door {tmp_path / 'door'}" in shown.stderr


def test_where_to_listen_is_no_option_of_asking_a_page_that_runs(tmp_path: Path) -> None:
    """Nobody would see that the token is of the page at another address."""
    asked = answered("page", "--token", "--door", tmp_path / "door", "--listen", "127.0.0.1:1")
    assert asked.returncode == 2
    assert "--listen has no effect with --token" in asked.stderr


def test_a_door_that_another_page_serves_is_told_as_that(tmp_path: Path) -> None:
    """It said that another service runs, and to stop that: the contact would have opened."""
    path = tmp_path / "door"
    with Door(path, "", lambda _: ("", "")), pytest.raises(DeviceLost) as told:
        Door(path, "", lambda _: ("", ""))
    assert (
        str(told.value)
        == f"--door {path}: another page is running here. End that page, or give this one another --door"
    )


def test_a_door_that_cannot_be_made_is_named_by_its_option(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError) as told:
        Door(tmp_path / "gone" / "door", "", lambda _: ("", ""))
    assert told.value.where == f"--door {tmp_path}/gone/door"


@pytest.mark.parametrize(("made", "told"), [(True, False), (False, True)])
def test_a_folder_in_which_no_scan_can_begin_is_told_at_the_start(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], made: bool, told: bool
) -> None:
    """Only whoever began a scan learned of it."""
    folder = tmp_path / "calibrations"
    if made:
        folder.mkdir()
    _warn_if_useless(folder)
    _warn_if_useless(None)
    said = capsys.readouterr().err
    assert (f"--folder {folder}: no scan can begin here: cannot be written" in said) == told
    assert bool(said) == told
