"""Parses FAULT@SECONDS, the form in which a command takes a fault."""

import math

import click

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.twins.faults import CART_FAULTS, refuse_unknown_fault


def fault_at(text: str) -> tuple[str, float | None]:
    """Returns the fault of a simulated cart and its time, s: None where none is given, NaN where it is not a number.

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
