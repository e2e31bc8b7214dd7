"""The scanner's pictures must keep coming."""

from appliance.supervision.watchers.facts import Facts, Patience, presence
from appliance.types import Check, Fault


def video_presence(now_ns: int, facts: Facts, patience: Patience) -> Check:
    """video-lost when no picture has arrived for patience.video_ns."""
    return presence("video presence", Fault.VIDEO_LOST, now_ns, facts.started_ns, facts.frame_ns, patience.video_ns)
