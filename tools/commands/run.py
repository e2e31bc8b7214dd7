"""`probewatch run`: runs the service."""

import time
from contextlib import closing
from pathlib import Path

import click

from probewatch.appliance.configuration.config import Config, is_configured, load_config
from probewatch.appliance.service.control.references import References
from probewatch.appliance.service.control.refusal import leave, withdraw
from probewatch.appliance.service.control.rights import Onlookers
from probewatch.appliance.service.control.server import ControlServer
from probewatch.appliance.service.control.starting import how_to_restart
from probewatch.appliance.service.daemon import Daemon
from probewatch.appliance.service.estimator.process_host import EstimatorHost
from probewatch.appliance.service.host.log import configure
from probewatch.appliance.service.host.resident_memory import keep_what_is_loaded, lock_memory
from probewatch.appliance.service.unconfigured import await_configuration
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.shared.named_cart import required_config
from probewatch.tools.shared.termination import termination


@click.command()
@required_config("the configuration, such as config/probewatch.toml")
@click.option("--clock-rate", default=1.0, type=click.FloatRange(0.01, 100), hidden=True)
@click.option("--clock-origin-ns", type=int, hidden=True)
def command(config_file: Path, clock_rate: float, clock_origin_ns: int | None) -> None:
    """Watch the devices named in the configuration until SIGTERM; the log is JSON lines on stderr.

    \b
    Example:
      probewatch run --config cart.toml
    """
    clock = HostClock(clock_rate, time.monotonic_ns() if clock_origin_ns is None else clock_origin_ns)
    try:
        _run(config_file, clock, slowness=max(1.0, 1 / clock_rate))
    except ConfigurationError as error:
        remedy = f"{error.remedy}; then {how_to_restart(config_file)}"
        leave(config_file, ConfigurationError(error.what, error.where, remedy))
        raise


def _run(config_file: Path, clock: HostClock, slowness: float) -> None:
    if not is_configured(config_file):
        _await_configuration(config_file)
        return
    config = load_config(config_file)
    references, stale_ns = References(config), config.supervisor.timeouts().stale_ns
    with closing(EstimatorHost(None, config.limits, stale_ns, slowness=slowness)) as estimator:
        serve(config, config_file, references, estimator, clock)


def _await_configuration(config_file: Path) -> None:
    stop = termination()
    with configure("info"):
        await_configuration(config_file, stop)


def serve(
    config: Config, config_file: Path, references: References, estimator: EstimatorHost, clock: HostClock
) -> None:
    """Runs the service until it is stopped. Raises DeviceLost when another one holds the control socket."""
    lock_memory()
    with (
        ControlServer(config.control.socket, config.control.group, Onlookers.of(config).all) as control,
        configure(config.log.level),
        Daemon(config, config_file, references, estimator, clock, control) as daemon,
    ):
        withdraw(config.control.socket)
        keep_what_is_loaded()
        daemon.run()
