"""Parses HOST:PORT, the value of an option --listen."""

from probewatch.drivers.errors import ConfigurationError

_MOST_PORT = 65535  # TCP


def listen_address(listen: str, usual: str) -> tuple[str, int]:
    """Returns (host, port). usual: the default HOST:PORT of the option, for the error. Raises ConfigurationError."""
    host, colon, port = listen.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not (host and colon and port.isascii() and port.isdecimal() and int(port) <= _MOST_PORT):
        remedy = f"Such as {usual} or [::1]:{usual.rpartition(':')[2]}"
        raise ConfigurationError("is not HOST:PORT", f"--listen {listen}", remedy)
    return host, int(port)
