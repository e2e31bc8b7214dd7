"""The tracker must keep answering for the probe's tool; an answer without a pose still counts."""

from appliance.supervision.watchers.facts import Facts, Patience, presence
from appliance.types import Check, Fault


def tracker_presence(now_ns: int, facts: Facts, patience: Patience) -> Check:
    """tracker-lost when no reply has arrived for patience.tracker_ns."""
    last_ns = facts.replies.reply_ns
    return presence("tracker presence", Fault.TRACKER_LOST, now_ns, facts.started_ns, last_ns, patience.tracker_ns)
