"""`probewatch reload`, which `systemctl reload` runs: the service's own answer becomes its exit code."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from probewatch.appliance.service.control.server import ControlRefused, Peer
from tests.support.answering import Answers
from tests.support.answers import answered

UNIT = Path(__file__).parents[3] / "systemd" / "probewatch.service"


class Service(Answers):
    """Serves the socket and nothing else."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.refusal = ""
        self.asked: list[str] = []

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        self.asked.append(do)
        if self.refusal:
            raise ControlRefused(self.refusal)
        return {}


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    with Service(tmp_path / "control") as service:
        yield service


def reload(socket: Path) -> tuple[int, str]:
    answer = answered("reload", "--socket", socket)
    return answer.returncode, answer.stdout + answer.stderr


def test_a_changed_configuration_is_taken(service: Service) -> None:
    assert reload(service.path) == (0, "the service has taken its configuration\n")
    assert service.asked == ["reload"]


def test_a_refusal_is_a_failure_in_the_words_of_the_service(service: Service) -> None:
    service.refusal = "[video] cannot change while it runs: systemctl restart probewatch"
    assert reload(service.path) == (75, f"probewatch: {service.refusal}\n")


def test_without_a_service_nothing_was_reloaded(tmp_path: Path) -> None:
    code, said = reload(tmp_path / "control")
    assert (code, str(tmp_path / "control") in said) == (69, True), said


def test_its_help_names_every_exit_code_that_it_ends_with(tmp_path: Path) -> None:
    """It ended with 78 and did not list it."""
    broken = tmp_path / "cart.toml"
    broken.write_text("[control\n")
    assert answered("reload", "--config", broken).returncode == 78
    told = answered("reload", "--help").stdout
    assert [code for code in ("0:", "69:", "75:", "78:") if code not in told] == []


def test_the_unit_reloads_by_it() -> None:
    assert "ExecReload=/usr/bin/env probewatch reload\n" in UNIT.read_text()
