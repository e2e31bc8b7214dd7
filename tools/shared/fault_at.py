"""FAULT@SECONDS, as a command is given it."""

import math

import click

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.twins.faults import CART_FAULTS, refuse_unknown_fault


def fault_at(text: str) -> tuple[str, float | None]:
    """Returns the fault of a simulated cart and its time, s: None where there is none, NaN for what is no number.

    Raises BadParameter for an unknown fault.
    """
    fault, at, seconds = text.partition("@")
    try:
        refuse_unknown_fault(fault, CART_FAULTS, "")
    except ConfigurationError as error:
        raise click.BadParameter(error.advice) from None
    try:
        return fault, float(seconds) if at else None
    except ValueError:
        return fault, math.nan
