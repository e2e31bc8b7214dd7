"""The page's own server, as a process, before a service that answers, and one that does not."""

import http.client
import json
import socket
import stat
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

from probewatch.drivers.errors import DeviceLost
from probewatch.tools.commands.metrics import command as metrics_command
from probewatch.tools.commands.page import _called
from probewatch.tools.commands.page import command as page_command
from probewatch.tools.page.connection import MOST_LISTENERS
from probewatch.tools.page.token_socket import invitation
from probewatch.tools.shared.called_host import called
from tests.support.answering import Answering
from tests.support.polling import until
from tests.support.web_page import WebPage
from tests.tools.page.test_german import says_german


@pytest.fixture(scope="module")
def answering(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Answering]:
    with Answering(tmp_path_factory.mktemp("cart") / "control") as answering:
        yield answering


@pytest.fixture(scope="module")
def web(answering: Answering, tmp_path_factory: pytest.TempPathFactory) -> Iterator[WebPage]:
    with WebPage(tmp_path_factory.mktemp("page"), answering.path) as web:
        yield web


class Answer:
    def __init__(self, link: http.client.HTTPConnection) -> None:
        response = link.getresponse()
        self.status, self.headers, self.body = response.status, response.headers, response.read()

    @property
    def json(self) -> Any:
        return json.loads(self.body)


def asked(web: WebPage, method: str, path: str, body: object = None, **headers: str) -> Answer:
    link = http.client.HTTPConnection(web.address, timeout=10)
    try:
        usual = {"Host": web.address} | ({"Origin": f"http://{web.address}"} if method == "POST" else {})
        data = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
        link.request(method, path, data, usual | headers)
        return Answer(link)
    finally:
        link.close()


def redeemed_key(web: WebPage) -> dict[str, str]:
    """Headers of a browser that has redeemed a one-time token."""
    cookie = asked(web, "POST", "/token", {"token": web.token()}).headers["set-cookie"]
    return {"Cookie": cookie.partition(";")[0]}


def event(web: WebPage, **headers: str) -> dict[str, Any]:
    """The first that a browser is told."""
    link = http.client.HTTPConnection(web.address, timeout=10)
    try:
        link.request("GET", "/events", headers=headers)
        response = link.getresponse()
        assert response.headers["content-type"].startswith("text/event-stream")
        line = response.readline()
        response.close()
        assert line.startswith(b"data: ")
        return dict(json.loads(line.removeprefix(b"data: ")))
    finally:
        link.close()


def test_the_page_is_its_own_files_and_may_run_nothing_else(web: WebPage) -> None:
    for path in (
        "/",
        "/recalibrate",
        "/files/page.css",
        "/files/common.js",
        "/files/recalibrate.js",
        "/files/icon.svg",
    ):
        answer = asked(web, "GET", path)
        assert answer.status == 200, path
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert answer.headers["x-content-type-options"] == "nosniff"
        text = answer.body.decode()
        assert "<script>" not in text
        assert "style=" not in text
        foreign = [word for word in text.split() if "http://" in word or "https://" in word]
        assert all("www.w3.org" in word for word in foreign), f"{path} loads from elsewhere: {foreign}"


@pytest.mark.parametrize("path", ["/", "/recalibrate"])
def test_the_page_names_the_door_of_its_own_at_which_a_token_is_asked_for(web: WebPage, path: str) -> None:
    """It named the package's, whose page is another, or none."""
    command = f"probewatch page --token --door {web.door}"
    assert f"<code>{command}</code>" in asked(web, "GET", path).body.decode()
    wanted = asked(web, "POST", "/request/acknowledge", {}).json["error"]
    wrong = asked(web, "POST", "/token", {"token": "x"}).json["error"]
    assert wanted == f"a token is needed: {command} gives one"
    assert wrong == f"the token is wrong, was used, or is too old: {command} gives another"
    assert all(says_german(text) for text in (wanted, wrong))


