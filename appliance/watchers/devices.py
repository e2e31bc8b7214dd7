"""The device watchers, in the order in which a technician would look."""

from appliance.types import Check
from appliance.watchers.estimator_presence import estimator_presence
from appliance.watchers.facts import Facts, Patience
from appliance.watchers.line_of_sight import line_of_sight
from appliance.watchers.output_presence import output_presence
from appliance.watchers.tracker_freshness import tracker_freshness
from appliance.watchers.tracker_presence import tracker_presence
from appliance.watchers.video_presence import video_presence

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
