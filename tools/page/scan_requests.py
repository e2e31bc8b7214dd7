"""Maps the requests of the page for a recalibration: their names, and what each takes from a body."""

from collections.abc import Callable
from typing import Any

from probewatch.tools.page.request_body import number, text, whole
from probewatch.tools.recalibration.paperwork import Begin, Signature
from probewatch.tools.recalibration.session import ScanSession


def _begin(body: dict[str, Any]) -> Begin:
    """Returns what a recalibration begins with. A field that is left out is unknown, or has its usual value; one that
    is not a number is refused with the rest.
    """
    probe, preset, technician, reason, wanted = (
        text(body, name) for name in ("probe", "preset", "technician", "reason", "wanted")
    )
    numbers = [field for field in ("water_c", "scanner_m_s") if body.get(field) is not None]
    given: dict[str, Any] = {field: number(body, field) for field in numbers}
    return Begin(
        probe,
        preset,
        technician,
        reason,
        wanted,
        correct_sound=body.get("correct_sound") is True,
        latency=body.get("latency") is True,
        **given,
    )


def _point(body: dict[str, Any]) -> tuple[float, float, float] | None:
    """Returns where a pointer found the point; NaN, which is refused, where that is not a number."""
    if body.get("point") is None:
        return None
    point = body["point"] if isinstance(body["point"], list) else []
    x, y, z = (number({"one": point[index]}, "one") if len(point) == len("xyz") else float("nan") for index in range(3))
    return x, y, z


ACTS: dict[str, Callable[[ScanSession, dict[str, Any]], None]] = {
    "begin": lambda session, body: session.begin(_begin(body)),
    "latency": lambda session, body: session.take_latency(body.get("measured") is True),
    "check": lambda session, body: session.check(_point(body)),
    "end-check": lambda session, _: session.end_check(),
    "finish": lambda session, _: session.finish(),
    "resume": lambda session, _: session.resume(),
    "strike": lambda session, body: session.strike(whole(body, "index"), body.get("struck") is not False),
    "correct": lambda session, body: session.correct(
        whole(body, "index"), (number(body, "column"), number(body, "row"))
    ),
    "accept": lambda session, body: session.accept(
        Signature(*(text(body, name) for name in ("name", "role", "comment", "confirm", "unchecked")))
    ),
    "reject": lambda session, body: session.reject(text(body, "reason")),
    "dismiss": lambda session, _: session.dismiss(),
}
