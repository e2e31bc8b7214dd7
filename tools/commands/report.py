"""`probewatch report`: what a cart did in a day, week or month, as one page to look at and to file."""

import platform
import shutil
import subprocess
from datetime import UTC, datetime
from pathlib import Path

import click

from appliance.configuration.config import load_config
from appliance.storage.reference_dates import dates_of
from appliance.storage.reference_store import content_of, read_history
from drivers.errors import ConfigurationError
from drivers.files.atomic_file import check_writable
from tools.report.pdf import check_pdf, write_pdf
from tools.report.period import PERIODS, last_period, period, read_self_tests, summary
from tools.report.period_page import write_period_page
from tools.shared.alarm_history import settled_log
from tools.shared.named_cart import cart_option

_SELF_TESTS = "self-tests"
_NAMESPACE = "probewatch-report"
_PATIENCE_S = 20
"""For ssh-keygen to sign with a key of a file, s; one that asks a person or a card is not for a timer."""


@click.command()
@cart_option
@click.option("--period", "kind", type=click.Choice(PERIODS), default="month", show_default=True)
@click.option("--of", "day", type=click.DateTime(["%Y-%m-%d"]), help="a day in the period, UTC [the last one over]")
@click.option(
    "--folder",
    default=Path(),
    type=click.Path(path_type=Path, file_okay=False),
    help="where the report is written, named by cart and period [here]",
)
@click.option("--pdf", "as_pdf", is_flag=True, help="as PDF too, by chromium where that is installed")
@click.option("--sign", "key", type=click.Path(path_type=Path), help="SSH key: a signature beside each file")
def command(config_file: Path, kind: str, day: datetime | None, folder: Path, as_pdf: bool, key: Path | None) -> None:
    """Write one page of what this cart did: how much of the time its calibration was verified, alarms, trends,
    calibrations, self-tests and versions, from its alarm log and its store. It is sent nowhere.

    \b
    Examples:
      probewatch report
      probewatch report --period week --of 2026-01-15 --pdf
      probewatch report --sign /etc/probewatch/report-key

    The unit probewatch-report.timer writes one for each month. A signature is checked with
      ssh-keygen -Y verify -f allowed_signers -I CART -n probewatch-report -s FILE.sig < FILE
    """
    config = load_config(config_file)
    now = datetime.now(UTC)
    wanted = last_period(kind, now) if day is None else period(kind, day.replace(tzinfo=UTC))
    cart = platform.node() or "cart"
    page = folder / f"{cart}-{wanted.name}.html"
    pdf = page.with_suffix(".pdf") if as_pdf else None
    check_writable(page)
    check_pdf(pdf)
    if key is not None:
        _check_key(key)
    reading = settled_log(config.alarm.folder)
    tests, damaged = read_self_tests(config.alarm.folder / _SELF_TESTS)
    history = read_history(config.alarm.folder)
    in_force = None if history is None else history.in_force
    due = None
    if in_force is not None:
        content = content_of(config.alarm.folder, in_force)
        due = dates_of(in_force, content, config.calibration.due_days).due_utc
    found = summary(wanted, reading, tests, now, () if history is None else history.entries)
    write_period_page(page, cart, found, due, damaged)
    if pdf is not None:
        write_pdf(page, pdf)
    for file in (page, *([] if pdf is None else [pdf])):
        signed = f", signed {file.name}.sig" if key is not None and _sign(file, key) else ""
        click.echo(f"written: {file}{signed}")


def _check_key(key: Path) -> None:
    if shutil.which("ssh-keygen") is None:
        raise ConfigurationError("needs the program ssh-keygen", str(key), "Install it: apt install openssh-client")
    if not key.is_file():
        raise ConfigurationError("there is no such key", str(key), "Make one: ssh-keygen -t ed25519 -N '' -f KEY")


def _sign(file: Path, key: Path) -> bool:
    """Raises ConfigurationError where the key cannot sign."""
    file.with_name(f"{file.name}.sig").unlink(missing_ok=True)
    command = ["ssh-keygen", "-Y", "sign", "-f", str(key), "-n", _NAMESPACE, str(file)]
    try:
        subprocess.run(command, check=True, capture_output=True, stdin=subprocess.DEVNULL, timeout=_PATIENCE_S)
    except subprocess.SubprocessError as error:
        said = (getattr(error, "stderr", None) or b"").decode(errors="replace").strip()
        remedy = "Give a key without a passphrase that this user may read"
        raise ConfigurationError(f"cannot sign ({said or type(error).__name__})", str(key), remedy) from None
    return True
