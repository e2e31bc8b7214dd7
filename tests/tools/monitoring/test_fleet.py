"""What the table of carts says of answers that Prometheus gives; tests/live/test_monitoring.py has the real one."""

import json
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from threading import Thread
from typing import Any
from urllib.parse import parse_qs

import pytest
from click.testing import CliRunner

from probewatch.drivers.errors import ConfigurationError, DeviceLost
from probewatch.tools.cli import probewatch
from probewatch.tools.monitoring.fleet import reports

Answers = dict[str, list[tuple[dict[str, str], str]]]


class Server(HTTPServer):
    """Speaks HTTP as Prometheus does. answers: beginning of a query → series; raw: whatever is asked."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.answers: Answers = {}
        self.raw: tuple[int, bytes] | None = None

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"


class Handler(BaseHTTPRequestHandler):
    server: Server

    def do_POST(self) -> None:
        length = int(self.headers["Content-Length"])
        query = parse_qs(self.rfile.read(length).decode())["query"][0]
        series = next((found for start, found in self.server.answers.items() if query.startswith(start)), [])
        result = [{"metric": labels, "value": [0, value]} for labels, value in series]
        code, body = self.server.raw or (200, json.dumps({"status": "success", "data": {"result": result}}).encode())
        self.send_response(code)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *arguments: Any) -> None:
        pass


@pytest.fixture
def server() -> Iterator[Server]:
    with Server() as server:
        thread = Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def cart(name: str, **labels: str) -> dict[str, str]:
    return {"instance": name, **labels}


def well(**changes: list[tuple[dict[str, str], str]]) -> Answers:
    known: Answers = {
        'up{job="probewatch"}': [(cart("a"), "1")],
        "probewatch_up": [(cart("a"), "1")],
        "probewatch_contact_closed": [(cart("a"), "1")],
        "probewatch_state == 1": [(cart("a", state="monitoring"), "1")],
        "probewatch_verification_age_seconds": [(cart("a"), "2.5")],
        "probewatch_info": [(cart("a", version="0.1.0"), "1")],
        "probewatch_reference_info": [(cart("a", number="3"), "1")],
        "max by (instance, check)": [(cart("a", check="scale-axial"), "0.2"), (cart("a", check="latency"), "0.1")],
        "probewatch_reference_due": [],
    }
    return {query: changes.get(query, series) for query, series in known.items()}


@pytest.mark.parametrize(
    ("query", "series", "needs"),
    [
        ("probewatch_up", [(cart("a"), "1")], ()),
        ('up{job="probewatch"}', [(cart("a"), "0")], ("unreachable",)),
        ("probewatch_up", [(cart("a"), "0")], ("service silent",)),
        ("probewatch_up", [], ("service silent",)),
        ("probewatch_contact_closed", [(cart("a"), "0")], ("unverified",)),
        ("probewatch_contact_closed", [], ("unverified",)),
        ("max by (instance, check)", [(cart("a", check="latency"), "0.71")], ("drifting (latency)",)),
        ("max by (instance, check)", [(cart("a", check="latency"), "0.69")], ()),
        ("probewatch_reference_due", [(cart("a"), "-1")], ("overdue",)),
        ("probewatch_reference_due", [(cart("a"), "1209599")], ("due",)),
        ("probewatch_reference_due", [(cart("a"), "1209601")], ()),
    ],
)
def test_what_a_cart_needs(
    query: str, series: list[tuple[dict[str, str], str]], needs: tuple[str, ...], server: Server
) -> None:
    server.answers = well(**{query: series})
    (report,) = reports(server.url, "probewatch", "30m")
    assert report.needs == needs
    if needs in (("unreachable",), ("service silent",)):
        assert (report.state, report.closed, report.age_s, report.version) == (None,) * 4, "nothing old is told"
    else:
        assert (report.state, report.reference, report.version) == ("monitoring", "3", "0.1.0")


def test_the_table_and_the_json(server: Server) -> None:
    server.answers = well()
    done = CliRunner().invoke(probewatch, ["fleet", "--prometheus", server.url], terminal_width=200)
    assert done.exit_code == 0
    assert "nobody" in done.output
    server.answers['up{job="probewatch"}'] = [(cart("a"), "1"), (cart("b\x1b[2J"), "1")]
    server.answers["probewatch_contact_closed"] = [(cart("a"), "0"), (cart("b\x1b[2J"), "0")]
    done = CliRunner().invoke(probewatch, ["fleet", "--prometheus", server.url, "--json"])
    assert done.exit_code == 1
    names = [one["cart"] for one in json.loads(done.output)]
    assert names == ["a", "b\N{REPLACEMENT CHARACTER}[2J"]


def test_a_cart_has_the_name_that_the_configuration_of_prometheus_gives_it(server: Server) -> None:
    server.answers = well(**{'up{job="probewatch"}': [(cart("a", cart="theatre 2"), "1")]})
    (report,) = reports(server.url, "probewatch", "30m")
    assert (report.cart, report.instance, report.state) == ("theatre 2", "a", "monitoring")


def test_the_carts_of_another_job_are_none(server: Server) -> None:
    """Carts that could not be reached were left out without a word, as only those are known by their job alone."""
    server.answers = well()
    done = CliRunner().invoke(probewatch, ["fleet", "--prometheus", server.url, "--job", "carts"])
    assert done.exit_code == 1
    assert "under job_name: carts?" in done.stderr


def test_no_cart_at_all_is_not_well(server: Server) -> None:
    done = CliRunner().invoke(probewatch, ["fleet", "--prometheus", server.url])
    assert done.exit_code == 1
    assert "knows no cart" in done.stderr


@pytest.mark.parametrize(
    "raw",
    [
        (200, b""),
        (200, b'{"data": {"result": [{"metric": {}, "value": [0, %s]}]}}' % (b"9" * 400)),
        (200, b"<html>"),
        (200, b"[]"),
        (200, b'{"data": {"result": [{"metric": {}, "value": [0]}]}}'),
        (200, b'{"data": {"result": [{"metric": 3, "value": [0, "1"]}]}}'),
        (200, b'{"data": {"result": 3}}'),
        (200, b"[" * 100_000),
        (422, b"{}"),
        (500, b""),
    ],
    ids=range(10),
)
def test_what_is_no_answer_is_refused(raw: tuple[int, bytes], server: Server) -> None:
    server.raw = raw
    with pytest.raises(DeviceLost):
        reports(server.url, "probewatch", "30m")


@pytest.mark.parametrize("url", ["", "localhost:9090", "file:///etc/passwd", "http://[", "http://a:b"])
def test_what_is_no_url_is_refused(url: str) -> None:
    with pytest.raises((ConfigurationError, DeviceLost)):
        reports(url, "probewatch", "30m")


@pytest.mark.parametrize(("option", "value"), [("--over", "30"), ("--over", "1h] or up["), ("--job", 'x"} or up{')])
def test_no_query_can_be_smuggled_in(option: str, value: str) -> None:
    done = CliRunner().invoke(probewatch, ["fleet", option, value])
    assert done.exit_code == 2
