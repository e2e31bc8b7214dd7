"""`probewatch simulate`: devices that exist only as bytes; each command lives in `tools/simulate_<name>.py`."""

import importlib

import click

_DEVICES = {
    "cart": "scanner, tracker and relay board together, and the configuration that fits them",
    "log": "an NDI tracker as it answered in a byte log",
    "ndi": "a Polaris or Aurora on a pseudo-terminal, a Vega on TCP",
    "optotrak": "an Optotrak behind an RTC3D server on TCP",
}


class _LazyGroup(click.Group):
    """Imports a device's module only when it is used."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted(_DEVICES)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _DEVICES:
            return None
        command = importlib.import_module(f"tools.simulate_{cmd_name}").command
        assert isinstance(command, click.Command)
        command.short_help = _DEVICES[cmd_name]
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Devices"):
            formatter.write_dl(sorted(_DEVICES.items()))


@click.group("simulate", cls=_LazyGroup)
def command() -> None:
    """Simulate a tracker at its own protocol, or a whole cart, with faults at run time."""
