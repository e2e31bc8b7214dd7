"""Exposes the status of a service as Prometheus metrics. docs/monitoring.md lists them.

Those made of one field are in its row, `appliance/service/control/status_fields.py`; those of several, or with labels,
are here. They have base units, and counters end in _total. What is not known is not there: a metric that is missing
states nothing, and none is ever older than the status of which it is made. `probewatch_contact_closed` is 1 only if the
state allows it and every output that shows the contact has completed a write that closed it.
"""

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from itertools import accumulate
from typing import Any

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    Metric,
)

from probewatch.appliance.service.control.status_fields import STATUS, Field, Kind
from probewatch.appliance.service.control.status_fields import Metric as Row
from probewatch.appliance.supervision.alarms import HAZARDS
from probewatch.appliance.supervision.annunciator import Role
from probewatch.appliance.types import PARAMETERS, POINT_LEVELS, State
from probewatch.tools.shared.profile_text import profile_text

Status = Mapping[str, Any]

SHOWN = ("polarity", "latency", *PARAMETERS)
"""Checks that only motion can show: their coverage is worth watching."""
_PLACES = {"worst": "worst_mm", "median": "median_mm", "depth": "at_depth_mm"}
_SHARES = tuple(f"{level:g}" for level in POINT_LEVELS)
"""Shares for which the two bounds of a place hold."""
_DEVICES = ("video", "tracker", "output")


def contact_closed(status: Status) -> bool:
    """Returns whether the calibration may be relied on: the state allows it, and no output is known to be late or
    lost.
    """
    contacts = [output for output in status["outputs"] if output["signal"] == Role.CONTACT.value]
    return status["energised"] is True and bool(contacts) and all(output["energised"] is True for output in contacts)


def silent(now_s: float) -> list[Metric]:
    """Returns the metrics of a service that does not answer: nothing but that. now_s: s since 1970."""
    return [_up(0), _gauge("exposition_timestamp_seconds", "When this was asked, since 1970", now_s)]


def families(status: Status, now_s: float) -> list[Metric]:
    """Returns all metrics of one status. Raises KeyError, TypeError, ValueError for one of another version.

    now_s: when it was asked, s since 1970.
    """
    parts = (_state, _checks, _point, _samples, _outputs, _losses, _host, _reference)
    found = [*(metric for part in parts for metric in part(status)), *_of_one_field(STATUS, status)]
    return [_up(1), _gauge("exposition_timestamp_seconds", "When this was asked, since 1970", now_s), *found]


def _up(value: int) -> Metric:
    return _gauge("up", "1: the service has just answered; 0: it has not, and nothing else is known of it", value)


def _gauge(name: str, what: str, value: float | None) -> Metric:
    """Returns a gauge, without a sample where the value is None."""
    metric = GaugeMetricFamily(f"probewatch_{name}", what)
    if value is not None:
        metric.add_metric([], float(value))
    return metric


def _gauges(name: str, what: str, label: str, values: Mapping[str, float | None]) -> Metric:
    metric = GaugeMetricFamily(f"probewatch_{name}", what, labels=[label])
    for key, value in values.items():
        if value is not None:
            metric.add_metric([key], float(value))
    return metric


def _counter(name: str, what: str, value: float) -> Metric:
    return CounterMetricFamily(f"probewatch_{name}", what, value=float(value))


def _counters(name: str, what: str, label: str, values: Mapping[str, float]) -> Metric:
    metric = CounterMetricFamily(f"probewatch_{name}", what, labels=[label])
    for key, value in values.items():
        metric.add_metric([key], float(value))
    return metric


def _histogram(name: str, what: str, labels: Sequence[str]) -> HistogramMetricFamily:
    return HistogramMetricFamily(f"probewatch_{name}", what, labels=labels)


