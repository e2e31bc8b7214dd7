"""Refuses options that would have no effect, because a user expects every option to have one."""

import click
from click.core import ParameterSource


def refuse_typed(options: tuple[str, ...], beside: str) -> None:
    """Raises UsageError for an option of the command line that has no effect with `beside`."""
    context = click.get_current_context()
    given = [one for one in context.command.params if isinstance(one, click.Option) and one.opts[0] in options]
    for one in given:
        if context.get_parameter_source(str(one.name)) is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"{one.opts[0]} has no effect with {beside}; leave it out")
