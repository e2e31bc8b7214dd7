"""Reads the address of an MQTT broker, the account, and what TLS needs."""

import re
import ssl
import stat
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.regular_file import reading
from probewatch.drivers.printable import printable

_PORTS = {"mqtt": 1883, "mqtts": 8883}  # registered with IANA
_OTHERS = stat.S_IROTH | stat.S_IWOTH
_SECRET = re.compile(r"//[^/]*@")  # User and password in a URL.
_LOCAL = ("localhost", "127.0.0.1", "::1")
"""Names of this computer, to which a password may be sent without encryption."""


@dataclass(frozen=True, slots=True)
class Broker:
    """Holds the address of the broker, and the account. tls: None without encryption. password: None without one."""

    host: str
    port: int
    tls: ssl.SSLContext | None = None
    user: str | None = None
    password: str | None = None


def broker_of(
    url: str, user: str | None, password_file: Path | None, ca: Path | None, certificate: Path | None, key: Path | None
) -> Broker:
    """Parses mqtt://HOST[:PORT] or mqtts://HOST[:PORT]. Raises ConfigurationError, also for a password in the clear."""
    try:
        parts = urlsplit(url)
        port = parts.port or _PORTS.get(parts.scheme)
    except ValueError:
        parts, port = urlsplit(""), None
    bare = parts.scheme in _PORTS and parts.username is None and not parts.path.strip("/")
    if port is None or not parts.hostname or not bare:
        remedy = "Such as mqtts://broker.example or mqtt://127.0.0.1:1883; who logs in is --user and --password-file"
        raise ConfigurationError("is not the address of a broker", printable(_SECRET.sub("//***@", url)), remedy)
    secure = parts.scheme == "mqtts"
    if not secure and password_file is not None and parts.hostname not in _LOCAL:
        what = "everybody on the network could read the password"
        raise ConfigurationError(what, printable(url), "Use mqtts://, or a broker on this computer")
    if not secure and (ca or certificate or key):
        raise ConfigurationError("does not use the certificates that are named", printable(url), "Use mqtts://")
    if key is not None and certificate is None:
        raise ConfigurationError("a key without its certificate is never used", str(key), "Give --certificate as well")
    if password_file is not None and user is None:
        raise ConfigurationError("a password without a user is never sent", str(password_file), "Give --user as well")
    password = None if password_file is None else _password(password_file)
    return Broker(parts.hostname, port, _tls(ca, certificate, key) if secure else None, user, password)


def _password(file: Path) -> str:
    try:
        if file.stat().st_mode & _OTHERS:
            raise ConfigurationError("everybody may read the password", str(file), f"chmod o= {file}")
        password = file.read_text().split("\n")[0]
    except OSError as error:
        raise _unread(file, error) from None
    except UnicodeDecodeError:
        raise ConfigurationError("is not text", str(file), "Write the password into its first line") from None
    if not password:
        raise ConfigurationError("holds no password", str(file), "Write the password into its first line")
    return password


def _unread(file: Path, error: OSError) -> ConfigurationError:
    return ConfigurationError(f"cannot be read ({error.strerror})", str(file), "Check the path and its permissions")


def _refuse_unread(file: Path) -> None:
    """Raises ConfigurationError that names the one file, which OpenSSL does not."""
    try:
        with reading(file):
            pass
    except OSError as error:
        raise _unread(file, error) from None


def _tls(ca: Path | None, certificate: Path | None, key: Path | None) -> ssl.SSLContext:
    """Returns TLS for a broker whose name its certificate must bear. ca: None for the system's authorities."""
    named = [file for file in (ca, certificate, key) if file is not None]
    for file in named:
        _refuse_unread(file)
    where = ", ".join(map(str, named))
    try:
        context = ssl.create_default_context(cafile=None if ca is None else str(ca))
        if certificate is not None:
            context.load_cert_chain(certificate, key)
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"cannot be used ({error})", where, "Check the files; PEM is expected") from None
    return context
