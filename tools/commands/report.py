"""`probewatch report`: writes one page of what a cart did in a day, week or month."""

import platform
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import click

from probewatch.appliance.configuration.config import Config, load_config
from probewatch.appliance.service.control.client import is_running
from probewatch.appliance.service.control.rights import join_group
from probewatch.appliance.storage.alarm_chain import Entry
from probewatch.appliance.storage.reference_dates import Dates, dates_of
from probewatch.appliance.storage.reference_store import FOLDER as REFERENCES
from probewatch.appliance.storage.reference_store import HISTORY, History, content_of, read_history
from probewatch.appliance.storage.witnessed_log import named_reference
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.atomic_file import PAGE_BEGINS, check_replaceable
from probewatch.tools.german.translation import lost_text, told
from probewatch.tools.report.pdf import check_pdf, write_pdf
from probewatch.tools.report.period import PERIODS, Period, Summary, last_period, period, summary
from probewatch.tools.report.period_page import write_period_page
from probewatch.tools.selftest.records import read_self_tests
from probewatch.tools.shared.alarm_history import refuse_unreadable, settled_log
from probewatch.tools.shared.calendar_option import DAY
from probewatch.tools.shared.named_cart import cart_option

_SELF_TESTS = "self-tests"
_NAMESPACE = "probewatch-report"
_WRITTEN_S, _LOOK_S = 2.0, 0.1
"""Seconds for a running service to write what it has logged, and between two looks. That takes milliseconds on a disk
that is not busy (not measured on a slow one); longer would keep a person with a damaged store waiting."""
_TIMEOUT_S = 20
"""Seconds for ssh-keygen to sign with a key in a file; a key for which it must ask a person or a card is not for a
timer."""


