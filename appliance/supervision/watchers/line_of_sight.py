"""A probe laid aside or hidden is no fault of a device, but nothing can be verified meanwhile."""

from appliance.supervision.watchers.facts import Facts, Patience, silence
from appliance.types import Check, Fault, VerdictKind
from drivers.samples import PoseStatus

_UNSEEN = (PoseStatus.MISSING, PoseStatus.OUT_OF_VOLUME, PoseStatus.PARTIAL)


def line_of_sight(now_ns: int, facts: Facts, patience: Patience) -> Check:
    """NOT_VERIFIED when the tracker has answered without a pose for patience.unseen_ns."""
    last_pose_ns = facts.started_ns if facts.replies.pose_ns is None else facts.replies.pose_ns
    age_ns = now_ns - last_pose_ns if facts.replies.status in _UNSEEN else 0
    return silence("line of sight", Fault.LINE_OF_SIGHT, age_ns, patience.unseen_ns, VerdictKind.NOT_VERIFIED)
