"""Publishes the state of a cart on an MQTT broker: retained, so that a later client knows it, and with a last will, so
that a client learns when nothing publishes it any more.

It subscribes to nothing, so a broker has nothing to send but short answers; one that sends more is left, and so is one
that acknowledges nothing or, by MQTT 5, refuses the state. A broker that vanishes is reported once and tried again; the
service knows nothing of it.
"""

import contextlib
import json
import math
import socket
import ssl
import threading
import time
from collections import deque
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from paho.mqtt.client import Client, MQTTMessageInfo
from paho.mqtt.enums import MQTTErrorCode, MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from probewatch.appliance.service.control.status_fields import STATUS
from probewatch.drivers.errors import system_words
from probewatch.drivers.printable import printable
from probewatch.tools.monitoring.broker import Broker
from probewatch.tools.monitoring.exposition import Status, contact_closed
from probewatch.tools.monitoring.home_assistant import discovery
from probewatch.tools.monitoring.mqtt_client import TellingClient

_KEEPALIVE_S = 10
"""Seconds. The broker publishes the last will after one and a half of it: more lets a dead cart look alive for longer,
less makes more traffic."""
_CONNECT_S = 5.0
"""Seconds for a broker to accept. Longer finds a slow one, shorter is sooner at the next try. Not measured."""
_FIRST_WAIT_S, _LONGEST_WAIT_S = 1.0, 30.0
"""Seconds before the next try, doubled each time until a connection has lasted for the longest. More notices later that
a broker is back, less tries to connect more often."""
_LOOK_S = 1.0
"""Seconds between two looks at the service. Shorter publishes a change sooner, and asks the service more often."""
_REPEAT_S = 15.0
"""Seconds after which the state is published again though it is the same, so that a client can recognise a silence."""
_EXPIRES_S = 45
"""Seconds until the broker forgets the state, and `online`, if not sent again: how long both outlive a power cut of
cart and broker, which leaves no last will. Shorter takes them from later clients of a cart with a slow network."""
_ACKNOWLEDGED_S = 10.0
"""Seconds that a broker may take to acknowledge a message, as long as for a sign of life. One that never does may have
kept nothing; the library holds 20 of its messages and sends no more. Longer has a slow network succeed, shorter is
reported sooner. Not measured."""
_GOODBYE_S = 2.0
"""Seconds that the last message may take at the end."""
_MOST_QUEUED = 100
"""Messages for a broker that does not take them: more is memory for what is old already."""
_IN_THE_CLEAR = ("WRONG_VERSION_NUMBER", "UNEXPECTED_EOF_WHILE_READING")
"""Reasons of OpenSSL where the other side does not speak TLS."""
_NO_REASON = "Unspecified error"
"""Text of the library where the other side closes without a reason."""
_TOO_OLD, _TAKEN_OVER = "Unsupported protocol version", "Session taken over"
_SILENT = "it does not answer"
_OLDER = ", by MQTT 3.1.1, which neither refuses nor forgets a message; use a broker with MQTT 5"
"""Text in the journal on a broker that knows no newer version."""
_TOO_LARGE, _RAISE = "Packet too large", "; raise its limit of a message"
_REMEDIES = {"Quota exceeded": _RAISE, _TOO_LARGE: _RAISE, "Not authorized": "; let this user write that topic"}
_AS_IT_IS = tuple(field for field in STATUS if field.mqtt)

Say = Callable[[str], None]


def message(status: Status | None) -> dict[str, Any]:
    """Returns what is published of a service; of one that is silent, or of another version, nothing but that."""
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


