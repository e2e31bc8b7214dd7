"""The state of a cart on an MQTT broker: retained, with a last will, so that who comes later knows it, and who looks on
learns that nobody tells it any more.

Nothing is subscribed to, so a broker has nothing to say but short answers; one that says more is left, and so is one
that acknowledges nothing. A broker that vanishes is said once and tried again; the service knows nothing of it.
"""

import contextlib
import json
import socket
import ssl
import stat
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode

from appliance.service.control.status_fields import STATUS
from drivers.errors import ConfigurationError, system_words
from drivers.printable import printable
from tools.monitoring.exposition import Status, contact_closed
from tools.monitoring.home_assistant import discovery

_PORTS = {"mqtt": 1883, "mqtts": 8883}  # registered with IANA
_KEEPALIVE_S = 10
"""The broker publishes the last will after one and a half of it: how long a dead cart may look alive, against
traffic."""
_CONNECT_S = 5.0
"""For which a broker may take to accept. Longer finds a slow one, shorter is sooner at the next try. Not measured."""
_FIRST_WAIT_S, _LONGEST_WAIT_S = 1.0, 30.0
"""Before the next try, doubled each time until one has lasted for the longest: how late a broker that is back is
noticed, against knocking on its door."""
_LOOK_S = 1.0
"""Between two looks at the service. Shorter publishes a change sooner, and takes an answer of the service each time."""
_REPEAT_S = 15.0
"""After which the state is published again though it is the same, so that who looks on may call a silence one."""
_ACKNOWLEDGED_S = 10.0
"""For which a broker may take to acknowledge a message, as long as for a sign of life. One that never does may have
kept nothing; the library holds 20 of its messages and sends no more. Longer has a slow network succeed, shorter is told
sooner. Not measured."""
_GOODBYE_S = 2.0
"""For which the last message may take at the end."""
_LONGEST_ANSWER = 2
"""Bytes of a packet after its length: what CONNACK and PUBACK have, by MQTT 3.1.1; PINGRESP has none. What is longer
was not asked for, and the library keeps it until it is whole: up to 256 MB, which is all memory of the unit."""
_MOST_HEARD_S = 1000
"""Bytes of answers in a second: 250 acknowledgements. A connection has some ten at its beginning and one a second then;
more lets a broker that acknowledges without end take the processor."""
_MOST_QUEUED = 100
"""Messages for a broker that does not take them: more is memory for what is old already."""
_IN_THE_CLEAR = ("WRONG_VERSION_NUMBER", "UNEXPECTED_EOF_WHILE_READING")
"""Reasons of OpenSSL where the other side does not speak TLS."""
_NO_REASON = "Unspecified error"
"""What the library says where the other side closes, which MQTT 3.1.1 lets it do without a word."""
_OTHERS = stat.S_IROTH | stat.S_IWOTH
_LOCAL = ("localhost", "127.0.0.1", "::1")

_AS_IT_IS = tuple(field for field in STATUS if field.mqtt)

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Broker:
    """Address of the broker, and the account there. tls: None for an unencrypted connection. password: None for a user
    without one.
    """

    host: str
    port: int
    tls: ssl.SSLContext | None = None
    user: str | None = None
    password: str | None = None


def broker_of(
    url: str, user: str | None, password_file: Path | None, ca: Path | None, certificate: Path | None, key: Path | None
) -> Broker:
    """mqtt://HOST[:PORT] or mqtts://HOST[:PORT]. Raises ConfigurationError, also for a password in the clear."""
    try:
        parts = urlsplit(url)
        port = parts.port or _PORTS.get(parts.scheme)
    except ValueError:
        parts, port = urlsplit(""), None
    bare = parts.scheme in _PORTS and parts.username is None and not parts.path.strip("/")
    if port is None or not parts.hostname or not bare:
        remedy = "Such as mqtts://broker.example or mqtt://127.0.0.1:1883; who logs in is --user and --password-file"
        raise ConfigurationError("is not the address of a broker", printable(url), remedy)
    secure = parts.scheme == "mqtts"
    if not secure and password_file is not None and parts.hostname not in _LOCAL:
        remedy = "Use mqtts://, or a broker on this computer"
        raise ConfigurationError("everybody on the network could read the password", printable(url), remedy)
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
        raise ConfigurationError(
            f"cannot be read ({error.strerror})", str(file), "Check the path and its permissions"
        ) from None
    except UnicodeDecodeError:
        raise ConfigurationError("is not text", str(file), "Write the password into its first line") from None
    if not password:
        raise ConfigurationError("holds no password", str(file), "Write the password into its first line")
    return password


def _tls(ca: Path | None, certificate: Path | None, key: Path | None) -> ssl.SSLContext:
    """TLS for a broker whose name its certificate must bear. ca: None for the system's authorities."""
    where = ", ".join(str(file) for file in (ca, certificate, key) if file is not None)
    try:
        context = ssl.create_default_context(cafile=None if ca is None else str(ca))
        if certificate is not None:
            context.load_cert_chain(certificate, key)
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"cannot be used ({error})", where, "Check the files; PEM is expected") from None
    return context


