"""What the package says about itself, made from the commands: man pages and shell completion.

Run by the Python that has probewatch installed beside click-man, whatever the package's own Python will be.
"""

import re
import tempfile
from pathlib import Path

import click
from click.shell_completion import get_completion_class
from click_man.core import write_man_pages

from probewatch.tools.cli import probewatch

NAME = "probewatch"
FILES_AND_EXIT_STATUS = Path(__file__).with_name("files.man")
COMPLETIONS = {
    "bash": f"usr/share/bash-completion/completions/{NAME}",
    "zsh": f"usr/share/zsh/vendor-completions/_{NAME}",
    "fish": f"usr/share/fish/vendor_completions.d/{NAME}.fish",
}
"""Shell → where Debian's own looks for it."""


def man_pages(version: str, date: str) -> dict[str, str]:
    """Name of the file → its text, one for probewatch and one for every command and subcommand."""
    with tempfile.TemporaryDirectory() as folder:
        write_man_pages(NAME, _whole(probewatch, NAME), version=version, date=date, target_dir=folder)
        pages = {file.name: _formatted(file.read_text()) for file in sorted(Path(folder).iterdir())}
    pages[f"{NAME}.1"] += FILES_AND_EXIT_STATUS.read_text()
    return pages


def completions() -> dict[str, str]:
    """Path in the package → script."""
    scripts = {}
    for shell, target in COMPLETIONS.items():
        kind = get_completion_class(shell)
        assert kind is not None
        scripts[target] = kind(probewatch, {}, NAME, f"_{NAME.upper()}_COMPLETE").source()
    return scripts


def _whole(command: click.Command, name: str, above: click.Context | None = None) -> click.Command:
    """Groups load a command when it is used; click-man sees only those that are there."""
    if isinstance(command, click.Group):
        context = click.Context(command, info_name=name, parent=above)
        for sub in command.list_commands(context):
            found = command.get_command(context, sub)
            assert found is not None
            command.commands[sub] = _whole(found, sub, context)
    return command


def _formatted(page: str) -> str:
    """click marks a paragraph whose lines stay as they are by a backspace; man calls that .nf … .fi."""
    kept = re.sub(r"\x08\n(.*?)(?=\n\.[A-Z]|\Z)", r".nf\n\1\n.fi", page, flags=re.S)
    return re.sub(r"(?m)^(['.])(?!(TH|SH|PP|TP|B|I|nf|fi)\b)", r"\\&\1", kept)
