"""Compares a self-test with that of the cart's first use, which is kept for this purpose."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from probewatch.tools.selftest.items import Item

KEY = "first_use"
"""Key of a record: true where it is the one to compare with. The newest such record counts."""
NAME = "first use"
_MOST_RATE_CHANGE = 0.05
"""Share by which a rate may differ from that of the first use, as docs/periodic-check.md has it. Less rejects grabbers
that round their rate, more hides a device that was set to another rate. Not measured on carts."""


def first_use(kept: Sequence[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """Returns the record to compare with, of those that are kept, oldest first; None where there is none."""
    return next((record for record in reversed(kept) if record.get(KEY) is True), None)


def beside(items: Sequence[Item], first: Mapping[str, Any] | None) -> list[Item]:
    """Returns the items, each figure with that of the first use; a rate that differs is red."""
    if first is None:
        return [*items]
    before = {str(one.get("name")): one.get("figure") for one in first["items"]}
    told = f"compared with the self-test of {first['utc']}, software {first.get('software')}"
    return [*(_beside(item, before.get(item.name)) for item in items), Item(NAME, True, told)]


def chosen(items: Sequence[Item]) -> Item:
    """Returns the item that states whether this self-test is kept as the first use; one that is not green is not kept
    as such.
    """
    green = all(item.green for item in items)
    what = (
        "this self-test is kept to compare later ones with" if green else "not kept to compare with: not all is green"
    )
    return Item(NAME, green, what, "" if green else "Mend what is not green, and repeat")


def _beside(item: Item, before: object) -> Item:
    if item.figure is None or isinstance(before, bool) or not isinstance(before, int | float):
        return item
    what = f"{item.what}; first use {before:.4g} {item.unit}"
    if not item.name.endswith(" rate") or abs(item.figure - before) <= _MOST_RATE_CHANGE * before:
        return replace(item, what=what)
    remedy = item.remedy or "Set the device as it was, or keep this one as first use: --baseline"
    return replace(item, what=what, green=False, remedy=remedy)
