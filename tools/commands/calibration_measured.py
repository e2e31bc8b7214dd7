"""`probewatch calibration measured`: reports the calibration that motion has measured over all examinations."""

import sys
from pathlib import Path

import click
from rich.console import Console

from probewatch.appliance.storage.calibration_file import check_own_name, write_calibration
from probewatch.appliance.storage.reference import candidate_of_entry
from probewatch.drivers.files.atomic_file import check_new
from probewatch.tools.german.translation import recognised, told
from probewatch.tools.shared.alarm_history import references_in, settled_log, tell_damage
from probewatch.tools.shared.json_report import json_of, json_option
from probewatch.tools.shared.motion_measured import HEADINGS, fields_of, in_vivo, measured, row_of
from probewatch.tools.shared.named_cart import cart_language, folder_option
from probewatch.tools.shared.tables import FittingTable


@click.command(name="measured", short_help="the calibration that motion has measured over all examinations")
@click.argument("number", type=click.IntRange(1), required=False)
@folder_option
@click.option("--output", type=click.Path(path_type=Path), help="write that calibration, .toml")
@json_option
def command(number: int | None, folder: Path, output: Path | None, as_json: bool) -> None:
    """What all verified motion has measured of reference NUMBER, or of the one in force, as a change from it.

    While the calibration is verified the service notes every five minutes what motion showed, in its alarm log. Of one
    examination the estimates share what the model leaves out; of many this averages out as well, as far as they agree.
    So the ± falls with each examination. An error that all of them share, such as a tracker that is off by place
    wherever this cart stands, is not in it. "calibrated to" is what the reference states of itself, such as by its
    cross-wire; "apart" sets the difference against both.

    --output writes the reference with all that. Nothing is applied: compare it (`diff`); `use` gives it to the service.

    \b
    Examples:
      probewatch calibration measured
      probewatch calibration measured 2 --output in-vivo.toml

    Exit code 0: told. 3: there is no estimate yet. 65: the alarm log is damaged; what it still holds is told. 78: the
    folder, the history or the reference cannot be read, or --output cannot be written.
    """
    if output is not None:
        check_own_name(output)
        check_new(output)
    reading, history, language = settled_log(folder), references_in(folder), cart_language()
    entry = history.entry(len(history.entries) if number is None else number)
    reference, found = candidate_of_entry(folder, entry).calibration, measured(reading.entries, entry.number)
    if as_json:
        click.echo(
            json_of({"reference": entry.number, "parameters": [fields_of(*one, reference) for one in found.items()]})
        )
    elif found:
        rows = [row_of(*one, reference, language) for one in found.items()]
        headings = [recognised(heading, language) for heading in HEADINGS]
        Console(highlight=False).print(FittingTable(headings, rows, right_from=1), crop=False)
    else:
        none = "no estimate of reference {number} yet: the service notes one in five minutes while verified"
        click.echo(told(none, language, number=entry.number))
    if output is not None:
        made = {"made_by": "probewatch calibration measured", "from": f"reference {entry.number}, {entry.sha256}"}
        write_calibration(output, in_vivo(found, reference), made)
        click.echo(told("written: {file}", language, file=output), err=as_json)
    tell_damage(reading)
    sys.exit(65 if reading.broken else 0 if found else 3)