@pytest.mark.parametrize(
    "path",
    ["/files/", "/files/server.py", "/files/..%2fserver.py", "/nothing", "/view/3", "/%00", f"/view/{'9' * 4400}"],
)
def test_there_is_nothing_else(web: WebPage, path: str) -> None:
    assert asked(web, "GET", path).status == 404


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 403),
        ({"Host": "evil.example"}, 403),
        ({"Host": "evil.example", "Origin": "http://evil.example"}, 403),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
    ],
)
def test_no_other_page_may_ask(web: WebPage, headers: dict[str, str], status: int) -> None:
    """The first has no cookie; the others no right to be heard."""
    for path, body in (("/recalibration/begin", {"probe": "p"}), ("/token", {"token": "x"})):
        answer = asked(web, "POST", path, body, **headers)
        assert (answer.status, answer.json["ok"]) == (status, False)


def test_a_proxy_that_sends_another_name_is_told_which(web: WebPage) -> None:
    answer = asked(web, "GET", "/", Host="backend:9780")
    assert (answer.status, "Host backend:9780; --host" in answer.json["error"]) == (403, True)


def test_a_page_of_no_origin_may_not_ask(web: WebPage) -> None:
    link = http.client.HTTPConnection(web.address, timeout=10)
    link.request("POST", "/token", b'{"token": "x"}', {"Host": web.address})
    answer = Answer(link)
    assert (answer.status, "Origin none, Host 127" in answer.json["error"]) == (403, True)
    link.close()


@pytest.mark.parametrize(
    ("host", "origin", "own"),
    [
        ("localhost", "http://localhost:80", True),
        ("localhost:443", "https://localhost", True),
        ("localhost:8443", "https://LOCALHOST:8443", True),
        ("localhost", "https://localhost:8443", False),
        ("localhost:443", "http://localhost", False),
        ("localhost", "null", False),
        ("localhost", "https://", False),
        ("localhost", "localhost", False),
    ],
)
def test_behind_a_proxy_the_name_must_be_the_browsers(web: WebPage, host: str, origin: str, own: bool) -> None:
    """As nginx passes it on with $http_host; what was compared is said, as with $host, which loses the port."""
    said = asked(web, "POST", "/token", {"token": "x"}, Host=host, Origin=origin).json["error"]
    assert ("the token is wrong" in said) is own, said
    assert (f"Origin {origin}, Host {host}; a proxy must pass on Host" in said) is not own, said
    assert ("proxy_set_header Host $http_host" in said) is not own, said


@pytest.mark.parametrize("host", ["evil.example", "[::1]evil.example", "[::1]:80x", "localhost:80:x", "::1", "", "[]"])
def test_the_page_answers_to_its_own_names_alone(web: WebPage, host: str) -> None:
    assert asked(web, "GET", "/", Host=host).status == 403


@pytest.mark.parametrize("host", ["[::1]", "[::1]:9780", "LOCALHOST", "127.0.0.1:1"])
def test_by_those_it_answers(web: WebPage, host: str) -> None:
    assert asked(web, "GET", "/", Host=host).status == 200


@pytest.mark.parametrize("listen", ["Cart", "CART.ward.local", "127.0.0.1"])
def test_a_name_that_it_listens_on_is_its_own_however_it_is_written(listen: str) -> None:
    names = _called(listen, ("Ward",))
    assert {called(f"{listen}:9780"), called(listen.upper()), "ward"} <= names


def test_no_other_site_is_given_its_pictures(web: WebPage) -> None:
    for path in ("/picture", "/view/3", "/"):
        assert asked(web, "GET", path).headers["cross-origin-resource-policy"] == "same-origin"


def test_as_many_browsers_as_there_are_places_are_told_events_and_no_more(web: WebPage) -> None:
    """All ask at once; before them some who have gone before they are told anything."""
    for link in [_asking_for_events(web) for _ in range(20)]:
        link.close()
    told: list[int] = []

    def told_of(count: int) -> int:
        links = [_asking_for_events(web) for _ in range(count)]
        told.append(sum(link.recv(12) == b"HTTP/1.1 200" for link in links))
        for link in links:
            link.close()
        return told[-1]

    until(lambda: told_of(40) >= MOST_LISTENERS, 20, 0.1, lambda: told)
    assert max(told) == MOST_LISTENERS
    until(lambda: told_of(4) == 4, 20, 0.1, lambda: f"places are lost: {told}")


