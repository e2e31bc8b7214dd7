"""What Home Assistant makes of the messages by its templates, which are Jinja's."""

import re
from itertools import product

import pytest
from jinja2 import Environment

from probewatch.tools.monitoring.home_assistant import discovery
from probewatch.tools.monitoring.mqtt import message
from tests.support.answering import recorded

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


@pytest.mark.parametrize("cart", ["cart-2", "Cart2", "cart_2", "ward/cart-2", "ward/cart_2"])
def test_ordinary_names_keep_their_topics(cart: str) -> None:
    """Home Assistant would know the cart twice."""
    node = f"probewatch_{cart.replace('/', '__')}"
    entities = discovery(cart, "s", "a", "ha")
    assert {topic.split("/")[2] for topic in entities} == {node}
    assert {one["unique_id"].rpartition("_")[0] for one in entities.values()} == {node}


def test_no_two_carts_share_a_topic_or_an_entity() -> None:
    """`a/b` and `a__b` did, so that one showed the other's alarm."""
    names = [
        name for length in range(1, 7) for letters in product("a_-/", repeat=length) if _may(name := "".join(letters))
    ]
    assert {"a/a", "a__a", "a_-_-a"} <= set(names)
    told = [discovery(name, "s", "a", "ha") for name in names]
    topics = [topic for entities in told for topic in entities]
    assert len(set(topics)) == len(topics)
    unique = [one["unique_id"] for entities in told for one in entities.values()]
    assert len(set(unique)) == len(unique)
    devices = {str(next(iter(entities.values()))["device"]["identifiers"]) for entities in told}
    assert len(devices) == len(names)
    assert all(re.fullmatch(r"ha/\w+/probewatch_[\w-]+/\w+/config", topic, re.ASCII) for topic in topics)


def _may(name: str) -> bool:
    """As `probewatch mqtt --cart` has it."""
    return "" not in name.split("/")
