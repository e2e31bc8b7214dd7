"""A tracker that answers, but says of itself that its poses cannot be believed: bumped, too hot, faulty, disturbed."""

from appliance.supervision.watchers.facts import Facts, Patience, silence
from appliance.types import Check, Fault
from drivers.samples import PoseStatus


def tracker_alert(now_ns: int, facts: Facts, patience: Patience) -> Check:
    """tracker-alert when the reply is FAULT, and none has been fresh for patience.tracker_ns."""
    last_good_ns = facts.started_ns if facts.replies.fresh_ns is None else facts.replies.fresh_ns
    age_ns = now_ns - last_good_ns if facts.replies.status is PoseStatus.FAULT else 0
    return silence("tracker alert", Fault.TRACKER_ALERT, age_ns, patience.tracker_ns)
