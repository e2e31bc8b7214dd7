"""The `probewatch` command: finds the subcommand, and turns every known refusal into one line and an exit code."""

import importlib
import os
import sys

import click

from drivers.errors import EXHAUSTED, ProbewatchError
from tools.terminal import guard_terminal

_COMMANDS = {
    "ack": "acknowledge the alarm",
    "demo": "a simulated cart with injected faults, from bytes to alarm",
    "devices": "what is connected to this host, and whether it can be opened",
    "lamp-test": "light every lamp and sound the tone for five seconds",
    "log": "read, filter and verify the alarm log; export it as CSV",
    "pause": "pause the alarm sound, switch it off with a reason, or on again",
    "probe": "connect to a tracker, video source or output and say how well it does",
    "recalibrate": "scan a cross-wire, solve ζ, write a new calibration",
    "release": "de-energise every alarm output, for a service that has ended",
    "replay": "run a recording through the line and print a report",
    "run": "the service: watch the devices named in the configuration",
    "simulate": "a tracker that exists only as bytes, with faults at run time",
    "status": "what the service sees now; --watch keeps it on the screen",
}

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class _LazyGroup(click.Group):
    """Imports a subcommand's module, `tools.<name>`, only when it is used, so `--help` is quick."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _COMMANDS:
            return None
        command = importlib.import_module(f"tools.{cmd_name.replace('-', '_')}").command
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(sorted(_COMMANDS.items()))


@click.group(cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="probewatch")
def probewatch() -> None:
    """Watch, live and without a phantom, whether a tracked ultrasound probe is still calibrated.

    Not a certified medical device.
    """


def main() -> None:
    """Entry point of the console script.

    The matrices are small: more than one BLAS thread costs several times the processor time and gains nothing. It must
    be said before NumPy is imported.
    """
    for name in _THREADS:
        os.environ.setdefault(name, "1")
    guard_terminal()
    try:
        sys.exit(probewatch.main(standalone_mode=False))
    except ProbewatchError as error:
        click.echo(f"probewatch: {error}", err=True)
        sys.exit(error.exit_code)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except OSError as error:
        if error.errno not in EXHAUSTED:
            raise
        click.echo(f"probewatch: this computer has no room for it ({error.strerror}); see what else runs", err=True)
        sys.exit(os.EX_OSERR)
    except click.Abort:
        click.echo("probewatch: stopped", err=True)
        sys.exit(130)
