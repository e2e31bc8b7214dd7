"""One way to name a cart: --config, else PROBEWATCH_CONFIG; sockets and folders follow, and older options go before."""

from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from probewatch.appliance.configuration.config import Control
from probewatch.appliance.service.control.starting import how_to_end, how_to_restart, how_to_start
from probewatch.tools.shared.named_cart import CONFIG, ENVIRONMENT, SOCKET, folder_argument, socket_option
from tests.support.answering import Answering
from tests.support.answers import answered
from tests.support.commands import commands

ABOUT_NO_CART = {"demo", "devices", "export", "fleet", "latency", "probe", "simulate", "study"}
"""Commands that need no cart, or several."""
ASKED_FOR_ALONE = {"noise", "replay"}
"""What they judge by is told in the report, and no variable of the environment changes it unseen."""


@click.command()
@socket_option
def asks(control_socket: Path) -> None:
    click.echo(control_socket)


@click.command()
@folder_argument
def reads(folder: Path) -> None:
    click.echo(folder)


@pytest.fixture
def cart(tmp_path: Path) -> Path:
    """Its socket and folder are told by lines without a mistake; others have one."""
    file = tmp_path / "cart.toml"
    file.write_text('[control]\nsocket = "/run/second/control"\n[alarm]\nfolder = "alarms"\nlangage = "de"\n')
    return file


@pytest.mark.parametrize("by", ["--config", ENVIRONMENT])
def test_the_configuration_names_socket_and_folder(cart: Path, by: str) -> None:
    given = {"args": [by, str(cart)]} if by == "--config" else {"env": {ENVIRONMENT: str(cart)}}
    assert CliRunner().invoke(asks, **given).output == "/run/second/control\n"
    assert CliRunner().invoke(reads, **given).output == f"{cart.parent / 'alarms'}\n"


def test_an_option_goes_before_the_configuration_and_that_before_the_environment(cart: Path) -> None:
    other = cart.with_name("other.toml")
    other.write_text("")
    named = {ENVIRONMENT: str(cart)}
    assert CliRunner().invoke(asks, ["--socket", "/x"], env=named).output == "/x\n"
    assert CliRunner().invoke(reads, ["/y"], env=named).output == "/y\n"
    assert CliRunner().invoke(asks, ["--config", str(other)], env=named).output == "/run/probewatch/control\n"


def test_a_configuration_that_is_typed_and_not_there_is_told_also_beside_an_option(tmp_path: Path) -> None:
    """An option goes before it, and a slip is none the less one."""
    absent = ["--config", str(tmp_path / "nosuch.toml")]
    for command, more in ((reads, [str(tmp_path)]), (asks, ["--socket", "/x"])):
        error = CliRunner().invoke(command, [*absent, *more]).exception
        assert "nosuch.toml: cannot be read: No such file or directory. Name the cart's configuration" in str(error)
    assert CliRunner().invoke(asks, ["--socket", "/x"], env={ENVIRONMENT: absent[1]}).output == "/x\n"


@pytest.mark.parametrize("content", [None, "= 3"])
def test_a_configuration_that_was_named_and_cannot_be_read_is_told(tmp_path: Path, content: str | None) -> None:
    file = tmp_path / "cart.toml"
    if content is not None:
        file.write_text(content)
    error = CliRunner().invoke(asks, ["--config", str(file)]).exception
    assert str(file) in str(error)
    assert "cannot be read" in str(error)


def test_every_command_that_is_about_a_cart_takes_it_in_the_same_way() -> None:
    lacking = set()
    for path, command in commands():
        if path[0] in ABOUT_NO_CART | ASKED_FOR_ALONE or isinstance(command, click.Group):
            continue
        options = {option for one in command.params for option in one.opts}
        of_the_cart = options & {"--socket", "--folder", "folder", "--feed"} or path[0] in ("run", "check")
        named = next((one for one in command.params if "--config" in one.opts), None)
        if of_the_cart and (named is None or named.envvar != ENVIRONMENT):
            lacking.add(" ".join(path))
    assert lacking == set()


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The configuration of this computer, whose socket, feed and alarm log lie where no default has them."""
    template = Path(__file__).parents[3] / "config" / "probewatch.toml"
    lines = template.read_text().replace('# socket = "/run/probewatch/control"', f'socket = "{tmp_path / "control"}"')
    file = tmp_path / "own.toml"
    file.write_text(lines.replace('# folder = "/var/lib/probewatch"\n', 'folder = "alarms"\n'))
    monkeypatch.setattr("probewatch.tools.shared.named_cart.CONFIG", file)
    return file


def test_where_no_cart_is_named_a_self_test_is_kept_in_the_alarm_folder_of_this_computer(own: Path) -> None:
    """There the report looks for it."""
    with Answering(own.with_name("control")):
        answer = answered("self-test", "--yes", "--lamps", "skip")
    assert f"kept: {own.parent}/alarms/self-tests/" in answer.stdout, answer


def test_a_self_test_asks_the_socket_that_is_typed_beside_a_configuration(own: Path, tmp_path: Path) -> None:
    answer = answered("self-test", "--yes", "--config", own, "--socket", tmp_path / "other")
    assert (answer.returncode, str(tmp_path / "other") in answer.stderr) == (69, True), answer


def test_a_live_scan_where_no_cart_is_named_is_of_this_computer(own: Path) -> None:
    answer = answered("recalibrate", "--live", "--made-by", "A. Smith", "--probe", "L12", "--preset", "4 cm")
    assert (answer.returncode, str(own.with_name("control")) in answer.stderr) == (69, True), answer


def test_a_page_where_no_cart_is_named_is_of_this_computer(own: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    served = []
    monkeypatch.setattr("probewatch.tools.commands.page._serve", lambda page, _: served.append(page))
    monkeypatch.setattr("probewatch.tools.commands.page.AlarmLogWatch", served.append)
    assert answered("page", "--listen", "127.0.0.1:0").returncode == 0
    assert served[0] == own.parent / "alarms"


@pytest.mark.parametrize(
    "command",
    [
        ["status"],
        ["ack"],
        ["calibration", "recover", "--output", "new.toml"],
        ["recalibrate", "--live", "--made-by", "A. Smith", "--probe", "L12", "--preset", "4 cm"],
    ],
)
def test_where_no_service_answers_the_command_says_how_that_of_the_named_cart_is_started(
    own: Path, command: list[str]
) -> None:
    """The unit's `systemctl start` would start another cart's."""
    answer = answered(*command, "--config", own)
    assert f"Start it: probewatch run --config {own}" in answer.stderr, answer
    assert "systemctl" not in answer.stderr
    other = answered("status", "--config", own, "--socket", own.with_name("other")).stderr
    assert "Start it: probewatch run --config FILE, with the FILE whose [control] socket this is" in other


def test_of_the_units_cart_the_command_names_the_unit() -> None:
    """Where this computer has a configuration with another socket, too."""
    unit = "Start it: systemctl start probewatch; if it ends again, journalctl -u probewatch says why"
    assert how_to_start(SOCKET) == how_to_start(Path("/elsewhere"), CONFIG) == unit
    assert how_to_restart(CONFIG, is_running=True) == "systemctl restart probewatch"
    assert how_to_end(SOCKET) == "systemctl stop probewatch"


def test_the_usual_socket_is_that_of_a_configuration_that_names_none() -> None:
    assert Control().socket == SOCKET