def message(status: Status | None) -> dict[str, Any]:
    """What is published of a service; of one that does not answer, or is of another version, nothing but that."""
    try:
        return {"up": False, "verified": False, "alarm": None} if status is None else _message_of(status)
    except (KeyError, TypeError, ValueError):
        return message(None)


def _message_of(status: Status) -> dict[str, Any]:
    reference = status["reference"]
    return {
        "up": True,
        "verified": contact_closed(status),
        "alarm": status["priority"] in ("high", "medium"),
        **{field.name: status[field.name] for field in _AS_IT_IS if not field.later or field.name in status},
        "lost": sorted(status["lost"]),
        "simulated": bool(status["simulated"]),
        "reference": None if reference is None else {name: reference[name] for name in ("number", "sha256", "utc")},
    }


class _Client(Client):
    """The library's, which leaves a broker that says more than answers. trouble: what it said; empty where nothing."""

    def __init__(self, name: str) -> None:
        super().__init__(CallbackAPIVersion.VERSION2, client_id=name, reconnect_on_failure=False)
        self.trouble = ""
        self._heard_s, self._heard = 0.0, 0

    def _sock_recv(self, bufsize: int) -> bytes:
        """The library asks here for as much as a packet has announced, before it has any of it. Raises OSError."""
        if bufsize > _LONGEST_ANSWER:
            self.trouble = f"it sends {bufsize} unsolicited bytes"
            raise ConnectionAbortedError(self.trouble)
        received = super()._sock_recv(bufsize)
        now_s = time.monotonic()
        if now_s - self._heard_s > 1.0:
            self._heard_s, self._heard = now_s, 0
        self._heard += len(received)
        if self._heard > _MOST_HEARD_S:
            self.trouble = "it sends answers without end"
            raise ConnectionAbortedError(self.trouble)
        return received


