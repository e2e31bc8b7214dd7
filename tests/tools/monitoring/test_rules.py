"""Rules for alerts, the dashboard and the page: promtool accepts them, and they name only metrics that there are."""

import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from probewatch.appliance.service.control.status_fields import STATUS, Kind
from probewatch.tools.monitoring.reading import found
from tests.support.answering import recorded

ROOT = Path(__file__).parents[3]
MONITORING = ROOT / "config" / "monitoring"
RULES = MONITORING / "probewatch.rules.yml"
DASHBOARD = json.loads((MONITORING / "grafana-dashboard.json").read_text())
UNIT_TESTS = Path(__file__).with_name("rules.test.yml")
PAGE = ROOT / "docs" / "monitoring.md"
_NAME = re.compile(r"\bprobewatch_[a-z0-9_]+")


def known() -> set[str]:
    """Every sample that a service can have, with those of histograms."""
    status = recorded(reference_due_utc="2030-01-01T00:00:00+00:00")
    metrics = found(status, 0.0)
    return {sample.name for metric in metrics for sample in metric.samples} | later()


def later() -> set[str]:
    """Metrics of fields that were added after the status was recorded."""
    rows = (field for whole in STATUS for field in (whole, *whole.parts) if field.later and field.metric)
    return {
        f"probewatch_{row.metric.name}{'_total' if row.metric.kind is Kind.COUNTER else ''}"
        for row in rows
        if row.metric is not None
    }


def rules() -> list[dict[str, Any]]:
    return [rule for group in yaml.safe_load(RULES.read_text())["groups"] for rule in group["rules"]]


def expressions() -> Iterator[str]:
    for panel in DASHBOARD["panels"]:
        for target in panel["targets"]:
            yield target["expr"].replace("$__rate_interval", "1m").replace("$instance", ".*")


def test_promtool_accepts_rules_and_configuration(promtool: str) -> None:
    for kind, name in (("rules", "probewatch.rules.yml"), ("config", "prometheus.yml")):
        done = subprocess.run([promtool, "check", kind, MONITORING / name], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.thorough
def test_every_alert_waits_for_what_it_says(promtool: str, tmp_path: Path) -> None:
    """promtool would have the tests repeat every text; so the rules are tried without."""
    document = yaml.safe_load(RULES.read_text())
    for rule in (rule for group in document["groups"] for rule in group["rules"]):
        assert "alert" not in rule or {"summary", "remedy"} == set(rule.pop("annotations"))
    (tmp_path / "rules.yml").write_text(yaml.safe_dump(document))
    (tmp_path / UNIT_TESTS.name).write_text(UNIT_TESTS.read_text())
    done = subprocess.run(
        [promtool, "test", "rules", tmp_path / UNIT_TESTS.name], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    tried = {test["name"] for test in yaml.safe_load(UNIT_TESTS.read_text())["tests"]}
    assert {rule["alert"] for rule in rules() if "alert" in rule} <= tried


def test_promtool_understands_every_panel_of_the_dashboard(promtool: str, tmp_path: Path) -> None:
    listed = [{"record": f"panel:{number}", "expr": text} for number, text in enumerate(expressions())]
    file = tmp_path / "panels.yml"
    file.write_text(yaml.safe_dump({"groups": [{"name": "panels", "rules": listed}]}))
    done = subprocess.run([promtool, "check", "rules", file], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(listed) > 15


@pytest.mark.parametrize("where", ["rules", "dashboard", "unit tests"])
def test_only_metrics_that_there_are(where: str) -> None:
    text = {
        "rules": " ".join(rule["expr"] for rule in rules()),
        "dashboard": " ".join(expressions()),
        "unit tests": UNIT_TESTS.read_text(),
    }[where]
    named = set(_NAME.findall(text))
    assert named
    assert named <= known()


def test_the_page_lists_every_metric() -> None:
    bare = {re.sub(r"_(bucket|count|sum)$", "", name) for name in known()}
    listed = set(re.findall(r"^\| `(probewatch_[a-z0-9_]+)", PAGE.read_text(), re.M))
    assert listed == bare


def test_the_alerts_are_listed_on_the_page() -> None:
    named = {rule["alert"] for rule in rules() if "alert" in rule}
    assert set(re.findall(r"^\| `(Probewatch[A-Za-z]+)`", PAGE.read_text(), re.M)) == named


def test_the_page_says_of_what_a_metric_is_1() -> None:
    rows = re.findall(r"^\| `(probewatch_\w+)` \| `([a-z_.]+)`(?: is not (null|empty))? \|", PAGE.read_text(), re.M)
    assert len(rows) > 20
    for name, path, what in rows:
        if what:
            assert made_of(name, path, None) == 0.0, name
            assert made_of(name, path, []) == float(what == "null"), name
            assert made_of(name, path, ["something"]) == 1.0, name
        elif value_at(recorded(), path) is None:
            assert made_of(name, path, None) is None, name


def value_at(status: dict[str, Any], path: str) -> Any:
    *outer, key = path.split(".")
    return (status[outer[0]] if outer else status).get(key, 0)


def made_of(name: str, path: str, content: Any) -> float | None:
    """The sample of this name where the field at the path has this content; None without a sample."""
    status = recorded()
    *outer, key = path.split(".")
    (status[outer[0]] if outer else status)[key] = content
    return next((one.value for metric in found(status, 0.0) for one in metric.samples if one.name == name), None)
