"""What the metrics say of a status: the truth about the contact, base units, and nothing where nothing is known."""

import subprocess
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from prometheus_client import CollectorRegistry
from prometheus_client.parser import text_string_to_metric_families

from probewatch.appliance.service.control.status_fields import Field, Kind, Metric
from probewatch.appliance.supervision.alarms import HAZARDS
from probewatch.tools.monitoring import exposition, reading
from probewatch.tools.monitoring.exposition import SHOWN
from probewatch.tools.monitoring.reading import Exposition, found
from tests.support.answering import Answering, recorded

Samples = dict[tuple[str, tuple[tuple[str, str], ...]], float]


def samples(metrics: Any) -> Samples:
    return {
        (sample.name, tuple(sorted(sample.labels.items()))): sample.value
        for metric in metrics
        for sample in metric.samples
    }


def of(status: dict[str, Any]) -> Samples:
    return samples(found(status, 1000.0))


def value(found_samples: Samples, name: str, **labels: str) -> float | None:
    return found_samples.get((f"probewatch_{name}", tuple(sorted(labels.items()))))


def test_the_limits_in_force_are_named() -> None:
    status = recorded()
    assert value(of(status), "limits_info", profile="coarse", beside="point_mm 3") == 1
    assert (
        value(of({**status, "limits": {"profile": "fine", "beside": {}}}), "limits_info", profile="fine", beside="")
        == 1
    )
    older = {name: said for name, said in status.items() if name != "limits"}
    assert not [name for name, _ in of(older) if name == "probewatch_limits_info"]
    assert value(of(older), "up") == 1


def test_a_verified_cart() -> None:
    seen = of(recorded())
    assert value(seen, "up") == 1
    assert value(seen, "contact_closed") == 1
    assert value(seen, "state", state="monitoring") == 1
    assert value(seen, "state", state="halt") == 0
    assert sum(one for (name, _), one in seen.items() if name == "probewatch_state") == 1
    status = recorded()
    (scale,) = (check for check in status["checks"] if check["name"] == "scale-axial")
    assert value(seen, "check_ratio", check="scale-axial") == scale["ratio"]
    assert value(seen, "check_sigma_ratio", check="scale-axial") == scale["sigma"] / scale["limit"]
    assert value(seen, "parameter_age_seconds", parameter="scale-axial") == scale["shown_age_s"]
    assert {label for (name, ((_, label),)) in ((n, ls) for n, ls in seen if n == "probewatch_parameter_shown")} == {
        *SHOWN
    }
    verdicts = {check["name"]: check["verdict"] for check in status["checks"]}
    assert [value(seen, "parameter_shown", parameter=name) for name in SHOWN] == [verdicts[n] == "OK" for n in SHOWN]
    assert {value(seen, "parameter_carried", parameter=name) for name in SHOWN} == {0}
    assert value(seen, "latency_seconds") == pytest.approx(
        next(check["value"] for check in status["checks"] if check["name"] == "latency") / 1e3
    )
    assert value(seen, "alarms_total", hazard="polarity") == 0
    assert {labels[0][1] for name, labels in seen if name == "probewatch_alarms_total"} == {*HAZARDS}
    assert value(seen, "log_disk_free_bytes") == status["log"]["free_bytes"]


@pytest.mark.parametrize(
    ("verdict", "said", "shown", "carried"),
    [
        ("OK", "verified", 1, 0),
        ("OK", "carried", 0, 1),
        ("OK", "missing", 0, 0),
        ("NOT_VERIFIED", "carried", 0, 1),
        ("OK", None, 1, 0),
    ],
)
def test_what_the_present_motion_shows_and_what_is_carried_are_two_metrics(
    verdict: str, said: str | None, shown: int, carried: int
) -> None:
    status = recorded()
    (scale,) = (check for check in status["checks"] if check["name"] == "scale-axial")
    scale |= {"verdict": verdict, "shown": said, "carried": said == "carried"}
    seen = of(status)
    assert value(seen, "parameter_shown", parameter="scale-axial") == shown
    assert value(seen, "parameter_carried", parameter="scale-axial") == carried


def test_delays_are_a_histogram_in_seconds() -> None:
    status = recorded()
    status["outputs"][0]["delays"] = {"le_ms": [10.0, 100.0], "counts": [3, 2, 1], "sum_ms": 1500.0}
    seen = of(status)
    counts = [value(seen, "output_delay_seconds_bucket", output="1", signal="contact", le=le) for le in ("0.01", "0.1")]
    assert counts == [3, 5]
    assert value(seen, "output_delay_seconds_bucket", output="1", signal="contact", le="+Inf") == 6
    assert value(seen, "output_delay_seconds_count", output="1", signal="contact") == 6
    assert value(seen, "output_delay_seconds_sum", output="1", signal="contact") == 1.5