class Publisher:
    """cart: its name in the topics. read: the status, None where there is none. say: for the journal. prefix: of the
    topics. discovery_prefix: of Home Assistant, empty where nobody wants it.
    """

    def __init__(
        self, broker: Broker, cart: str, read: Callable[[], Status | None], say: Say, prefix: str, discovery_prefix: str
    ) -> None:
        self._broker, self._read, self._say = broker, read, say
        self._state, self._available = f"{prefix}/{cart}/state", f"{prefix}/{cart}/availability"
        self._discovery = discovery(cart, self._state, self._available, discovery_prefix) if discovery_prefix else {}
        self._connected, self._gone = threading.Event(), threading.Event()
        self._why, self._refused = "", False
        self._trouble: str | None = None
        self._said_well = False
        self._waiting_s: deque[float] = deque()  # when each message was sent that is not acknowledged yet
        self._answered = threading.Event()
        self._accepted_s = 0.0
        self._name = f"probewatch-{cart}"
        self._client = self._make_client(self._name)

    def run(self, stop: threading.Event) -> None:
        """Publish until stopped; then the cart is published as offline."""
        wait_s = _FIRST_WAIT_S
        while not stop.is_set():
            if self._connect():
                began_s = time.monotonic()
                self._publish_until_lost(stop)
                if time.monotonic() - began_s >= _LONGEST_WAIT_S:
                    wait_s = _FIRST_WAIT_S
            why = self._why
            self._leave(stop.is_set())
            if not stop.is_set():
                self._say_trouble(why)
                stop.wait(wait_s)
                wait_s = min(2 * wait_s, _LONGEST_WAIT_S)

    def _make_client(self, name: str) -> _Client:
        client = _Client(name)
        client.will_set(self._available, "offline", qos=1, retain=True)
        client.max_queued_messages_set(_MOST_QUEUED)
        client.connect_timeout = _CONNECT_S
        if self._broker.user is not None:
            client.username_pw_set(self._broker.user, self._broker.password)
        if self._broker.tls is not None:
            client.tls_set_context(self._broker.tls)
        client.on_connect, client.on_disconnect = self._note_connect, self._note_disconnect
        client.on_publish = self._note_acknowledged
        return client

    def _note_connect(self, _client: Client, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        if reason.is_failure:
            self._why, self._refused = f"it refuses this cart ({printable(str(reason))})", True
            self._gone.set()
        else:
            self._accepted_s = time.monotonic()
            self._connected.set()

    def _note_disconnect(self, _client: Client, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        if not self._gone.is_set():
            self._why = self._client.trouble or self._words_of_leaving(str(reason))
            self._refused = bool(self._client.trouble)
        self._gone.set()

    def _note_acknowledged(self, _client: Client, _data: Any, _number: Any, _reason: Any, _properties: Any) -> None:
        """MQTT has a broker acknowledge in the order of the messages."""
        if self._waiting_s:
            self._waiting_s.popleft()
        self._answered.set()

    def _connect(self) -> bool:
        """Whether the broker has accepted this cart. A client of its own each time: what the last one could not deliver
        is old.
        """
        self._client = self._make_client(self._name)
        self._connected.clear()
        self._gone.clear()
        self._answered.clear()
        self._waiting_s.clear()
        self._why, self._refused = "it does not answer", False
        try:
            self._client.connect(self._broker.host, self._broker.port, _KEEPALIVE_S)
        except (OSError, ValueError) as error:
            self._why = self._words_of(error)
            return False
        self._client.loop_start()
        end_s = time.monotonic() + _CONNECT_S
        while not self._gone.is_set() and time.monotonic() < end_s:
            if self._connected.wait(0.05):  # a refusal is seen as soon as that
                return True
        return False

    def _words_of(self, error: OSError | ValueError) -> str:
        """The words of an error without its number; a port that speaks no TLS breaks off, or answers in the clear."""
        said = printable(system_words(error))
        plain = self._broker.tls is not None and isinstance(error, ConnectionResetError | ssl.SSLEOFError)
        plain |= isinstance(error, ssl.SSLError) and error.reason in _IN_THE_CLEAR
        if isinstance(error, ssl.SSLCertVerificationError):
            return f"{said}; --ca names who signed it, and --broker the host that it is for"
        return f"{said}; is it a port for mqtts://?" if plain else said

    def _words_of_leaving(self, reason: str) -> str:
        """A port that speaks TLS breaks off before it has accepted anybody in the clear."""
        if self._broker.tls is None and not self._connected.is_set():
            return "it breaks off before it accepts this cart; is it a port for mqtts://?"
        if reason != _NO_REASON:
            return f"it has gone ({printable(reason)})"
        is_short = time.monotonic() - self._accepted_s < _LONGEST_WAIT_S
        other = f"; does another program log in there as {self._name}? Give this cart a --cart of its own"
        return f"it has closed the connection{other * is_short}"

    def _publish_until_lost(self, stop: threading.Event) -> None:
        if self._trouble is None:
            self._say_well()
        self._publish(self._available, "online")
        for topic, config in self._discovery.items():
            self._publish(topic, json.dumps(config))
        published: dict[str, Any] | None = None
        published_s = 0.0
        while not (stop.is_set() or self._gone.is_set()):
            now = message(self._read())
            if now != published or time.monotonic() - published_s >= _REPEAT_S:
                published, published_s = now, time.monotonic()
                self._publish_state(now)
            if self._answered.is_set():
                self._say_well()
            self._wait(stop)
            self._leave_who_acknowledges_nothing()

    def _publish_state(self, now: dict[str, Any]) -> None:
        utc = datetime.now(UTC).isoformat(timespec="seconds")
        self._publish(self._state, json.dumps({**now, "utc": utc}, ensure_ascii=False))

    def _wait(self, stop: threading.Event) -> None:
        """Wait until the next look; the end is not kept waiting."""
        end_s = time.monotonic() + _LOOK_S
        while time.monotonic() < end_s and not self._gone.is_set() and not stop.wait(0.05):
            pass

    def _leave_who_acknowledges_nothing(self) -> None:
        """Break off without a goodbye, so that the broker publishes the last will if it is able to."""
        waiting_s = next(iter(self._waiting_s), None)
        if waiting_s is None or time.monotonic() - waiting_s <= _ACKNOWLEDGED_S:
            return
        line = self._client.socket()
        if isinstance(line, socket.socket):
            self._client.trouble = f"it has acknowledged nothing for {_ACKNOWLEDGED_S:g} s"
            with contextlib.suppress(OSError):
                line.shutdown(socket.SHUT_RDWR)
            self._gone.wait(_GOODBYE_S)

    def _publish(self, topic: str, payload: str) -> None:
        self._waiting_s.append(time.monotonic())
        self._client.publish(topic, payload, qos=1, retain=True)

    def _leave(self, meant: bool) -> None:
        if meant and self._connected.is_set() and not self._gone.is_set():
            self._publish_state(message(None))
            last = self._client.publish(self._available, "offline", qos=1, retain=True)
            if last.rc == MQTTErrorCode.MQTT_ERR_SUCCESS:
                last.wait_for_publish(_GOODBYE_S)
        self._client.disconnect()
        self._client.loop_stop()

    def _say_trouble(self, why: str) -> None:
        """Say once, while it lasts, that it is away, whatever the network says of it, or that it refuses this cart."""
        kind = "refused" if self._refused else "away"
        if self._trouble != kind:
            self._say(f"no broker at {self._broker.host}:{self._broker.port}: {why}; trying again")
        self._trouble, self._said_well = kind, False

    def _say_well(self) -> None:
        if not self._said_well:
            self._say(f"telling {self._state} at {self._broker.host}:{self._broker.port}")
        self._trouble, self._said_well = None, True
