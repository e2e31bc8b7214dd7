"""A tracker that answers with old measurements is worse than one that is silent: nothing looks wrong."""

from appliance.supervision.watchers.facts import Facts, Patience, silence
from appliance.types import Check, Fault
from drivers.samples import PoseStatus


def tracker_freshness(now_ns: int, facts: Facts, patience: Patience) -> Check:
    """tracker-stale when the reply is STALE, and none has been fresh for patience.stale_ns."""
    last_fresh_ns = facts.started_ns if facts.replies.fresh_ns is None else facts.replies.fresh_ns
    age_ns = now_ns - last_fresh_ns if facts.replies.status is PoseStatus.STALE else 0
    return silence("tracker freshness", Fault.TRACKER_STALE, age_ns, patience.stale_ns)