class Publisher:
    """Publishes one cart's state. cart: its name in the topics. read: the status, None where there is none. say: writes
    to the journal. prefix: that of the topics. discovery_prefix: that of Home Assistant, empty where it is not wanted.
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
        self._unwanted = False
        self._waiting: deque[tuple[float, str]] = deque()  # time and topic of each message not acknowledged yet
        self._answered, self._unkept = threading.Event(), threading.Event()
        self._too_old, self._accepted_s = False, 0.0
        self._name = f"probewatch-{cart}"
        self._client = self._make_client(MQTTProtocolVersion.MQTTv5)

    def run(self, stop: threading.Event) -> None:
        """Publishes until stopped; then the cart is published as offline."""
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

    def _make_client(self, version: MQTTProtocolVersion) -> TellingClient:
        client = TellingClient(self._name, version)
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

    def _note_connect(self, _client: Client, _data: Any, _flags: Any, reason: Any, properties: Any) -> None:
        if reason.is_failure:
            self._why, self._refused = f"it refuses this cart ({printable(str(reason))})", True
            self._too_old = str(reason) == _TOO_OLD
            self._gone.set()
        else:
            self._accepted_s = time.monotonic()
            self._client.largest = getattr(properties, "MaximumPacketSize", math.inf)
            self._connected.set()

    def _note_disconnect(self, _client: Client, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        if not self._gone.is_set():
            self._why = self._client.trouble or self._words_of_leaving(str(reason))
            self._refused = bool(self._client.trouble)
            accepted = self._connected.is_set()
            self._too_old = not accepted and (self._client.malformed or not self._client.trouble)
        self._gone.set()

    def _note_acknowledged(self, _client: Client, _data: Any, _number: Any, reason: Any, _properties: Any) -> None:
        """Takes an acknowledgement; MQTT sends them in order of the messages, and version 5 states what is not kept."""
        topic = self._waiting.popleft()[1] if self._waiting else ""
        if reason.is_failure:
            self._note_refused(topic, printable(str(reason)))
        elif topic == self._state:
            self._answered.set()

    def _note_refused(self, topic: str, words: str) -> None:
        if topic in (self._state, self._available):
            self._client.trouble = f"it refuses {topic} ({words}){_REMEDIES.get(words, '')}"
            self._unkept.set()
        elif not self._unwanted:
            self._unwanted = True
            self._say(f"the broker refuses {topic} ({words}){_REMEDIES.get(words, '')}; or give --discovery ''")

    def _connect(self) -> bool:
        """Returns whether the broker has accepted this cart, in the older version of MQTT where it knows no other."""
        accepted = self._try(MQTTProtocolVersion.MQTTv5)
        if accepted or not self._too_old:
            return accepted
        why, refused = self._why, self._refused
        self._end_client()
        accepted = self._try(MQTTProtocolVersion.MQTTv311)
        if not accepted and self._why == _SILENT:
            self._why, self._refused = why, refused
        return accepted

    def _try(self, version: MQTTProtocolVersion) -> bool:
        """Connects with a new client each time, because what the last one could not deliver is old."""
        self._client = self._make_client(version)
        for event in (self._connected, self._gone, self._answered, self._unkept):
            event.clear()
        self._waiting.clear()
        self._why, self._refused, self._too_old = _SILENT, False, False
        try:
            self._client.open(self._broker.host, self._broker.port, _KEEPALIVE_S)
        except (OSError, ValueError) as error:
            self._why = self._words_of(error)
            return False
        self._client.loop_start()
        end_s = time.monotonic() + _CONNECT_S
        while not self._gone.is_set() and time.monotonic() < end_s:
            if self._connected.wait(0.05):  # so a refusal is seen within that time
                return True
        return False

    def _words_of(self, error: OSError | ValueError) -> str:
        """Returns the words of an error without its number; a port without TLS breaks off, or answers in the clear."""
        said = printable(system_words(error))
        plain = self._broker.tls is not None and isinstance(error, ConnectionResetError | ssl.SSLEOFError)
        plain |= isinstance(error, ssl.SSLError) and error.reason in _IN_THE_CLEAR
        if isinstance(error, ssl.SSLCertVerificationError):
            return f"{said}; --ca names who signed it, and --broker the host that it is for"
        return f"{said}; is it a port for mqtts://?" if plain else said

    def _words_of_leaving(self, reason: str) -> str:
        """Returns why it left: a port with TLS breaks off a client in the clear, or without a good certificate."""
        if not self._connected.is_set() and (self._broker.tls is None or reason == _NO_REASON):
            hint = "is it a port for mqtts://?" if self._broker.tls is None else "does it ask for a --certificate?"
            return f"it breaks off before it accepts this cart; {hint}"
        if reason not in (_NO_REASON, _TAKEN_OVER):
            return f"it has gone ({printable(reason)})"
        is_short = reason == _TAKEN_OVER or time.monotonic() - self._accepted_s < _LONGEST_WAIT_S
        other = f"; does another program log in there as {self._name}? Give this cart a --cart of its own"
        return f"it has closed the connection{other * is_short}"

    def _publish_until_lost(self, stop: threading.Event) -> None:
        """Publishes the state first, and `online` when it is kept: what the broker has from before is not to be
        trusted, and it may have `online` from a connection that this one has displaced.
        """
        if self._trouble is None:
            self._say_well()
        self._publish(self._available, "offline")
        published: dict[str, Any] | None = None
        published_s = 0.0
        online_s = -math.inf
        while not (stop.is_set() or self._gone.is_set() or self._unkept.is_set()):
            now = message(self._read())
            if now != published or time.monotonic() - published_s >= _REPEAT_S:
                published, published_s = now, time.monotonic()
                self._publish_state(now)
            self._wait(stop, until_answered=math.isinf(online_s))
            if self._answered.is_set() and not self._unkept.is_set():
                self._say_well()
                if time.monotonic() - online_s >= _REPEAT_S:
                    self._publish_online(first=math.isinf(online_s))
                    online_s = time.monotonic()
            self._leave_who_keeps_nothing()

    def _publish_online(self, first: bool) -> None:
        self._publish(self._available, "online", _EXPIRES_S)
        for topic, config in self._discovery.items() if first else ():
            self._publish(topic, json.dumps(config))

    def _publish_state(self, now: dict[str, Any]) -> MQTTMessageInfo | None:
        utc = datetime.now(UTC).isoformat(timespec="seconds")
        return self._publish(self._state, json.dumps({**now, "utc": utc}, ensure_ascii=False), _EXPIRES_S)

    def _wait(self, stop: threading.Event, until_answered: bool) -> None:
        """Waits until the next look, but not past the end or the first answer that is waited for."""
        end_s = time.monotonic() + _LOOK_S
        while time.monotonic() < end_s and not (self._gone.is_set() or self._unkept.is_set() or stop.wait(0.05)):
            if until_answered and self._answered.is_set():
                return

    def _leave_who_keeps_nothing(self) -> None:
        """Breaks off without a goodbye, so that the broker publishes the last will if it is able to. One that refuses
        the state may keep the short one that claims nothing, in place of the one before.
        """
        waiting_s = self._waiting[0][0] if self._waiting else None
        if self._unkept.is_set():
            self._publish_briefly(self._publish_state(message(None)))
        elif waiting_s is not None and time.monotonic() - waiting_s > _ACKNOWLEDGED_S:
            self._client.trouble = f"it has acknowledged nothing for {_ACKNOWLEDGED_S:g} s"
        else:
            return
        self._why, self._refused = self._client.trouble, True
        line = self._client.socket()
        if isinstance(line, socket.socket):
            with contextlib.suppress(OSError):
                line.shutdown(socket.SHUT_RDWR)
            self._gone.wait(_GOODBYE_S)

    def _publish(self, topic: str, payload: str, expires_s: int | None = None) -> MQTTMessageInfo | None:
        """Publishes a message. expires_s: when the broker forgets it, where it can; None for never. Returns None where
        it is too large.
        """
        if not self._client.takes(topic, payload):
            self._note_refused(topic, _TOO_LARGE)
            return None
        properties = None
        if expires_s is not None and self._client.refuses:
            properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
            properties.MessageExpiryInterval = expires_s
        self._waiting.append((time.monotonic(), topic))
        return self._client.publish(topic, payload, qos=1, retain=True, properties=properties)

    def _publish_briefly(self, told: MQTTMessageInfo | None) -> None:
        if told is not None and told.rc == MQTTErrorCode.MQTT_ERR_SUCCESS:
            told.wait_for_publish(_GOODBYE_S)

    def _leave(self, meant: bool) -> None:
        if meant and self._connected.is_set() and not self._gone.is_set():
            self._publish_state(message(None))
            self._publish_briefly(self._publish(self._available, "offline"))
        self._end_client()

    def _end_client(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()

    def _say_trouble(self, why: str) -> None:
        """Reports once, while it lasts, that the broker is away, for whatever reason, or that it refuses this cart."""
        kind = "refused" if self._refused else "away"
        if self._trouble != kind:
            self._say(f"no broker at {self._broker.host}:{self._broker.port}: {why}; trying again")
        self._trouble, self._said_well = kind, False

    def _say_well(self) -> None:
        if not self._said_well:
            older = "" if self._client.refuses else _OLDER
            self._say(f"telling {self._state} at {self._broker.host}:{self._broker.port}{older}")
        self._trouble, self._said_well = None, True
