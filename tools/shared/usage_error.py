"""Shows why a command line was refused, in the language of the cart that it means."""

import os
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import click

from probewatch.tools.german.usage import usage_text
from probewatch.tools.shared.bare_option import with_what_it_takes
from probewatch.tools.shared.named_cart import CONFIG, ENVIRONMENT, language_in

_WITH_FILE = ("check", "configure")
"""Commands whose argument is a configuration."""


def show_usage_error(error: click.ClickException, group: click.Group, words: Sequence[str]) -> None:
    """Prints the error on standard error, all of it in English where a part of it has no German translation. words:
    those of the command line, from the group's first on.
    """
    whole = with_what_it_takes(error, group, words) if isinstance(error, click.BadOptionUsage) else error
    help_alone = isinstance(error, click.exceptions.NoArgsIsHelpError)
    if help_alone or not isinstance(error, click.UsageError) or language_in(_named(words)) == "en":
        whole.show()
        return
    said = usage_text(whole.format_message()) or usage_text(error.format_message())
    if said is None:
        whole.show()
        return
    context = error.ctx
    if context is not None:
        usage = context.get_usage().replace("Usage:", "Aufruf:", 1)
        click.echo(f"{usage}\nHilfe: {context.command_path} --help\n", err=True)
    click.echo(f"Fehler: {said}", err=True)


def _named(words: Sequence[str]) -> Path:
    """Returns the configuration of the cart that the words mean, though none of them was parsed."""
    after = [*pairwise(words)] if words[:1] and words[0] in _WITH_FILE else []
    typed = [word for before, word in after if word.endswith(".toml") and not before.startswith("--")]
    typed += [following for word, following in pairwise(words) if word == "--config"]
    typed += [word.removeprefix("--config=") for word in words if word.startswith("--config=")]
    return Path(typed[-1] if typed else os.environ.get(ENVIRONMENT) or CONFIG)
