"""Provides the types of options that take a day or a time."""

from datetime import datetime
from typing import Any

import click


class _DateOption(click.DateTime):
    """Represents a date option whose error messages and help are in plain words, not in format codes as click's are."""

    def __init__(self, formats: list[str], form: str, what: str) -> None:
        super().__init__(formats)
        self._form, self._what = form, what

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """Returns the form in which the date is written."""
        return self._form

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> datetime:
        """Returns the day or time that was typed. Raises click.BadParameter for anything else."""
        try:
            moment: datetime = super().convert(value, param, ctx)
        except click.BadParameter:
            self.fail(f"'{value}' is not {self._what}", param, ctx)
        return moment


DAY = _DateOption(["%Y-%m-%d"], "YYYY-MM-DD", "a day of the calendar, written as 2026-01-15")
MOMENT = _DateOption(
    ["%Y-%m-%d", "%Y-%m-%dT%H:%M", "%Y-%m-%d %H:%M", "%Y-%m-%dT%H:%M:%S", "%Y-%m-%d %H:%M:%S"],
    "YYYY-MM-DD[THH:MM]",
    "a day or a time, written as 2026-01-15 or 2026-01-15T07:30",
)
