"""The name by which a client calls a server of ours: another site's page can reach it only by a name of its own."""

import ipaddress
import re

_HOST = re.compile(r"(?:\[([0-9a-f:.]+)\]|([^\s\[\]:/@]+))(?::[0-9]{1,5})?")


def called(header: str) -> str:
    """Name or address in a Host header, in lower case, without port and brackets; empty where it is none."""
    found = _HOST.fullmatch(header.lower())
    return "" if found is None else found[1] or found[2]


def is_address(name: str) -> bool:
    """A number, which no name service can point elsewhere."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def endpoint_text(host: str, port: int) -> str:
    """host:port as people write it, an address of IPv6 in brackets."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