def _observe(metric: HistogramMetricFamily, labels: Sequence[str], delays: Status) -> None:
    """Adds a histogram. delays: a histogram of the status, in ms."""
    bounds = [f"{float(bound_ms) / 1e3:g}" for bound_ms in delays["le_ms"]] + ["+Inf"]
    counts = [float(count) for count in accumulate(delays["counts"])]
    metric.add_metric(labels, list(zip(bounds, counts, strict=True)), float(delays["sum_ms"]) / 1e3)


def _of_one_field(fields: Sequence[Field], holder: Status) -> Iterator[Metric]:
    """Makes the metrics of single fields from their rows. holder: the status, or the object that has these parts."""
    for field in fields:
        if field.later and field.name not in holder:
            continue
        if field.parts:
            yield from _of_one_field(field.parts, holder[field.name])
        if field.metric is not None:
            yield _made(field.metric, holder[field.name])


def _made(row: Row, value: Any) -> Metric:
    """Returns the metric of a row. value: that of the row's field."""
    if row.kind is Kind.COUNTER:
        return _counter(row.name, row.help, value)
    flags = {Kind.TRUE: bool(value), Kind.GIVEN: value is not None}
    return _gauge(row.name, row.help, flags.get(row.kind, value))


def _state(status: Status) -> Iterator[Metric]:
    version = {"version": str(status["software"]), "configuration_sha256": str(status["configuration"]["sha256"])}
    yield InfoMetricFamily("probewatch", "Version and configuration in force", value=version)
    if limits := status.get("limits"):
        told = {"profile": str(limits["profile"]), "beside": profile_text(limits).partition(", but for ")[2]}
        yield InfoMetricFamily(
            "probewatch_limits", "Limits in force, and what is not as their profile has it", value=told
        )
    states = {state.value: float(state.value == status["state"]) for state in State}
    yield _gauges("state", "1 for the state in force, 0 for the others", "state", states)
    causes = {hazard.value: float(hazard.value == status["fault"]) for hazard in HAZARDS}
    yield _gauges("state_cause", "1 for the hazard that caused the state", "hazard", causes)
    yield _gauge("contact_closed", "1: verified, and the contact has been closed", contact_closed(status))
    alarms = {hazard.value: status["alarms"].get(hazard.value, 0) for hazard in HAZARDS}
    yield _counters("alarms", "How often a hazard came to cause the state, or to be a notice", "hazard", alarms)


def _checks(status: Status) -> Iterator[Metric]:
    """Yields the metrics of the checks. Those of the line are gone while the estimator is silent; then no parameter is
    shown.
    """
    line = {check["name"]: check for check in status["checks"]}
    checks = {**line, **{check["name"]: check for check in status["devices"]}}
    ratios = {name: check["ratio"] for name, check in checks.items()}
    yield _gauges("check_ratio", "Magnitude of the value divided by its limit: 1 is the limit", "check", ratios)
    sigmas = {name: _share(check["sigma"], check["limit"]) for name, check in checks.items()}
    yield _gauges("check_sigma_ratio", "Standard deviation of the value divided by its limit", "check", sigmas)
    failed = {name: float(check["verdict"] == "FAULT") for name, check in checks.items()}
    yield _gauges("check_failed", "1: outside its limit", "check", failed)
    shown = {name: float(name in line and _shown_now(line[name])) for name in SHOWN}
    yield _gauges("parameter_shown", "1: the present motion shows it within its limit", "parameter", shown)
    carried = {name: float(name in line and bool(line[name].get("carried"))) for name in SHOWN}
    yield _gauges("parameter_carried", "1: shown by earlier motion alone, which is not too old", "parameter", carried)
    ages = {name: line[name]["shown_age_s"] for name in SHOWN if name in line}
    yield _gauges("parameter_age_seconds", "Age of the motion that showed the parameter", "parameter", ages)
    latency = line.get("latency", {})
    yield _gauge("latency_seconds", "How late the tracker's stamps are", _share(latency.get("value"), 1e3))
    yield _gauge("latency_sigma_seconds", "Standard deviation of that", _share(latency.get("sigma"), 1e3))


