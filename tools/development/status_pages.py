"""Generates the tables and lists of docs/control.md and docs/monitoring.md from the rows of the status.
`python -m probewatch.tools.development.manual` writes them.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

from probewatch.appliance.service.control.status_fields import STATUS, Field, Kind
from probewatch.tools.development.markdown import table
from probewatch.tools.development.page_blocks import PageBlocks

_DOCS = Path(__file__).parents[2] / "docs"
PAGES = (_DOCS / "control.md", _DOCS / "monitoring.md")


def _fields() -> str:
    """Returns the table with one line break at its end: the end mark follows right below it."""
    return "\n".join(table(("field", "type", "meaning"), [(f"`{one.name}`", one.type, _told(one)) for one in STATUS]))


def _told(field: Field) -> str:
    parts = ", ".join(f"`{part.name}`{part.meaning}" for part in field.parts)
    return ": ".join(filter(None, (field.meaning, parts)))


def _metrics() -> str:
    rows = [row for field in STATUS for row in (*_metric(field, ""), *_metrics_of_parts(field))]
    return "\n".join(table(("metric", "field"), rows))


def _metrics_of_parts(field: Field) -> Iterator[tuple[str, str]]:
    return (row for part in field.parts for row in _metric(part, f"{field.name}."))


def _metric(field: Field, inside: str) -> Iterator[tuple[str, str]]:
    """Yields the row of a metric. inside: the object of which it is a part, with a full stop."""
    if (metric := field.metric) is not None:
        name = f"probewatch_{metric.name}{'_total' if metric.kind is Kind.COUNTER else ''}"
        yield f"`{name}`", f"`{inside}{field.name}`{_condition(field, metric.kind)}"


def _condition(field: Field, kind: Kind) -> str:
    """Returns the condition under which the metric is 1, where that is not the value of the field itself."""
    if kind is Kind.GIVEN:
        return " is not null"
    return " is not empty" if kind is Kind.TRUE and field.type != "bool" else ""


def _mqtt() -> str:
    return ", ".join(f"`{field.name}`" for field in STATUS if field.mqtt) + "\n"


_TEXTS: dict[str, Callable[[], str]] = {"fields": _fields, "metrics": _metrics, "mqtt": _mqtt}
BLOCKS = PageBlocks("status", lambda name: _TEXTS[name]())


def written() -> dict[Path, str]:
    """Returns path and content of each page."""
    return {file: BLOCKS.page(file.read_text(encoding="utf-8")) for file in PAGES}
