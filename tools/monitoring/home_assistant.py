"""Makes what Home Assistant must be sent so that a cart appears there by itself: MQTT discovery, one message an
entity.
"""

import re
from typing import Any

_EXPIRE_S = 60
"""Seconds after which a value that was not sent again counts as unknown: four times the publisher's repeat interval."""
_LONGEST = 255
"""Characters of a state in Home Assistant; a longer one, such as of several notices, counts as unknown there."""

_ENTITIES: dict[str, tuple[str, dict[str, Any]]] = {
    "verified": (
        "binary_sensor",
        {"name": "Calibration verified", "value_template": "{{ 'ON' if value_json.verified else 'OFF' }}"},
    ),
    "alarm": (
        "binary_sensor",
        {
            "name": "Alarm",
            "device_class": "problem",
            "value_template": "{{ 'ON' if value_json.alarm or not value_json.up else 'OFF' }}",
        },
    ),
    "state": (
        "sensor",
        {"name": "State", "value_template": "{{ value_json.state if value_json.up else 'service silent' }}"},
    ),
    "text": (
        "sensor",
        {"name": "What is wrong", "value_template": f"{{{{ (value_json.text | default(''))[:{_LONGEST}] }}}}"},
    ),
    "latched": (
        "sensor",
        {
            "name": "Latched alarm",
            "value_template": "{{ (value_json.latched or 'none') if value_json.up else 'service silent' }}",
        },
    ),
    "acknowledged": (
        "binary_sensor",
        {
            "name": "Latched alarm acknowledged",
            "value_template": ("{{ none if not value_json.latched else 'ON' if value_json.acknowledged else 'OFF' }}"),
        },
    ),
    "due": (
        "sensor",
        {
            "name": "Calibration due",
            "device_class": "timestamp",
            "value_template": "{{ value_json.reference_due_utc | default(none) }}",
        },
    ),
}


def discovery(cart: str, state: str, available: str, prefix: str) -> dict[str, dict[str, Any]]:
    """Returns topic → configuration. state, available: topics of the cart, whose name may have several levels; those of
    Home Assistant take a name of one. prefix: that of Home Assistant's own topics.
    """
    node = _node(cart)
    device = {"identifiers": [f"probewatch_{node}"], "name": f"probewatch {cart}", "manufacturer": "probewatch"}
    common = {"state_topic": state, "availability_topic": available, "expire_after": _EXPIRE_S, "device": device}
    return {
        f"{prefix}/{kind}/probewatch_{node}/{name}/config": {
            **common,
            **entity,
            "unique_id": f"probewatch_{node}_{name}",
        }
        for name, (kind, entity) in _ENTITIES.items()
    }


def _node(cart: str) -> str:
    """Returns the cart's name as one level, of letters, digits, - and _, that no other cart has: a level ends in __,
    and a _ before _, - or the end of a level is _-.
    """
    return re.sub("_(?=[_/-])", "_-", cart).replace("/", "__")
