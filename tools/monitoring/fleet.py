"""Reports what each of many carts needs, from its metrics as a Prometheus has them."""

import json
import threading
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterable, Mapping
from concurrent.futures import Future
from dataclasses import asdict, dataclass, field
from http.client import HTTPException, InvalidURL
from typing import Any

from probewatch.drivers.errors import ConfigurationError, DeviceLost, system_words
from probewatch.drivers.printable import printable

_TIMEOUT_S = 10.0
"""Seconds that one whole answer may take: a query about a hundred carts takes ms, one that hangs or sends byte by byte
never answers."""
_MOST_BYTES = 16_000_000
"""Bytes of one answer. A cart takes about 2 kB of it; what is larger is not an answer to this query."""
DRIFTING = 0.7
"""Share of a limit, as the rule ProbewatchDrifting has it: nearer is reported while there is time to look at the
clamp."""
_WELL_KNOWN = 0.15
"""Sigma of the value, as a share of the limit, from which its mean shows nothing of a drift; the same rule has it."""
DUE_SOON_S = 14 * 86400.0
"""Seconds, two weeks: time enough to find a day for a periodic check, as the rule ProbewatchReferenceDue has it."""

_DRIFT = (
    "max by (instance, check) ("
    'avg_over_time(probewatch_check_ratio{{check=~"latency|(rotation|scale|offset)-.+"}}[{0}]) '
    f"and avg_over_time(probewatch_check_sigma_ratio[{{0}}]) < {_WELL_KNOWN})"
)
_REACHED = "reached"
"""Name of the first query, which alone knows the carts that cannot be reached: it decides which carts there are."""
_QUERIES = {
    _REACHED: 'up{{job="{1}"}}',
    "up": "probewatch_up",
    "closed": "probewatch_contact_closed",
    "state": "probewatch_state == 1",
    "age": "probewatch_verification_age_seconds",
    "due": "probewatch_reference_due_timestamp_seconds - time()",
    "version": "probewatch_info",
    "reference": "probewatch_reference_info",
    "drift": _DRIFT,
}


@dataclass(frozen=True, slots=True)
class CartReport:
    """Reports on one cart. needs: what somebody should look at, worst first; empty where all is well.

    instance: where Prometheus scrapes it. cart: the label of that name in its configuration, else the instance. state:
    None where it is not known. closed: whether the contact is, None where it is not known. age_s: that of the
    verification. drift: largest mean share of a limit; drifting: the check that has it. due_s: seconds until the
    calibration is due, negative when that is over. reference: its number.
    """

    cart: str
    instance: str
    needs: tuple[str, ...] = ()
    state: str | None = None
    closed: bool | None = None
    age_s: float | None = None
    drift: float | None = None
    drifting: str | None = None
    due_s: float | None = None
    version: str | None = None
    reference: str | None = None

    def fields(self) -> dict[str, Any]:
        """Returns the fields for JSON."""
        return {**asdict(self), "needs": list(self.needs)}


@dataclass(slots=True)
class _Seen:
    """Holds what was seen of one cart: (labels, value) under the names of _QUERIES."""

    said: dict[str, list[tuple[Mapping[str, str], float]]] = field(default_factory=dict)

    def value(self, name: str) -> float | None:
        return self.said[name][0][1] if self.said.get(name) else None

    def label(self, name: str, label: str) -> str | None:
        return self.said[name][0][0].get(label) if self.said.get(name) else None


def reports(base: str, job: str, over: str) -> list[CartReport]:
    """Returns all carts that this Prometheus scrapes, by name. base: its URL. job: under which it does. over: span of
    the drift.

    Raises ConfigurationError for an invalid URL, DeviceLost where no Prometheus answers.
    """
    carts: dict[str, _Seen] = {}
    for name, query in _QUERIES.items():
        for labels, value in _asked(base, query.format(over, job)):
            instance = printable(labels.get("instance", "?"))
            if name == _REACHED:
                carts.setdefault(instance, _Seen())
            if instance in carts:
                carts[instance].said.setdefault(name, []).append((labels, value))
    return sorted(
        (_report(instance, seen) for instance, seen in carts.items()), key=lambda one: (one.cart, one.instance)
    )


