"""Reads the host name by which a client addresses a server. A page of another site can reach the server only under a
different name.
"""

import ipaddress
import re

import click

_HOST = re.compile(r"(?:\[([0-9a-f:.]+)\]|([^\s\[\]:/@]+))(?::[0-9]{1,5})?")


def called(header: str) -> str:
    """Returns name or address of a Host header, in lower case, without port and brackets; empty if it is invalid."""
    found = _HOST.fullmatch(header.lower())
    return "" if found is None else found[1] or found[2]


def host_names(_context: click.Context, _option: click.Parameter, names: tuple[str, ...]) -> tuple[str, ...]:
    """Returns the names of an option in lower case. Raises click.BadParameter for what no Host header can name."""
    for name in names:
        if not name or called(name) != name.lower():
            raise click.BadParameter(f"'{name}' is not a host name: give it alone, without https://, port and path")
    return tuple(name.lower() for name in names)


def is_address(name: str) -> bool:
    """Returns whether the name is a numeric address, which no name service can redirect."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def endpoint_text(host: str, port: int) -> str:
    """Returns host:port as text, with an IPv6 address in brackets."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