@click.command()
@cart_option
@click.option("--period", "kind", type=click.Choice(PERIODS), default="month", show_default=True)
@click.option("--of", "day", type=DAY, help="a day in the period, UTC [the last one over]")
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

    Without --of it is of the last period that is over; one that is not over is told "so far", in its name too.

    The unit probewatch-report.timer writes one for each month. A signature is checked with
      ssh-keygen -Y verify -f allowed_signers -I CART -n probewatch-report -s FILE.sig < FILE

    \b
    Exit code 0: written. 65: written, but the alarm log, the store of references or a record of a self-test is damaged,
    which stands at the top of the report. 78: a file cannot be used.
    """
    config = load_config(config_file)
    now = datetime.now(UTC)
    wanted = last_period(kind, now) if day is None else period(kind, day.replace(tzinfo=UTC))
    _refuse_future(wanted, now)
    cart = platform.node() or "cart"
    page = folder / f"{cart}-{wanted.name}{'' if wanted.end <= now else '-so-far'}.html"
    pdf = page.with_suffix(".pdf") if as_pdf else None
    check_replaceable(page, PAGE_BEGINS)
    check_pdf(pdf)
    if key is not None:
        _check_key(key)
    reading = settled_log(config.alarm.folder)
    self_tests = read_self_tests(config.alarm.folder / _SELF_TESTS)
    _refuse_unreadable_store(config.alarm.folder / REFERENCES / HISTORY)
    history, store_fault = _settled_history(config, reading.entries)
    found = summary(wanted, reading, self_tests.kept, now, () if history is None else history.entries)
    found.store_fault = store_fault
    language = config.alarm.language
    chosen = _chosen(wanted, found, day is None, language)
    click.echo(chosen)
    for file in (page, *([] if pdf is None else [pdf])):
        # Signed before, what is written now would look forged.
        file.with_name(f"{file.name}.sig").unlink(missing_ok=True)
    write_period_page(page, cart, found, _dates(config, history), self_tests.faults, chosen, language)
    if pdf is not None:
        write_pdf(page, pdf)
    for file in (page, *([] if pdf is None else [pdf])):
        is_signed = key is not None and _sign(file, key)
        with_signature = "written: {file}, signed {signature}"
        text = with_signature if is_signed else "written: {file}"
        click.echo(told(text, language, file=file, signature=f"{file.name}.sig"))
    if pdf is None and page.with_suffix(".pdf").exists():
        earlier = "{file} is of an earlier report; --pdf writes it anew"
        click.secho(told(earlier, language, file=page.with_suffix(".pdf")), err=True, fg="yellow")
    if reading.broken:
        damaged = "the alarm log is damaged, as the top of the report says; see: probewatch log --verify"
        click.secho(told(damaged, language), err=True)
    if store_fault:
        damaged = "the store of references is damaged, as the top of the report says: {why}"
        click.secho(told(damaged, language, why=lost_text(store_fault, language)), err=True)
    if self_tests.faults:
        damaged = "a record of a self-test is damaged, as the top of the report says"
        click.secho(told(damaged, language), err=True)
    if reading.broken or store_fault or self_tests.faults:
        sys.exit(65)


def _refuse_future(wanted: Period, now: datetime) -> None:
    if wanted.start > now:
        what = f"the {wanted.kind} {wanted.name} has not begun: it is {now:%Y-%m-%d %H:%M} UTC by this computer's clock"
        raise click.BadParameter(f"{what}. Give a day that has been", param_hint="'--of'")


def _chosen(wanted: Period, found: Summary, by_itself: bool, language: str) -> str:
    """Returns a sentence that says which period the report covers, and why."""
    kind = told(wanted.kind, language)
    if not by_itself:
        over = "Report of the {kind} {name}, as asked for with --of"
        so_far = "Report of the {kind} {name}, which is not over, as asked for with --of"
        text = so_far if found.so_far else over
        return told(text, language, kind=kind, name=wanted.name)
    last = "Report of the last {kind} that is over, {name}, as no day was named with --of"
    chosen = told(last, language, kind=kind, name=wanted.name)
    if found.begins is not None and found.begins >= wanted.end:
        begins = "The alarm log begins after it, on {since}: --of {since} reports that {kind}"
        return f"{chosen}. {told(begins, language, since=f'{found.begins:%Y-%m-%d}', kind=kind)}"
    return chosen


def _refuse_unreadable_store(file: Path) -> None:
    """Raises ConfigurationError for a store that this user may not read: a filed report must not call it damaged."""
    try:
        refuse_unreadable(file)
    except PermissionError as error:
        raise ConfigurationError(f"cannot be read ({error.strerror})", str(file), join_group(file)) from None


def _settled_history(config: Config, entries: Sequence[Entry]) -> tuple[History | None, str]:
    """Returns what is known of the references, and why the rest is not; that is empty where all is known. A running
    service logs a reference before it writes it, so a store that lacks what the log names is read again before it is
    called damaged.
    """
    end_s = time.monotonic() + _WRITTEN_S
    while True:
        history, fault = _history(config)
        fault = fault or _lost(entries, history, config.alarm.folder)
        if not fault or time.monotonic() >= end_s or not is_running(config.control.socket):
            return history, fault
        time.sleep(_LOOK_S)


def _history(config: Config) -> tuple[History | None, str]:
    """Returns what is known of the references, and why the rest cannot be read. A damaged store raises no error here: a
    report is most needed then.
    """
    try:
        history = read_history(config.alarm.folder)
        _dates(config, history)
    except ConfigurationError as error:
        return None, str(error)
    return history, ""


def _lost(entries: Sequence[Entry], history: History | None, folder: Path) -> str:
    """Returns a sentence where the store lacks the reference that the log names last, as after its folder was removed;
    empty where it has it. Without this, a report would say that none was in force.
    """
    named = next((one for entry in reversed(entries) if (one := named_reference(entry)) is not None), None)
    held = set() if history is None else {(one.number, one.sha256) for one in history.entries}
    if named is None or named in held:
        return ""
    number, sha256 = named
    what = f"the alarm log names reference {number}, SHA-256 {sha256[:12]}…, which the store does not hold"
    return f"{folder / REFERENCES}: {what}. Restore the folder from a copy"


def _dates(config: Config, history: History | None) -> Dates | None:
    """Returns the dates of the calibration in force; None without one. Raises ConfigurationError."""
    if history is None or history.in_force is None:
        return None
    content = content_of(config.alarm.folder, history.in_force)
    return dates_of(history.in_force, history.entries, content, config.calibration.due_days)


def _check_key(key: Path) -> None:
    if shutil.which("ssh-keygen") is None:
        raise ConfigurationError("needs the program ssh-keygen", str(key), "Install it: apt install openssh-client")
    if not key.is_file():
        raise ConfigurationError("there is no such key", str(key), "Make one: ssh-keygen -t ed25519 -N '' -f KEY")


def _sign(file: Path, key: Path) -> bool:
    """Signs the file and returns True. Raises ConfigurationError where the key cannot sign."""
    command = ["ssh-keygen", "-Y", "sign", "-f", str(key), "-n", _NAMESPACE, str(file)]
    try:
        subprocess.run(command, check=True, capture_output=True, stdin=subprocess.DEVNULL, timeout=_TIMEOUT_S)
    except subprocess.SubprocessError as error:
        said = (getattr(error, "stderr", None) or b"").decode(errors="replace").strip()
        remedy = "Give a key without a passphrase that this user may read"
        raise ConfigurationError(f"cannot sign ({said or type(error).__name__})", str(key), remedy) from None
    return True