@pytest.mark.parametrize(
    ("energised", "written", "closed"),
    [(True, [True], 1), (True, [False], 0), (True, [None], 0), (True, [True, None], 0), (False, [True], 0)],
)
def test_the_contact_is_closed_only_once_every_output_has_written_it(
    energised: bool, written: list[bool | None], closed: int
) -> None:
    """The state turns a moment before the output has done its work."""
    status = recorded(energised=energised)
    (output,) = status["outputs"]
    status["outputs"] = [{**output, "energised": one} for one in written]
    status["outputs"].append({**output, "signal": "red", "energised": False})
    assert value(of(status), "contact_closed") == closed


def test_what_is_not_known_is_not_there() -> None:
    status = recorded(verification_age_s=None, checks=[], reference=None, reference_due_utc=None, verdict=None)
    status["log"]["free_bytes"] = status["load"]["pressure"] = None
    seen = of(status)
    for name in ("verification_age_seconds", "latency_seconds", "log_disk_free_bytes", "pressure_ratio"):
        assert value(seen, name) is None
    assert not any(name.startswith("probewatch_reference_info") for name, _ in seen)
    assert {value(seen, "parameter_shown", parameter=name) for name in SHOWN} == {0}, "silence shows nothing"


def test_a_due_date_and_a_lost_device() -> None:
    status = recorded(
        reference_due_utc="1970-01-02T00:00:00+00:00", lost={"tracker ndi:/dev/x": "gone"}, losses={"tracker": 4}
    )
    seen = of(status)
    assert value(seen, "reference_due_timestamp_seconds") == 86400
    assert value(seen, "device_lost", device="tracker") == 1
    assert value(seen, "device_lost", device="video") == 0
    assert value(seen, "device_losses_total", device="tracker") == 4
    assert value(seen, "device_losses_total", device="output") == 0


KEYS = sorted(recorded())


@given(st.sampled_from(KEYS), st.sampled_from([None, 1, "x", [], {}, [None], {"a": None}]), st.booleans())
def test_a_status_of_another_version_never_looks_half_well(key: str, other: object, missing: bool) -> None:
    """Either all of it is understood, or the service counts as silent."""
    status = recorded()
    if missing:
        del status[key]
    else:
        status[key] = other
    seen = of(status)
    assert value(seen, "up") in (0, 1)
    assert len(seen) == 2 if value(seen, "up") == 0 else len(seen) > 50
    if key in ("energised", "outputs") and (missing or not other):
        assert value(seen, "contact_closed") in (None, 0)


@pytest.mark.parametrize(("later", "up"), [(True, 1), (False, 0)])
def test_only_a_field_that_was_added_later_may_be_missing(
    later: bool, up: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    metric = Metric("shelf_meters", Kind.GAUGE, "Height of the cart's shelf")
    monkeypatch.setattr(exposition, "STATUS", (Field("shelf_m", "number", "height", metric=metric, later=later),))
    assert value(of(recorded()), "up") == up
    assert value(of(recorded()), "shelf_meters") is None
    assert value(of(recorded(shelf_m=1.2)), "shelf_meters") == 1.2


@pytest.mark.parametrize(
    ("kind", "told", "name", "expected"),
    [
        (Kind.GAUGE, None, "x", None),
        (Kind.COUNTER, 3, "x_total", 3),
        (Kind.TRUE, [], "x", 0),
        (Kind.TRUE, ["a"], "x", 1),
        (Kind.GIVEN, None, "x", 0),
        (Kind.GIVEN, 0.0, "x", 1),
    ],
)
def test_what_each_kind_of_metric_makes_of_its_field(
    kind: Kind, told: object, name: str, expected: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = (Field("whole", "object", parts=(Field("part", metric=Metric("x", kind, "An example")),)),)
    monkeypatch.setattr(exposition, "STATUS", rows)
    assert value(of(recorded(whole={"part": told})), name) == expected


def test_a_service_that_is_away_or_silent_or_no_service(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "TIMEOUT_S", 0.2)
    exposition = Exposition(tmp_path / "control")
    assert samples(exposition.collect())[("probewatch_up", ())] == 0
    with Answering(tmp_path / "control") as service:
        assert samples(exposition.collect())[("probewatch_contact_closed", ())] == 1
        service.mute = True
        assert {name for name, _ in samples(exposition.collect())} == {
            "probewatch_up",
            "probewatch_exposition_timestamp_seconds",
        }
        service.mute = False
        assert samples(exposition.collect())[("probewatch_up", ())] == 1, "it comes back by itself"
        service.tell = lambda: {"hello": 1}
        assert samples(exposition.collect())[("probewatch_up", ())] == 0
    assert set(service.asked) == {"status"}, "it asks nothing else"


def test_promtool_finds_nothing_to_say_against_the_metrics(promtool: str) -> None:
    registry = CollectorRegistry()
    registry.register(Fixed(found(recorded(), 1000.0)))
    text = reading.generate_latest(registry)
    done = subprocess.run([promtool, "check", "metrics"], input=text, capture_output=True, check=False)
    assert (done.returncode, done.stdout + done.stderr) == (0, b"")
    assert len(list(text_string_to_metric_families(text.decode()))) > 40


class Fixed:
    def __init__(self, metrics: list[Any]) -> None:
        self._metrics = metrics

    def collect(self) -> list[Any]:
        return self._metrics
