"""The device watchers, in the order in which a technician would look."""

from appliance.supervision.watchers.estimator_presence import estimator_presence
from appliance.supervision.watchers.facts import Facts, Patience
from appliance.supervision.watchers.line_of_sight import line_of_sight
from appliance.supervision.watchers.output_presence import output_presence
from appliance.supervision.watchers.tracker_freshness import tracker_freshness
from appliance.supervision.watchers.tracker_presence import tracker_presence
from appliance.supervision.watchers.video_presence import video_presence
from appliance.types import Check

_WATCHERS = (
    output_presence,
    video_presence,
    tracker_presence,
    tracker_freshness,
    estimator_presence,
    line_of_sight,
)


def watch_devices(now_ns: int, facts: Facts, patience: Patience) -> tuple[Check, ...]:
    """One Check per watcher, failing or not."""
    return tuple(watcher(now_ns, facts, patience) for watcher in _WATCHERS)
