"""`probewatch fleet`: lists the carts that need attention, from the Prometheus that monitors them."""

import re
import sys

import click
from rich.console import Console

from probewatch.tools.monitoring.fleet import CartReport, reports
from probewatch.tools.shared.json_report import json_of, json_option
from probewatch.tools.shared.tables import NOTHING, FittingTable

_HEADINGS = ("cart", "needs", "state", "contact", "verified ago", "nearest limit", "due in", "reference", "version")
_SPAN = re.compile(r"[1-9][0-9]{0,5}[smhd]", re.ASCII)


def _span(_context: click.Context, _option: click.Parameter, text: str) -> str:
    if not _SPAN.fullmatch(text):
        raise click.BadParameter("is not a time span such as 30m, 1h or 7d")
    return text


def _job(_context: click.Context, _option: click.Parameter, text: str) -> str:
    if not re.fullmatch(r"[\w.:/-]+", text, re.ASCII):
        raise click.BadParameter("is not a job name")
    return text


@click.command()
@click.option("--prometheus", default="http://127.0.0.1:9090", show_default=True, help="its URL")
@click.option("--job", default="probewatch", show_default=True, callback=_job, help="under which it scrapes the carts")
@click.option("--over", default="30m", show_default=True, callback=_span, help="span of the mean that shows a drift")
@json_option
def command(prometheus: str, job: str, over: str, as_json: bool) -> None:
    """One table of all carts: which are unreachable, unverified, near a limit, or due for a check.

    It asks a Prometheus that scrapes `probewatch metrics` (docs/monitoring.md), not the carts: what
    it shows of a cart is as old as the last scrape. A parameter drifts once its mean is beyond 70 % of its limit; a
    reference is due when its term ends within two weeks.

    \b
    Example:
      probewatch fleet --prometheus http://prometheus:9090

    \b
    Exit code 0: no cart needs attention. 1: some do. 69: no Prometheus answers. 78: the argument is not a URL.
    """
    carts = reports(prometheus, job, over)
    if as_json:
        click.echo(json_of([cart.fields() for cart in carts]))
    elif carts:
        styles = ["yellow" if cart.needs else "" for cart in carts]
        table = FittingTable(_HEADINGS, [_row(cart) for cart in carts], styles)
        Console(file=sys.stdout, highlight=False).print(table, crop=False)
    else:
        click.echo(f"{prometheus} knows no cart; does it scrape them under job_name: {job}?", err=True)
    sys.exit(1 if not carts or any(cart.needs for cart in carts) else 0)


def _row(cart: CartReport) -> tuple[str, ...]:
    return (
        cart.cart,
        ", ".join(cart.needs) or "nobody",
        cart.state or NOTHING,
        NOTHING if cart.closed is None else "closed" if cart.closed else "OPEN",
        NOTHING if cart.age_s is None else f"{cart.age_s:.0f} s",
        NOTHING if cart.drift is None else f"{cart.drift:.0%} {cart.drifting}",
        NOTHING if cart.due_s is None else f"{cart.due_s / 86400:.0f} d",
        cart.reference or NOTHING,
        cart.version or NOTHING,
    )
