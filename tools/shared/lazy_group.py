"""Provides a group of commands whose modules are imported only when one of them is used, so that `--help` is quick."""

import importlib
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import click

from probewatch.drivers.errors import ProbewatchError
from probewatch.drivers.suggestion import did_you_mean, suggested


class LazyGroup(click.Group):
    """Imports the module of a command when the command is used. `names` maps each command to its summary, `prefix`
    names the package whose modules define `command`, `heading` is the title of the list.
    """

    def __init__(self, *args: Any, names: Mapping[str, str], prefix: str, heading: str, **kwargs: Any) -> None:
        self._names, self._prefix, self._heading = names, prefix, heading
        super().__init__(*args, **kwargs)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted(self._names)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self._names:
            return None
        command = importlib.import_module(f"{self._prefix}{cmd_name.replace('-', '_')}").command
        assert isinstance(command, click.Command)
        command.short_help = self._names[cmd_name]
        _let_readers_tell(command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Returns the command that the words name, with the words after it. Raises UsageError for an unknown one, with
        the most similar command.
        """
        if args and not args[0].startswith("-") and args[0] not in self._names:
            meant = did_you_mean(suggested(args[0], self._names)) or f"Use one of {', '.join(sorted(self._names))}."
            ctx.fail(f"No such command '{args[0]}'. {meant}")
        name, command, rest = super().resolve_command(ctx, args)
        _refuse_swallowed(ctx, command, rest)
        return name, command, rest

    def invoke(self, ctx: click.Context) -> Any:
        """Runs the command; its refusals are in the language of its cart, as far as they have a translation."""
        try:
            return super().invoke(ctx)
        except ProbewatchError as error:
            rooms = ("probewatch.tools.shared.named_cart", "probewatch.tools.german.translation")
            named_cart, translation = map(importlib.import_module, rooms)
            translation.tell_refused(error, named_cart.cart_language())
            raise

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section(self._heading):
            formatter.write_dl(sorted(self._names.items()))


def _let_readers_tell(command: click.Command) -> None:
    """Switches off click's own check whether a file may be read: it prints "is not readable" with the usage and without
    a remedy, while the code that reads or replaces the file reports the reason and what to do.
    """
    for parameter in command.params:
        if isinstance(parameter.type, click.Path):
            parameter.type.readable = False
    for below in command.commands.values() if isinstance(command, click.Group) else ():
        if below is not command:
            _let_readers_tell(below)


def _refuse_swallowed(ctx: click.Context, command: click.Command | None, words: list[str]) -> None:
    """Raises UsageError for an option that would take the next option as its value: `pause --off --on` once switched
    the sound off, with the reason "--on".
    """
    if isinstance(command, click.Group):
        within = next((at for at, word in enumerate(words) if word in command.commands), None)
        if within is not None:
            _refuse_swallowed(ctx, command.commands[words[within]], words[within + 1 :])
        return
    options = [one for one in ([] if command is None else command.params) if isinstance(one, click.Option)]
    taking = {word for one in options if not one.is_flag and not one.count for word in one.opts}
    known = {word for one in options for word in one.opts} | set(ctx.help_option_names)
    for word, following in pairwise(words):
        if word == "--":
            return
        if word in taking and following in known:
            ctx.fail(f"Option '{word}' needs a value, and '{following}' is an option. As its text: {word}={following}")
