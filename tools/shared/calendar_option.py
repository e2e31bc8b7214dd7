"""Options for days and times."""

from datetime import datetime
from typing import Any

import click


class _DateOption(click.DateTime):
    """A date option whose error messages are in plain words, not in format codes as click's are."""

    def __init__(self, formats: list[str], what: str) -> None:
        super().__init__(formats)
        self._what = what

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> datetime:
        """Raises click.BadParameter."""
        try:
            moment: datetime = super().convert(value, param, ctx)
        except click.BadParameter:
            self.fail(f"'{value}' is not {self._what}", param, ctx)
        return moment


DAY = _DateOption(["%Y-%m-%d"], "a day of the calendar, written as 2026-01-15")
MOMENT = _DateOption(
    ["%Y-%m-%d", "%Y-%m-%dT%H:%M", "%Y-%m-%d %H:%M", "%Y-%m-%dT%H:%M:%S", "%Y-%m-%d %H:%M:%S"],
    "a day or a time, written as 2026-01-15 or 2026-01-15T07:30",
)