def _point(status: Status) -> Iterator[Metric]:
    point, limit_mm = status["point"], status["point_limit_mm"]
    what = "Bound of the error of a point of the picture, for that share of what is left open"
    metric = GaugeMetricFamily("probewatch_point_error_meters", what, labels=["place", "share"])
    for place, key in _PLACES.items():
        for share, bound_mm in zip(_SHARES, (point or {}).get(key) or (), strict=False):
            metric.add_metric([place, share], bound_mm / 1e3)
    yield metric
    yield _gauge("point_error_limit_meters", "That an OK asks of the worst place, .997", _share(limit_mm, 1e3))
    age_s = (point or {}).get("shown_age_s")
    yield _gauge("point_error_age_seconds", "Age of the oldest motion that it rests on", age_s)


def _shown_now(check: Mapping[str, Any]) -> bool:
    """Returns whether the present motion shows the parameter: `shown` is null where the contact does not ask for it;
    then the verdict decides.
    """
    return bool(check["verdict"] == "OK" and check.get("shown") in (None, "verified"))


def _share(value: float | None, whole: float | None) -> float | None:
    return None if value is None or not whole else value / whole


def _samples(status: Status) -> Iterator[Metric]:
    counters, rates = status["counters"], {name: status["fps"][name] for name in ("video", "tracker")}
    yield _gauges("sample_rate_hertz", "Pictures and poses taken, per second", "source", rates)
    taken = {"video": counters["frames"], "tracker": counters["poses"]}
    yield _counters("samples", "Pictures and poses taken", "source", taken)
    dropped = {"video": counters["dropped_frames"], "tracker": counters["dropped_poses"]}
    yield _counters("dropped_samples", "Taken, and dropped before they were judged", "source", dropped)


def _outputs(status: Status) -> Iterator[Metric]:
    """Yields the metrics of the outputs by their place in the configuration, from 1 on."""
    labels = ["output", "signal"]
    energised = GaugeMetricFamily("probewatch_output_energised", "1: written last, 0: the other", labels=labels)
    writes = CounterMetricFamily("probewatch_output_writes", "Completed writes", labels=labels)
    delays = _histogram("output_delay_seconds", "From what asked for a change to the completed write", labels)
    for number, output in enumerate(status["outputs"], 1):
        names = [str(number), str(output["signal"])]
        if output["energised"] is not None:
            energised.add_metric(names, float(output["energised"]))
        writes.add_metric(names, float(output["writes"]))
        _observe(delays, names, output["delays"])
    yield from (energised, writes, delays)


def _losses(status: Status) -> Iterator[Metric]:
    lost = {str(name).partition(" ")[0] for name in status["lost"]}
    now = {name: float(name in lost) for name in _DEVICES}
    yield _gauges("device_lost", "1: a device of that kind is lost now", "device", now)
    losses = {name: status["losses"].get(name, 0) for name in _DEVICES}
    yield _counters("device_losses", "How often a device of that kind was lost", "device", losses)


def _host(status: Status) -> Iterator[Metric]:
    intervals = _histogram("tick_interval_seconds", "From one tick to the next; due after 0.05", [])
    _observe(intervals, [], status["tick"]["histogram"])
    yield intervals


def _reference(status: Status) -> Iterator[Metric]:
    reference = status["reference"]
    if reference is None:
        return
    named = {name: str(reference[name]) for name in ("number", "sha256", "origin")}
    yield InfoMetricFamily("probewatch_reference", "The calibration that is watched", value=named)
    yield _time("reference_timestamp_seconds", "When it came in force, since 1970", reference["utc"])
    verified = "When motion first showed it, since 1970"
    yield _time("reference_verified_timestamp_seconds", verified, reference["verified_utc"])
    due = "When it is to be checked again, since 1970"
    yield _time("reference_due_timestamp_seconds", due, status["reference_due_utc"])


def _time(name: str, what: str, utc: str | None) -> Metric:
    return _gauge(name, what, None if utc is None else datetime.fromisoformat(utc).timestamp())
