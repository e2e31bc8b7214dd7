"""Every command of the command line, below every group."""

from collections.abc import Iterator

import click

from probewatch.tools.cli import probewatch


def commands(
    group: click.Group = probewatch, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    """(its words, the command), groups as well."""
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        yield (*path, name), command
        if isinstance(command, click.Group):
            yield from commands(command, (*path, name))