def _report(instance: str, seen: _Seen) -> CartReport:
    name = _shown(seen.label(_REACHED, "cart")) or instance
    if seen.value(_REACHED) == 0:
        return CartReport(name, instance, needs=("unreachable",))
    if seen.value("up") != 1:
        return CartReport(name, instance, needs=("service silent",))
    drifts = [(value, labels.get("check", "")) for labels, value in seen.said.get("drift", [])]
    drift, drifting = max(drifts, default=(None, None))
    report = CartReport(
        name,
        instance,
        state=_shown(seen.label("state", "state")),
        closed=seen.value("closed") == 1,
        age_s=seen.value("age"),
        drift=drift,
        drifting=_shown(drifting),
        due_s=seen.value("due"),
        version=_shown(seen.label("version", "version")),
        reference=_shown(seen.label("reference", "number")),
    )
    return CartReport(**{**report.fields(), "needs": tuple(_needs(report))})


def _shown(text: str | None) -> str | None:
    return None if text is None else printable(text)


def _needs(cart: CartReport) -> Iterable[str]:
    if not cart.closed:
        yield "unverified"
    if cart.drift is not None and cart.drift > DRIFTING:
        yield f"drifting ({cart.drifting})"
    if cart.due_s is not None and cart.due_s < DUE_SOON_S:
        yield "overdue" if cart.due_s < 0 else "due"


def _asked(base: str, query: str) -> list[tuple[Mapping[str, str], float]]:
    """Returns (labels, value) of each series of an instant query."""
    url = f"{base.rstrip('/')}/api/v1/query"
    body = urllib.parse.urlencode({"query": query}).encode()
    try:
        if urllib.parse.urlsplit(base).scheme not in ("http", "https"):
            raise ValueError("it begins with neither http:// nor https://")
        content = _answer(urllib.request.Request(url, body))
    except urllib.error.HTTPError as error:
        raise _lost(base, f"Prometheus refused the question ({error.code} {error.reason})") from None
    except (ValueError, InvalidURL) as error:
        raise ConfigurationError(f"is not a URL: {error}", base, "Such as http://127.0.0.1:9090") from None
    except (OSError, HTTPException) as error:
        raise _lost(base, f"no Prometheus answers ({system_words(getattr(error, 'reason', error))})") from None
    return _series(base, content)


def _answer(question: urllib.request.Request) -> bytes:
    """Asks in a thread that is left behind where it hangs: urllib's own timeout starts again with every byte, and the
    name lookup has none. Raises OSError, HTTPException, ValueError.
    """
    answer: Future[bytes] = Future()
    threading.Thread(target=_ask, args=(question, answer), name="question", daemon=True).start()
    try:
        return answer.result(_TIMEOUT_S)
    except TimeoutError:
        raise TimeoutError(f"not whole within {_TIMEOUT_S:g} s") from None


def _ask(question: urllib.request.Request, answer: "Future[bytes]") -> None:
    try:
        with urllib.request.urlopen(question, timeout=_TIMEOUT_S) as reply:
            answer.set_result(reply.read(_MOST_BYTES + 1))
    except Exception as error:
        if isinstance(error, urllib.error.HTTPError):
            error.close()
        answer.set_exception(error)


def _series(base: str, content: bytes) -> list[tuple[Mapping[str, str], float]]:
    """Returns (labels, value) of each series of an answer. Raises DeviceLost for what is not an answer."""
    try:
        if len(content) > _MOST_BYTES:
            raise ValueError("it is too long")
        found = json.loads(content)["data"]["result"]
        return [({str(k): str(v) for k, v in one["metric"].items()}, float(one["value"][1])) for one in found]
    except (ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError, OverflowError) as error:
        raise _lost(base, f"what answers is not Prometheus ({error})") from None


def _lost(base: str, what: str) -> DeviceLost:
    return DeviceLost(what, base, "Check the URL with: curl URL/api/v1/query?query=probewatch_up")
