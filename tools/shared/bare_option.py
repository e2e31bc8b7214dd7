"""Explains what an option takes to a person who gave it without a value."""

from collections.abc import Sequence

import click


def with_what_it_takes(error: click.BadOptionUsage, group: click.Group, words: Sequence[str]) -> click.BadOptionUsage:
    """Returns the same error, with the choices or the help of the option. `words`: those of the command line, from the
    group's first on, because click itself does not say to which command the option belongs.
    """
    option = _option(group, words, error.option_name)
    if option is None or option.is_flag:
        return error
    takes = (
        f"one of {', '.join(map(str, option.type.choices))}" if isinstance(option.type, click.Choice) else option.help
    )
    return click.BadOptionUsage(error.option_name, f"{error.message.rstrip('.')}: {takes}") if takes else error


def _option(group: click.Group, words: Sequence[str], name: str) -> click.Option | None:
    command: click.Command = group
    for word in words:
        if isinstance(command, click.Group):
            command = command.get_command(click.Context(command), word) or command
    found = (one for one in command.params if isinstance(one, click.Option) and name in one.opts)
    return next(found, None)
