"""Runs the `probewatch` command: finds the subcommand, and turns every known refusal into one line and an exit code."""

import errno
import importlib
import os
import sys

import click

from probewatch.drivers.errors import EXHAUSTED, ConfigurationError, ProbewatchError
from probewatch.tools.shared.lazy_group import LazyGroup
from probewatch.tools.shared.plain_text import speak_plainly
from probewatch.tools.shared.terminal import guard_terminal

_REFUSED = {
    **dict.fromkeys((errno.EACCES, errno.EPERM), "Check its permissions and those of its folder, or be its owner"),
    errno.EROFS: "Name a file on a disk that may be written to",
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT), "Make room on its disk, or name a file on another one"),
    **dict.fromkeys((errno.EIO, errno.ESTALE), "Check its disk or its network"),
    **dict.fromkeys((errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR), "Check the path"),
}
"""What the system answers about a file where a command did not expect it → what to do."""
_COMMANDS = {
    "ack": "acknowledge the alarm",
    "calibration": "the reference in force and its history; compare, go back",
    "check": "check a configuration and its calibration, and start nothing",
    "configure": "write the configuration of this cart, without an editor",
    "demo": "a simulated cart with injected faults, from bytes to alarm",
    "devices": "what is connected to this host, and whether it can be opened",
    "export": "a black box as .igs.mha or .igs.nrrd, table or film, for other programs",
    "fleet": "which carts need attention, as Prometheus sees them",
    "lamp-test": "light every lamp and sound the tone for five seconds",
    "latency": "how late the tracker is against the pictures, from a recording",
    "log": "read, filter and verify the alarm log; export it as CSV",
    "metrics": "serve the status to Prometheus, over HTTP or as a file of node_exporter",
    "mqtt": "publish the state to an MQTT broker, for Home Assistant and others",
    "noise": "derive the threshold for naming a FAULT from healthy scanning of this cart",
    "openigtlink": "send the service's data to OpenIGTLink clients, such as 3D Slicer",
    "page": "serve the web page of the cart: status for the room, live recalibration",
    "pause": "pause the alarm sound, switch it off with a reason, or on again",
    "probe": "connect to a tracker, video source or output and measure its quality",
    "recalibrate": "scan a cross-wire: ζ or a whole calibration, checked and signed",
    "record": "write black boxes of what the service sees; mark what to keep",
    "release": "de-energise every alarm output, for a service that has ended",
    "reload": "make the running service read its changed configuration",
    "replay": "run a recording through the pipeline and print a report",
    "report": "what this cart did in a day, week or month, as a page to file",
    "run": "the service: watch the devices named in the configuration",
    "self-test": "before the clinic opens: devices, rates, noise, outputs, disk; green or red",
    "simulate": "simulated trackers, a scanner or a whole cart, with faults at run time",
    "trend": "how the calibration has drifted over days, from the alarm log",
    "study": "measure the instrument: simulated sessions with known truth, or an archive",
    "status": "what the service sees now; --watch keeps it on the screen",
}

CORE_UNUSABLE = "the compiled core "
"""Beginning of the error of a core that cannot be loaded; no module of it is imported before a command needs it."""

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@click.group(
    cls=LazyGroup,
    names=_COMMANDS,
    prefix="probewatch.tools.commands.",
    heading="Commands",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
    short_help="watches whether a tracked ultrasound probe is still calibrated",
)
@click.version_option(package_name="probewatch")
def probewatch() -> None:
    """Watch, live and without a phantom, whether a tracked ultrasound probe is still calibrated.

    Not a certified medical device.
    """


def main() -> None:
    """Runs the command, as the entry point of the console script.

    The matrices are small: more than one BLAS thread costs several times the processor time and gains nothing. The
    limit must be set before NumPy is imported.
    """
    for name in _THREADS:
        os.environ.setdefault(name, "1")
    speak_plainly()
    guard_terminal()
    try:
        sys.exit(probewatch.main(standalone_mode=False))
    except ProbewatchError as error:
        click.echo(f"probewatch: {error}", err=True)
        sys.exit(error.exit_code)
    except click.ClickException as error:
        usage_error = importlib.import_module(
            "probewatch.tools.shared.usage_error"
        )  # which no valid command line needs
        usage_error.show_usage_error(error, probewatch, sys.argv[1:])
        sys.exit(error.exit_code)
    except OSError as error:
        _end_refused(error)
    except ImportError as error:
        if not str(error).startswith(CORE_UNUSABLE):
            raise
        click.echo(f"probewatch: {error}", err=True)
        sys.exit(os.EX_SOFTWARE)
    except click.Abort as error:
        word = getattr(error, "word", "stopped")  # set by tools.shared.interruption.Stopped
        click.echo(f"probewatch: {': '.join([word, *map(str, error.args)])}", err=True)
        sys.exit(130)


def _end_refused(error: OSError) -> None:
    """Ends with one line for what the system refuses; re-raises any other error, which is a defect of a command."""
    if error.errno in EXHAUSTED:
        click.echo(f"probewatch: this computer has no room for it ({error.strerror}); see what else runs", err=True)
        sys.exit(os.EX_OSERR)
    if error.errno not in _REFUSED or error.filename is None:
        raise error
    told = ConfigurationError(str(error.strerror), str(error.filename), _REFUSED[error.errno])
    click.echo(f"probewatch: {told}", err=True)
    sys.exit(told.exit_code)
