"""What Home Assistant makes of the messages by its templates, which are Jinja's."""

import re

import pytest
from jinja2 import Environment

from tests.support.answering import recorded
from tools.monitoring.home_assistant import discovery
from tools.monitoring.mqtt import message

LONGEST = 255
"""Characters of a state there; more counts as unknown."""


def shown(status: dict[str, object] | None) -> dict[str, str]:
    """Name of each entity → its state."""
    entities = discovery("cart-2", "state", "availability", "homeassistant").values()
    rendered = Environment(autoescape=False)
    return {
        one["name"]: rendered.from_string(one["value_template"]).render(value_json=message(status)) for one in entities
    }


def test_a_text_of_many_notices_is_shown_as_far_as_a_state_goes() -> None:
    """Its state was unknown, while an alarm was on."""
    text = " · ".join(["Calibration not verified", *["This computer is overloaded"] * 12])
    assert shown(recorded(text=text))["What is wrong"] == text[:LONGEST]
    assert all(len(state) <= LONGEST for state in shown(recorded(text=text)).values())


@pytest.mark.parametrize(
    ("status", "states"),
    [
        (None, {"Calibration verified": "OFF", "Alarm": "ON", "State": "service silent", "What is wrong": ""}),
        (recorded(text="fine", priority="none"), {"Alarm": "OFF", "What is wrong": "fine"}),
        (recorded(priority="high"), {"Alarm": "ON"}),
        (None, {"Latched alarm": "service silent", "Latched alarm acknowledged": "None"}),
        (recorded(latched=None), {"Latched alarm": "none", "Latched alarm acknowledged": "None"}),
        (recorded(latched="halt"), {"Latched alarm": "halt", "Latched alarm acknowledged": "OFF"}),
        (
            recorded(latched="halt", acknowledged=True),
            {"Latched alarm": "halt", "Latched alarm acknowledged": "ON"},
        ),
    ],
)
def test_what_is_shown_of_a_cart(status: dict[str, object] | None, states: dict[str, str]) -> None:
    assert shown(status) | states == shown(status)


def test_a_cart_whose_name_has_levels_is_found_all_the_same() -> None:
    """Home Assistant hears PREFIX/KIND/NODE/NAME/config alone, and a node is letters, digits, - and _."""
    entities = discovery("ward/cart-2", "probewatch/ward/cart-2/state", "availability", "homeassistant")
    assert all(re.fullmatch(r"homeassistant/\w+/probewatch_[\w-]+/\w+/config", topic) for topic in entities)
    assert {one["state_topic"] for one in entities.values()} == {"probewatch/ward/cart-2/state"}
    assert next(iter(discovery("cart-2", "s", "a", "ha"))) == "ha/binary_sensor/probewatch_cart-2/verified/config"
