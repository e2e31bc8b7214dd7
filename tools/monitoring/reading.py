"""Reads the status for others: one query at a time, and an answer that is never older than the query."""

import threading
import time
from pathlib import Path

from prometheus_client import CollectorRegistry, Metric, generate_latest
from prometheus_client.registry import Collector

from probewatch.appliance.service.control.client import ControlClient
from probewatch.drivers.errors import ProbewatchError
from probewatch.tools.monitoring.exposition import Status, families, silent

TIMEOUT_S = 2.0
"""Seconds for which the service may be silent: it answers within a tick of 0.05 s. Prometheus gives up after 10 s by
default; this must be less, so that it learns that the service is away."""


def read_status(socket: Path) -> Status | None:
    """Returns the status; None where no service answers within TIMEOUT_S, or the answer is not a status."""
    try:
        with ControlClient(socket, TIMEOUT_S) as client:
            return client.status()
    except (ProbewatchError, OSError, ValueError, KeyError, TypeError, AssertionError, RecursionError):
        return None


class Exposition(Collector):
    """Collects the metrics. socket: that of the service. A caller that asks while another's query is under way shares
    the next answer.
    """

    def __init__(self, socket: Path) -> None:
        self._socket = socket
        self._lock = threading.Lock()
        self._asked_s = float("-inf")
        self._found: list[Metric] = []

    def collect(self) -> list[Metric]:
        """Returns all metrics, or that the service is silent."""
        came_s = time.monotonic()
        with self._lock:
            if self._asked_s < came_s:
                self._asked_s = time.monotonic()
                self._found = found(read_status(self._socket), time.time())
            return self._found

    def describe(self) -> list[Metric]:
        """Returns no metrics, so that the service is not asked when this is registered."""
        return []

    def text(self) -> bytes:
        """Returns the text format 0.0.4, which every reader of metrics understands."""
        registry = CollectorRegistry()
        registry.register(self)
        return generate_latest(registry)


def found(status: Status | None, now_s: float) -> list[Metric]:
    """Returns the metrics of a status. One of another version counts as none: half of it would look as if the rest were
    well.
    """
    if status is None:
        return silent(now_s)
    try:
        return families(status, now_s)
    except (KeyError, TypeError, ValueError, AttributeError):
        return silent(now_s)