def test_browsers_of_one_address_keep_no_other_from_the_events(web: WebPage) -> None:
    with ExitStack() as crowd:
        told = 0
        while told < MOST_LISTENERS:  # those of the test before may not have gone yet
            told += crowd.enter_context(_asking_for_events(web)).recv(12) == b"HTTP/1.1 200"
        with _asking_for_events(web, "127.0.0.2") as other:
            assert other.recv(12) == b"HTTP/1.1 200"


def _asking_for_events(web: WebPage, source: str = "127.0.0.1") -> socket.socket:
    host, port = web.address.split(":")
    link = socket.create_connection((host, int(port)), 10, (source, 0))
    link.sendall(f"GET /events HTTP/1.1\r\nHost: {web.address}\r\n\r\n".encode())
    return link


def test_everybody_is_told_the_status_and_who_he_is(web: WebPage) -> None:
    told = until(lambda: (one := event(web))["status"] and one)
    assert told["status"]["state"] == "monitoring"
    assert told["visitor"] is None
    assert told["recalibration"]["phase"] == "idle"
    assert "entries" in told["alarms"]


def test_a_token_opens_what_changes_something_and_a_refusal_is_told(web: WebPage, answering: Answering) -> None:
    token, url = invitation(web.door)
    assert url == f"http://{web.address}/"
    assert asked(web, "POST", "/token", {"token": "AAAA-AAAA"}).status == 403
    cookie = asked(web, "POST", "/token", {"token": token}).headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "samesite=strict" in cookie.lower()
    key = {"Cookie": cookie.partition(";")[0]}
    assert event(web, **key)["visitor"] is not None
    begin = {"probe": "p", "preset": "d", "technician": "t", "wanted": "whole"}
    answer = asked(web, "POST", "/recalibration/begin", begin, **key)
    assert answer.status == 409
    assert "only the status is answered here" in answer.json["error"]
    assert answering.asked["begin-recalibration"]
    for body, status in (
        (b"", 409),
        (b"[", 400),
        (b"[]", 400),
        (b"\xff", 400),
        (b"{" * 9000, 413),
        ({"probe": 1}, 409),
        ({"probe": " ", "preset": "d", "technician": "t"}, 409),
    ):
        assert asked(web, "POST", "/recalibration/begin", body, **key).status == status
    assert asked(web, "POST", "/recalibration/strike", {"index": "x"}, **key).status == 409
    for act, field in (("begin", "water_c"), ("correct", "column"), ("check", "point")):
        large = [10**400] * 3 if field == "point" else 10**400
        assert asked(web, "POST", f"/recalibration/{act}", {**begin, field: large}, **key).status == 409, act
    assert asked(web, "POST", "/recalibration/nothing", {}, **key).status == 404
    assert asked(web, "POST", "/recalibration/begin", begin, Cookie="probewatch=guessed").status == 403


def test_without_pictures_there_is_none_and_it_is_said_in_time(web: WebPage) -> None:
    assert asked(web, "GET", "/picture?after=x").status == 204


def test_a_service_that_says_nothing_is_told_as_silent(web: WebPage, answering: Answering) -> None:
    answering.mute = True
    try:
        told = until(lambda: (one := event(web))["status"] is None and one, 20)
        assert told["silence"]
    finally:
        answering.mute = False
    until(lambda: event(web)["status"])


def test_the_door_is_for_the_group_and_one_that_is_not_there_is_told(web: WebPage, tmp_path: Path) -> None:
    assert stat.S_IMODE(web.door.stat().st_mode) == 0o660
    with pytest.raises(DeviceLost, match="no page answers"):
        invitation(tmp_path / "door")


@pytest.mark.parametrize("command", [page_command, metrics_command])
@pytest.mark.parametrize("typed", ["https://cart.example/", "", "cart 2", "cart:9780", "cart.example/page"])
def test_what_no_browser_can_send_is_no_host(command: click.Command, typed: str) -> None:
    """It was taken, and whoever came by that name got 403."""
    said = CliRunner().invoke(command, ["--host", typed])
    assert said.exit_code == 2
    assert f"'{typed}' is not a host name" in said.output
