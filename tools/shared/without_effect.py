"""Refuses options that were typed and would change nothing of what is done: a person believes what they typed."""

import click
from click.core import ParameterSource


def refuse_typed(options: tuple[str, ...], beside: str) -> None:
    """options: of this command, that have no effect beside that. Raises UsageError for one that was typed."""
    context = click.get_current_context()
    given = [one for one in context.command.params if isinstance(one, click.Option) and one.opts[0] in options]
    for one in given:
        if context.get_parameter_source(str(one.name)) is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"{one.opts[0]} has no effect with {beside}; leave it out")
